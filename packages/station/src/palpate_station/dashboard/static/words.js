// Texts of the page by their keys, in the language of the server.
const TEXTS = JSON.parse(document.getElementById("words").textContent);
export const w = (key, values) => t(TEXTS[key], values);
// Fills placeholders in texts, and formats numbers with a typographic minus sign.
export const t = (text, values = {}) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
export const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−"));
export const integer = (value) => Math.round(value).toLocaleString("en-US");
export const range = (low, high, digits) => `[${fixed(low, digits)}, ${fixed(high, digits)}]`;
