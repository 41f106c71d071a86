// The full page: pads, curves, verdict and measurements.
import { $, follow, handState, isSensorOnly, joined, number, setText, received, reasons } from "/static/poll.js";
import { fixed, range, t } from "/static/words.js";
import { begin as beginChart, drawChart, momentOf } from "/static/chart.js";
import { begin as beginHand, drawFingers } from "/static/pads.js";
import { begin as beginKept, drawKept } from "/static/compare.js";
import { begin as beginTimeline, drawTimeline } from "/static/timeline.js";

const UNITS = { size_mm: ["Size", "mm", 1], force_n: ["Grip force", "N", 2], stiffness_n_per_mm: ["Stiffness", "N/mm", 2], settled_percent: ["Settled at 20\u00a0s", "%", 1] };
const STATUS = { too_short: "from {s} s of data", not_settling: "not settling", saturated: "outside range", fell_back: "fallback method" };

// -- texts and numbers -----------------------------------------------------------------------------
// The next round number at or above a value.
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 5, 7.5, 10].map((m) => m * power).find((one) => one >= 0.999 * value);
}

// The interval on a scale from zero, with a mark at the true value if known.
function bar(one) {
  const marks = [one.low, one.value, one.high, ...(typeof one.truth === "number" ? [one.truth] : [])].filter((v) => v !== null);
  const lowest = Math.min(...marks), highest = Math.max(...marks), low = lowest < 0 ? -roundUp(-lowest) : 0, high = highest > 0 ? roundUp(highest) : 0;
  const span = high - low || 1, x = (v) => `${((100 * (v - low)) / span).toFixed(2)}%`;
  const inside = one.low <= one.truth && one.truth <= one.high;
  // Positions are in percent and marks in pixels, so that a wide card does not stretch the marks.
  return `<div class="scale num" aria-hidden="true"><span>${number(low)}</span><svg><line x1="0" x2="100%" y1="12" y2="12" stroke="var(--line)" stroke-width="3"/>
    <line class="interval" x1="${x(one.low)}" x2="${x(one.high)}" y1="12" y2="12" stroke="var(--accent)" stroke-width="7"/>
    <line x1="${x(one.value)}" x2="${x(one.value)}" y1="7" y2="17" stroke="var(--ink)" stroke-width="2"/>
    ${typeof one.truth === "number" ? `<svg x="${x(one.truth)}" overflow="visible"><path d="M-5 0h10l-5 8z" fill="${inside ? "var(--good)" : "var(--bad)"}"/></svg>` : ""}</svg><span>${number(high)}</span></div>`;
}

// Without a gripper, only the force is measured; all other cards are hidden.
function hideUnmeasured(doc) {
  const alone = isSensorOnly(doc);
  setText($("force-title"), alone ? "Force, N" : "Grip force, N");
  for (const name of Object.keys(UNITS)) $(`measure-${name}`)?.classList.toggle("hidden", alone && !(name === "force_n" && doc.measured.force_now));
}

const between = (one, digits) => t("{low} to {high}", { low: fixed(one.low, digits), high: fixed(one.high, digits) });
const interval = (one, digits) => `90 %: ${between(one, digits)}`;

// Firmness index on a scale from 0 (grape) to 100 (stone), also available if only a bound is known.
function firmnessLine(name, { values: { firmness } }) {
  if (name !== "stiffness_n_per_mm" || !firmness || firmness.value === null) return "";
  // A wide interval is shown without its middle.
  const shown = firmness.text ? `${firmness.text} of 100` : `${fixed(firmness.value, 0)} of 100 ${range(firmness.low, firmness.high, 0)}`;
  return `<div class="range num" id="firmness">firmness ${shown}</div>`;
}

function drawMeasures(doc) {
  const { measured, hand } = doc;
  for (const [name, [title, unit, digits]] of Object.entries(UNITS)) {
    const card = $(`measure-${name}`), one = measured.values[name];
    if (!card) continue;
    if (name === "force_n" && measured.force_now && measured.holds) { drawForceNow(card, measured.force_now, one, { decided: measured.decided, hand }); continue; }
    card.dataset.decided = measured.decided;
    const state = !one ? "" : one.status !== "ok" ? `<span class="note">${t(STATUS[one.status] ?? one.status, { s: fixed(measured.data_s, 1) })}</span>` : measured.decided ? "" : "<span>forecast</span>";
    const truth = one && typeof one.truth === "number" ? one.truth : null;
    if (one && one.text) {
      card.title = "only a bound of the value is known";
      card.innerHTML = `<div class="name"><span>${title}</span></div><div class="value num">${one.text} <span>${unit}</span></div>
        <div class="range num">${truth === null ? "" : t("true {value}", { value: fixed(truth, digits) })}</div>${firmnessLine(name, measured)}`;
      continue;
    }
    const ends = !one ? "" : truth === null ? interval(one, digits) : `${between(one, digits)} · ${t("true {value}", { value: fixed(truth, digits) })}`;
    // A measured value replaces the forecast.
    const now = measured.settled?.[name];
    if (one && now) {
      card.title = "measured at 20 s; below, the answer with its 90 % interval";
      card.innerHTML = `<div class="name"><span>${title}</span><span>measured</span></div><div class="value num">${fixed(now.value, digits)} <span>${unit}</span></div>
        <div class="range num">answer ${fixed(one.value, digits)} ${range(one.low, one.high, digits)}${truth === null ? "" : ` · ${t("true {value}", { value: fixed(truth, digits) })}`}</div>${bar(one)}`;
      continue;
    }
    card.title = "with its 90 % interval";
    card.innerHTML = `<div class="name"><span>${title}</span>${state}</div><div class="value num">${one ? fixed(one.value, digits) : (name === "force_n" && handState(doc)) || "–"} <span>${one || !(name === "force_n" && handState(doc)) ? unit : ""}</span></div>
      <div class="range num">${ends}</div>${firmnessLine(name, measured)}${one ? bar(one) : ""}`;
  }
}

// During a hold, the card shows the current force and below it the answer.
function drawForceNow(card, now, answer, { decided, hand }) {
  card.dataset.decided = true;
  card.title = "force now, with its 90 % interval";
  const digits = now.value < 10 ? 2 : 1;
  const settled = answer && answer.value !== null ? `${decided ? "answer" : "forecast"} ${fixed(answer.value, digits)} N ${range(answer.low, answer.high, digits)}` : "";
  card.innerHTML = `<div class="name"><span>${hand ? "Grip force now" : "Force now"}</span></div><div class="value num">${fixed(now.value, digits)} <span>N</span></div>
    <div class="range num">${interval(now, digits)}</div><div class="range num">${settled}</div>`;
}

function drawVerdict(doc) {
  const card = $("verdict");
  if (!card) return;
  const verdict = doc.verdict, parts = [verdict.is_grasp ? doc.item : "", doc.operator.badge, joined(verdict.why), ...reasons(doc)].filter(Boolean);
  card.dataset.kind = verdict.kind;
  const now = doc.measured.force_now;
  if (doc.grasp && verdict.kind === "busy" && now && now.value >= 0.05) parts.push(t("about {force} N", { force: fixed(now.value, 1) }));
  card.dataset.bin = Boolean(verdict.bin);
  setText($("verdict-text"), verdict.text);
  setText($("verdict-firm"), joined(verdict.firmness ?? ""));
  setText($("verdict-why"), parts.join("\u00a0· "));
}

// The instruction, its progress and the button to confirm it. A replay has its button in the timeline.
function drawGuide({ guide, source }) {
  const isShown = guide && !(guide.needs_confirmation && source?.replayed);
  $("guide").classList.toggle("hidden", !isShown);
  if (!isShown) return;
  setText($("guide-text"), guide.text);
  $("guide-progress").classList.toggle("hidden", guide.fraction === null);
  $("guide-progress").value = guide.fraction ?? 0;
  $("confirm").classList.toggle("hidden", !guide.needs_confirmation);
}

// Links to items and recordings open their tab on this page, unless opened in a new window.
document.addEventListener("click", (event) => {
  const link = event.target.closest?.("a[data-item], a[data-recording]");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  const [what, name] = Object.entries(link.dataset)[0];
  window.emitEvent(what, name);
});

// Each tab has its own entry in the browser history.
window.visit = (path) => { if (location.pathname.split("/")[1] !== path.split("/")[1]) history.pushState(null, "", path); };
window.addEventListener("popstate", () => window.emitEvent("went", location.pathname));

// On a narrow screen the panel is below the stage, so the URL of a tab scrolls to the panel.
function scrollToPanel() {
  if (received.drawn === 0 && location.pathname !== "/" && innerWidth <= 1040) document.querySelector(".panel").scrollIntoView();
}

beginHand();
beginChart();
beginTimeline();
beginKept();
follow((doc) => { drawVerdict(doc); drawGuide(doc); drawTimeline(doc); drawKept(doc); drawChart(doc); drawFingers(momentOf(doc)); drawMeasures(doc); hideUnmeasured(doc); scrollToPanel(); });
