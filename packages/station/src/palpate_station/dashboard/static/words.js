// Texts of the page by their keys, in the language of the server.
const TEXTS = JSON.parse(document.getElementById("words").textContent);
export const w = (key, values) => t(TEXTS[key], values);
// Fills placeholders in texts, and formats numbers with a typographic minus sign.
export const t = (text, values = {}) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
// Names of fingers and pixels, which count from 1 on all pages.
export const fingerName = (finger, isPad = false) => w(isPad ? "part.pad" : "part.finger", { n: +finger + 1 });
export const pixelName = (row, col, key = "part.pixel") => w(key, { row: +row + 1, col: +col + 1 });
export const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−"));
export const integer = (value) => Math.round(value).toLocaleString("en-US");
export const range = (low, high, digits) => `[${fixed(low, digits)}, ${fixed(high, digits)}]`;
