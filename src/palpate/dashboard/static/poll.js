// Asks for what is new, has it drawn, and asks again: a slow screen asks less often and holds up
// nobody. Draws itself what every view has: the head, and the loss of the connection.
import { fixed, t } from "/static/words.js";

// A slow answer is still taken long after the connection counts as lost.
const PERIOD_MS = 66, GIVEN_UP_MS = 4000, BESIDE_MS = 2000, LOST_MS = 1000, LOOK_MS = 100, RETRY_MS = 250;
const GREYED = ".figure, .measures, #next-step, .item, .force, .panel-body, .panel-foot";
export const $ = (id) => document.getElementById(id);
export const esc = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
export const seen = { generation: -1, curve: [], band: [], pixels: [], at: performance.now(), hungS: null, drawn: 0, stops: null, serverS: null, askedAt: 0, socketAt: Infinity, vain: false };
// A screen reader speaks of what is written: nothing is, unless it changed.
export const say = (element, text) => { if (element && element.textContent !== text) element.textContent = text; };

// A headline is as large as its longest word allows.
export function headline(box, element, text) {
  say(element, text);
  box.style.setProperty("--letters", Math.max(...text.split(" ").map((word) => word.length)));
}

// All of a card's words are in it: they shrink together until they are, whenever words or card change.
export function fit(card) {
  const word = card.querySelector("b");
  const shrink = () => {
    if (!card.clientHeight) return;
    const box = card.getBoundingClientRect();
    const fits = (scale) => {
      card.style.setProperty("--fit", scale);
      const isInside = (part) => part.getBoundingClientRect().top >= box.top + 4 && part.getBoundingClientRect().bottom <= box.bottom - 4;
      return [...card.children].every(isInside) && word.scrollWidth <= word.clientWidth;
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
const sinceFrame = (s) => (s < 1 ? t("{time} ms ago", { time: fixed(1000 * s, 0) }) : t("{time} s ago", { time: fixed(s, 1) }));

// A hand that is open, or opens, presses nothing: it has no force to show.
export const handState = (doc) => (doc.hand?.open ? "hand open" : doc.hand?.opening ? "hand opens" : "");

// No line ends between a number and its unit.
export const joined = (text) => text.replace(/(\d) (?=(?:N|N\/mm|mm|%|s)(?:[ ,;]|$))/g, "$1\u00a0");

// What the verdict rests on, in pieces.
export const whys = (doc) => pieces(doc).map(joined);

function pieces(doc) {
  const said = doc.verdict, parts = [];
  if ("target_force_n" in said && doc.item) parts.push(doc.item);
  if (said.why) parts.push(said.why);
  if (said.on_target === true) parts.push(t("on the target of {force} N", { force: number(said.target_force_n) }));
  if (said.on_target === false) parts.push(t("{where} the target of {force} N", { where: doc.measured.values.force_n?.high < said.target_force_n ? "below" : "above", force: number(said.target_force_n) }));
  if (said.kind === "idle") parts.push(...doc.idle);
  // The rest is of a grasp: other headlines, such as a calibration's, are not.
  if (!("target_force_n" in said)) return parts;
  if (doc.measured.decided && doc.measured.decision_time_s !== null) parts.push(t("answer {time} s after contact", { time: fixed(doc.measured.decision_time_s, 1) }));
  if (doc.measured.limited) parts.push("the damage limit keeps it below its target");
  parts.push(...doc.measured.faults);
  return parts;
}

// A sensor alone: there is no hand to stop, only what runs.
export const isAlone = (doc) => doc.source !== null && doc.hand === null && doc.grasp === null;

function drawHead(doc) {
  document.body.classList.toggle("alone", isAlone(doc));
  const pill = $("link"), link = doc.link, replayed = doc.source && doc.source.replayed;
  const rate = link.rate_hz === null ? "–" : `${fixed(link.rate_hz, link.rate_hz < 100 ? 1 : 0)} Hz`;
  // It was that old when it was sent; since then at most the whole way there and back has passed.
  const age = link.age_s === null ? "no frame yet" : t("last frame {ago}", { ago: sinceFrame(link.age_s + (performance.now() - seen.askedAt) / 1000) });
  pill.dataset.state = link.stale ? "stale" : link.waiting ? "waiting" : "fresh";
  const counted = [link.stale ? "NO FRAMES" : "", rate, t("{lost} lost", link), link.corrupt ? t("{corrupt} corrupt", link) : ""].filter(Boolean).join(" · ");
  const counts = !replayed && !link.waiting;
  $("link-text").textContent = counts ? counted : replayed ? "replay" : doc.activity;
  $("link-age").textContent = counts ? age : "";
  pill.title = t("{frames} frames, {lost} lost, {corrupt} corrupt, {late} late; 99 % within {p99} ms of the one before", { ...link, p99: fixed(1000 * link.period_p99_s, 1) });
  say($("link-state"), replayed ? "replay" : link.stale ? "no frames" : link.waiting ? doc.activity : "frames arrive");
  $("rig-name").textContent = !doc.source ? "no rig" : replayed ? t("replay of {name}", { name: doc.source.name }) : doc.source.name;
  $("simulated").classList.toggle("hidden", !(doc.source && doc.source.simulated));
  $("trouble").classList.toggle("hidden", !doc.trouble);
  say($("trouble-text"), doc.trouble);
}

// Presses travel by the framework's socket, which can be away while answers still come.
function awayMs() {
  if (window.socket?.connected) {
    // Soon back: by itself it may wait for seven seconds although the server answers again.
    if (seen.socketAt === Infinity) window.socket.io.reconnectionDelay(RETRY_MS).reconnectionDelayMax(2 * RETRY_MS);
    Object.assign(seen, { socketAt: performance.now(), vain: false });
    return 0;
  }
  return performance.now() - seen.socketAt;
}

// Everything on the stage is old once the server, or the process behind it, says nothing more.
function drawLoss(onLost) {
  const pill = $("link"), box = $("lost");
  if (!pill || !box) return;
  const silentMs = performance.now() - seen.at, server = silentMs > LOST_MS, devices = seen.hungS !== null;
  const unsentMs = awayMs(), unsent = unsentMs > LOST_MS || (seen.vain && unsentMs > 0);
  const lost = server || devices || unsent, agoS = Math.max((server ? silentMs / 1000 : 0) + (seen.hungS ?? 0), unsent ? unsentMs / 1000 : 0);
  if (lost && !document.body.classList.contains("lost")) onLost();
  document.body.classList.toggle("lost", lost);
  // What is greyed is reported as unavailable too.
  for (const part of document.querySelectorAll(GREYED)) if (lost) part.ariaDisabled = "true"; else part.removeAttribute("aria-disabled");
  box.classList.toggle("hidden", !lost);
  if (!lost) return;
  const ago = agoS < 60 ? t("last seen {time} s ago", { time: Math.floor(agoS) }) : t("last seen {time} min ago", { time: Math.floor(agoS / 60) });
  headline(box, $("lost-title"), server || unsent ? "No connection" : "The devices do not respond");
  const why = server ? "palpate serve does not answer." : unsent ? "Only STOP can be sent; the page connects again by itself." : "";
  const old = server || devices ? "The values shown are old; the hand may still move or hold." : "";
  $("lost-why").textContent = [`${ago}.`, why, old].filter(Boolean).join(" ");
  pill.dataset.state = "stale";
  $("link-age").textContent = "";
  $("link-text").textContent = `${server || unsent ? "NO CONNECTION" : "NO DEVICE DATA"} · ${ago}`;
}

function take(doc, began) {
  if (doc.generation !== seen.generation) Object.assign(seen, { generation: doc.generation, curve: [], band: [], pixels: [] });
  const after = (points) => ([time]) => !points.length || time > points[points.length - 1][0];
  seen.curve.push(...doc.curve.filter(after(seen.curve)));
  seen.band.push(...doc.band.filter(after(seen.band)));
  forget(seen.curve, 4500, (point) => point[0], doc.frozen_s);
  if (seen.band.length > 900) seen.band.splice(0, seen.band.length - 900);
  if (!seen.pixels.length) seen.pixels.push(...doc.past);
  keepPixels(doc);
  forget(seen.pixels, 1400, (one) => one.time_s, doc.frozen_s);
  Object.assign(seen, { at: performance.now(), hungS: doc.link.hung_s, stops: doc.stops, serverS: doc.server_s, askedAt: began });
}

// The pads and the hand as they were, in order of time: a replay may go back.
function keepPixels({ pixels, hand }) {
  if (!pixels || pixels.time_s === null) return;
  const at = seen.pixels.findLastIndex((p) => p.time_s <= pixels.time_s);
  if (seen.pixels[at]?.time_s !== pixels.time_s) seen.pixels.splice(at + 1, 0, { ...pixels, hand });
}

// What is watched is kept for a while; the grasp that ended before it until the next one.
function forget(kept, most, timeOf, frozenS) {
  const from = frozenS === null ? 0 : kept.findLastIndex((one) => timeOf(one) <= frozenS) + 1;
  if (kept.length - from > most) kept.splice(from, kept.length - from - most);
}

let asked = 0, taken = 0, next = 0;

async function tick(draw, onLost) {
  const began = performance.now(), number = (asked += 1);
  // A network that went away unnoticed never answers: the next one does not wait for it to be given up.
  next = setTimeout(tick, BESIDE_MS, draw, onLost);
  try {
    const last = seen.curve.length ? seen.curve[seen.curve.length - 1][0] : -1e9;
    const reply = await fetch(`/live?generation=${seen.generation}&after_s=${last}`, { cache: "no-store", signal: AbortSignal.timeout(GIVEN_UP_MS) });
    const doc = await reply.json();
    if (number > taken) {
      taken = number;
      take(doc, began);
      if ($("link") && $("verdict")) {
        drawHead(doc);
        draw(doc);
        document.body.dataset.activity = doc.activity;
        document.body.dataset.recording = doc.recording ?? "";
        document.body.dataset.drawn = seen.drawn += 1;
        drawLoss(onLost);
      }
    }
  } catch {
    // drawLoss says how long nothing came.
  }
  if (number < asked) return;
  clearTimeout(next);
  next = setTimeout(tick, Math.max(10, PERIOD_MS - (performance.now() - began)), draw, onLost);
}

// Before the press itself, on the same way: what a stop overtakes must not begin after it, nor what
// comes so late that nobody expects it any more (by the server's clock).
function pressed(press) {
  if (awayMs() > 0 && !press.target.closest("#stop, a")) {
    // It would be kept, and the hand would move at some later moment.
    press.stopImmediatePropagation();
    press.preventDefault();
    seen.vain = true;
    return;
  }
  const atS = seen.serverS === null ? null : seen.serverS + (performance.now() - seen.askedAt) / 1000;
  window.emitEvent?.("press", { stops: seen.stops, at_s: atS });
}

// A scanner types wherever the focus is, a shift long without a mouse: what is typed outside of a field
// is the next item's name, in place of the one before. F8 grasps, F9 releases.
function typed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const button = { F8: "grasp", F9: "release" }[event.key], field = document.querySelector("input.scanned");
  if (button) {
    event.preventDefault();
    $(button)?.click();
  } else if (field && !field.disabled && event.key.length === 1 && !(event.key === " " && event.target.closest("button, a, [tabindex]")) && !event.target.closest("input, textarea, select, [role=slider]:not(.plot), [role=dialog], [contenteditable]")) {
    field.focus();
    field.select();
  }
}

export function follow(draw, onLost = () => {}) {
  // The framework's own words of a lost socket lie outside of all landmarks, unless they are an alert.
  $("popup")?.setAttribute("role", "alert");
  setInterval(drawLoss, LOOK_MS, onLost);
  window.addEventListener("click", pressed, true);
  window.addEventListener("keydown", typed, true);
  tick(draw, onLost);
}
