// Texts in the page's language, and numbers with its decimal mark.
const WORDS = JSON.parse(document.getElementById("words").textContent), LANG = document.documentElement.lang;
const MARK = new Intl.NumberFormat(LANG).formatToParts(0.5).find((part) => part.type === "decimal").value;

export const lang = LANG.split("-")[0];
export const t = (text, values = {}) => (WORDS[text] ?? text).replace(/\{(\w+)\}/g, (_, name) => values[name]);
export const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−").replace(".", MARK));
export const whole = (value) => Math.round(value).toLocaleString(LANG);
export const range = (low, high, digits) => `[${fixed(low, digits)}${MARK === "," ? ";" : ","} ${fixed(high, digits)}]`;

// The choice in the head of the page: kept in this browser, instead of what an address asked for.
document.addEventListener("change", ({ target }) => {
  if (target.id !== "language") return;
  document.cookie = `${target.dataset.cookie}=${target.value}; path=/; max-age=31536000; samesite=lax`;
  const address = new URL(location);
  address.searchParams.delete("lang");
  location.assign(address);
});
