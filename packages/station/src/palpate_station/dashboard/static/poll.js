// Polls the page document and draws it. The next request follows the drawing, so a slow browser polls
// less often. This module also draws the header and the loss of the connection, common to all pages.
import { fixed, w } from "/static/words.js";

// The request timeout is longer than the time after which the connection counts as lost.
const PERIOD_MS = 66, TIMEOUT_MS = 4000, NEXT_REQUEST_MS = 2000, LOST_MS = 1000, CHECK_MS = 100, RETRY_MS = 250;
const GREYED = ".figure, .measures, #next-step, .item, .force, .panel-body, .panel-foot";
export const $ = (id) => document.getElementById(id);
export const esc = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
export const received = { generation: -1, curve: [], band: [], pixels: [], at: performance.now(), hungS: null, drawn: 0, stops: null, serverS: null, askedAt: 0, socketAt: Infinity, blocked: false };
// Screen readers announce every write, so unchanged texts are not written.
export const setText = (element, text) => { if (element && element.textContent !== text) element.textContent = text; };

// The font size of a headline depends on its longest word.
export function headline(box, element, text) {
  setText(element, text);
  box.style.setProperty("--letters", Math.max(...text.split(" ").map((word) => word.length)));
}

// Scales all texts of a card down until they fit, whenever texts or card size change.
export function fit(card) {
  const word = card.querySelector("b");
  const shrink = () => {
    if (!card.clientHeight) return;
    const box = card.getBoundingClientRect();
    const fits = (scale) => {
      card.style.setProperty("--fit", scale);
      const isInside = (part) => part.getBoundingClientRect().top >= box.top + 4 && part.getBoundingClientRect().bottom <= box.bottom - 4;
      return [...card.children].filter((part) => part.checkVisibility()).every(isInside) && word.scrollWidth <= word.clientWidth;
    };
    if (fits(1)) return;
    let [low, high] = [0.15, 1];
    for (let i = 0; i < 6; i += 1) if (fits((low + high) / 2)) low = (low + high) / 2; else high = (low + high) / 2;
    fits(low);
  };
  card.dataset.fits = true;
  new MutationObserver(shrink).observe(card, { childList: true, subtree: true, characterData: true });
  new ResizeObserver(shrink).observe(card);
}

export const number = (value) => fixed(value, 3).replace(/[.,]?0+$/, "");
const sinceFrame = (s) => (s < 1 ? w("link.ms_ago", { time: fixed(1000 * s, 0) }) : w("link.s_ago", { time: fixed(s, 1) }));

// Text in place of the force while the hand is open or opens.
export const handState = (doc) => (doc.hand?.open ? w("force.open") : doc.hand?.opening ? w("force.opens") : "");

// Whether the role of this page's user may move the gripper, and whether the page may now.
// Who acts while nobody drives becomes the driver.
export const mayDrive = () => document.body.dataset.mayDrive === "true";
export const isDriver = (doc) => mayDrive() && (doc.driver_id === document.body.dataset.viewer || doc.driver_id === null);

// Joins numbers and units with non-breaking spaces.
export const joined = (text) => text.replace(/(\d) (?=(?:N|N\/mm|mm|%|s)(?:[ ,;]|$))/g, "$1\u00a0");

// The reasons for the verdict, as a list of texts.
export const reasons = (doc) => listReasons(doc).map(joined);

function listReasons(doc) {
  const verdict = doc.verdict, parts = [], force = number(verdict.target_force_n);
  if (verdict.on_target === true) parts.push(w("reason.within", { force }));
  if (verdict.on_target === false) parts.push(w(doc.measured.values.force_n?.high < verdict.target_force_n ? "reason.below" : "reason.above", { force }));
  if (verdict.kind === "idle") parts.push(...doc.idle);
  // The remaining texts apply to grasps only, not to calibrations and other headlines.
  if (!verdict.is_grasp) return parts;
  if (doc.measured.decided && doc.measured.decision_time_s !== null) parts.push(w("reason.answer", { time: fixed(doc.measured.decision_time_s, 1) }));
  if (doc.measured.limited) parts.push(w("reason.limited"));
  parts.push(...doc.measured.faults);
  return parts;
}

// Without a gripper there is no hand to stop, only a running job.
export const isSensorOnly = (doc) => doc.source !== null && doc.hand === null && doc.grasp === null;

function drawHead(doc) {
  document.body.classList.toggle("alone", isSensorOnly(doc));
  const pill = $("link"), link = doc.link, replayed = doc.source && doc.source.replayed;
  const rate = link.rate_hz === null ? "–" : `${fixed(link.rate_hz, link.rate_hz < 100 ? 1 : 0)} Hz`;
  // Age at the time of sending plus the time since the request, an upper bound of the network delay.
  const age = link.age_s === null ? w("link.none_yet") : w("link.last", { ago: sinceFrame(link.age_s + (performance.now() - received.askedAt) / 1000) });
  pill.dataset.state = link.stale ? "stale" : link.waiting ? "waiting" : "fresh";
  const counted = [link.stale ? w("link.silent") : rate, w("link.lost", link), link.corrupt ? w("link.corrupt", link) : ""].filter(Boolean).join(" · ");
  const isGone = doc.activity === "gone", counts = !replayed && !link.waiting && !isGone;
  $("link-text").textContent = counts ? counted : isGone ? w("lost.pill_devices") : replayed ? w("link.replay") : doc.activity_text;
  $("link-age").textContent = counts ? age : "";
  pill.title = w("link.counts", { ...link, p99: fixed(1000 * link.period_p99_s, 1) });
  setText($("link-state"), replayed ? w("link.replay") : link.stale ? w("link.stopped") : link.waiting ? doc.activity_text : w("link.arrive"));
  $("rig-name").textContent = !doc.source ? w("link.no_rig") : replayed ? w("link.replay_of", { name: doc.source.name }) : doc.source.name;
  $("simulated").classList.toggle("hidden", !(doc.source && doc.source.simulated));
  $("trouble").classList.toggle("hidden", !doc.trouble);
  setText($("trouble-text"), doc.trouble);
  setText($("guard"), doc.guard);
}

// Time since the framework's socket was lost. Presses use this socket, responses do not.
function awayMs() {
  if (window.socket?.connected) {
    // Reconnects quickly; with its default settings the socket may wait for seven seconds.
    if (received.socketAt === Infinity) window.socket.io.reconnectionDelay(RETRY_MS).reconnectionDelayMax(2 * RETRY_MS);
    Object.assign(received, { socketAt: performance.now(), blocked: false });
    return 0;
  }
  return performance.now() - received.socketAt;
}

// Marks the page as outdated if the server, the device process or the socket does not respond.
function drawLoss(onLost) {
  const pill = $("link"), box = $("lost");
  if (!pill || !box) return;
  const silentMs = performance.now() - received.at, server = silentMs > LOST_MS, devices = received.hungS !== null;
  const unsentMs = awayMs(), unsent = unsentMs > LOST_MS || (received.blocked && unsentMs > 0);
  const lost = server || devices || unsent, agoS = Math.max((server ? silentMs / 1000 : 0) + (received.hungS ?? 0), unsent ? unsentMs / 1000 : 0);
  if (lost && !document.body.classList.contains("lost")) onLost();
  document.body.classList.toggle("lost", lost);
  // The next step is then about the devices, and is not outdated.
  document.body.classList.toggle("hung", devices && !server && !unsent);
  // Greyed elements are also reported as unavailable to screen readers.
  for (const part of document.querySelectorAll(GREYED)) if (lost) part.ariaDisabled = "true"; else part.removeAttribute("aria-disabled");
  box.classList.toggle("hidden", !lost);
  if (!lost) return;
  const ago = agoS < 60 ? w("lost.seen_s", { time: Math.floor(agoS) }) : w("lost.seen_min", { time: Math.floor(agoS / 60) });
  headline(box, $("lost-title"), w(server || unsent ? "lost.title" : "lost.devices"));
  const why = server ? w("lost.server") : unsent ? w("lost.socket") : "";
  const old = server || devices ? w("lost.old") : "";
  $("lost-why").textContent = [`${ago}.`, why, old].filter(Boolean).join(" ");
  pill.dataset.state = "stale";
  $("link-age").textContent = "";
  $("link-text").textContent = `${w(server || unsent ? "lost.pill" : "lost.pill_devices")} · ${ago}`;
}

function storeData(doc, began) {
  if (doc.generation !== received.generation) Object.assign(received, { generation: doc.generation, curve: [], band: [], pixels: [] });
  const after = (points) => ([time]) => !points.length || time > points[points.length - 1][0];
  received.curve.push(...doc.curve.filter(after(received.curve)));
  received.band.push(...doc.band.filter(after(received.band)));
  trimHistory(received.curve, 4500, (point) => point[0], doc.frozen_s);
  if (received.band.length > 900) received.band.splice(0, received.band.length - 900);
  if (!received.pixels.length) received.pixels.push(...doc.past);
  keepPixels(doc);
  trimHistory(received.pixels, 1400, (one) => one.time_s, doc.frozen_s);
  Object.assign(received, { at: performance.now(), hungS: doc.link.hung_s, stops: doc.stops, serverS: doc.server_s, askedAt: began });
}

// Stores the readings of pads and hand in order of time; a replay may move backwards.
function keepPixels({ pixels, hand }) {
  if (!pixels || pixels.time_s === null) return;
  const at = received.pixels.findLastIndex((p) => p.time_s <= pixels.time_s);
  if (received.pixels[at]?.time_s !== pixels.time_s) received.pixels.splice(at + 1, 0, { ...pixels, hand });
}

// Limits the data after a frozen grasp; the grasp itself is retained until the next one.
function trimHistory(kept, most, timeOf, frozenS) {
  const from = frozenS === null ? 0 : kept.findLastIndex((one) => timeOf(one) <= frozenS) + 1;
  if (kept.length - from > most) kept.splice(from, kept.length - from - most);
}

let asked = 0, taken = 0, next = 0;

async function poll(draw, onLost) {
  const began = performance.now(), number = (asked += 1);
  // After an undetected network failure no response arrives; the next request does not wait for it.
  next = setTimeout(poll, NEXT_REQUEST_MS, draw, onLost);
  try {
    const last = received.curve.length ? received.curve[received.curve.length - 1][0] : -1e9;
    const reply = await fetch(`/live?generation=${received.generation}&after_s=${last}`, { cache: "no-store", signal: AbortSignal.timeout(TIMEOUT_MS) });
    const doc = await reply.json();
    if (number > taken) {
      taken = number;
      storeData(doc, began);
      if ($("link") && $("verdict")) {
        drawHead(doc);
        draw(doc);
        document.body.dataset.activity = doc.activity;
        document.body.dataset.recording = doc.recording ?? "";
        document.body.dataset.drawn = received.drawn += 1;
        drawLoss(onLost);
        // An alarm of an undelivered stop ends here.
        if (doc.ready) window.dispatchEvent(new Event("palpate-ready"));
      }
    }
  } catch {
    // drawLoss shows the time without a response.
  }
  if (number < asked) return;
  clearTimeout(next);
  next = setTimeout(poll, Math.max(10, PERIOD_MS - (performance.now() - began)), draw, onLost);
}

// Sends stop count and server time before the press over the same socket, so that the server can
// refuse a press that a STOP has overtaken or that arrives too late.
function recordPress(press) {
  if (awayMs() > 0 && !press.target.closest("#stop, a")) {
    // The socket would buffer the press, and the hand would move unexpectedly later.
    press.stopImmediatePropagation();
    press.preventDefault();
    received.blocked = true;
    return;
  }
  const atS = received.serverS === null ? null : received.serverS + (performance.now() - received.askedAt) / 1000;
  window.emitEvent?.("press", { stops: received.stops, at_s: atS });
}

// The item's text that the user is editing; null after the end of a scan or a grasp, when the next
// key replaces the text.
let edited = null;
// Whether keys were typed on a page whose field is disabled.
let ignored = false;

// A barcode scanner types into the focused element. A scan replaces a name that the server has returned. Text typed outside of a field replaces the next
// item's name. F8 grasps, F9 releases.
function handleKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const button = { F8: "grasp", F9: "release" }[event.key], field = document.querySelector("input.scanned");
  if (field?.disabled && !event.target.closest("input, textarea, [role=dialog]")) {
    if (event.key === "Enter" && ignored) window.dispatchEvent(new Event("palpate-scan-ignored"));
    ignored = event.key.length === 1 || (ignored && event.key !== "Enter");
  }
  if (button || (event.key === "Enter" && field === event.target)) edited = null;
  if (button) {
    event.preventDefault();
    $(button)?.click();
  } else if (field && field === event.target && event.key.length === 1) {
    if (field.value !== edited) field.select();
  } else if (field && !field.disabled && event.key.length === 1 && !(event.key === " " && event.target.closest("button, a, [tabindex]")) && !event.target.closest("input, textarea, select, [role=slider]:not(.plot), [role=dialog], [contenteditable]")) {
    field.focus();
    field.select();
  }
}

export function follow(draw, onLost = () => {}) {
  // Accessibility: the framework's message about a lost socket must be in a landmark or an alert.
  $("popup")?.setAttribute("role", "alert");
  setInterval(drawLoss, CHECK_MS, onLost);
  window.addEventListener("click", recordPress, true);
  window.addEventListener("keydown", handleKey, true);
  for (const name of ["input", "pointerdown"]) window.addEventListener(name, ({ target }) => { if (target.matches?.("input.scanned")) edited = target.value; }, true);
  poll(draw, onLost);
}
