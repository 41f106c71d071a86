// Asks for what is new, has it drawn, and asks again: a slow screen asks less often and holds up
// nobody. Draws itself what every view has: the head, and the loss of the connection.
const PERIOD_MS = 66, SILENT_MS = 1000, LOST_MS = 1000, LOOK_MS = 100;
export const $ = (id) => document.getElementById(id);
export const esc = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
export const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−"));
export const seen = { generation: -1, curve: [], band: [], at: performance.now(), hungS: null, drawn: 0 };
// A screen reader speaks of what is written: nothing is, unless it changed.
export const say = (element, text) => { if (element && element.textContent !== text) element.textContent = text; };

// What the verdict rests on, in pieces.
export function whys(doc) {
  const said = doc.verdict, parts = [];
  if (said.why) parts.push(said.why);
  if (said.on_target === true) parts.push(`target ${said.target_force_n} N within the interval`);
  if (said.on_target === false) parts.push(`off the target of ${said.target_force_n} N`);
  if (doc.measured.decided && doc.measured.decision_time_s !== null) parts.push(`answer ${fixed(doc.measured.decision_time_s, 1)} s after contact`);
  if (doc.stopped_after_s !== null) parts.push(`stopped ${fixed(1000 * doc.stopped_after_s, 0)} ms after the request`);
  if (doc.measured.limited) parts.push("the damage limit keeps it below its target");
  parts.push(...doc.measured.faults);
  if (doc.measured.damaged) parts.unshift("the object was damaged");
  return parts;
}

function drawHead(doc) {
  const pill = $("link"), link = doc.link, replayed = doc.source && doc.source.replayed;
  const rate = link.rate_hz === null ? "–" : `${fixed(link.rate_hz, link.rate_hz < 100 ? 1 : 0)} Hz`;
  const age = link.age_s === null ? "no frame yet" : link.age_s < 1 ? `${fixed(1000 * link.age_s, 0)} ms ago` : `${fixed(link.age_s, 1)} s ago`;
  pill.dataset.state = link.stale ? "stale" : link.waiting ? "waiting" : "fresh";
  $("link-text").textContent = replayed ? "replay" : link.waiting ? doc.activity : `${link.stale ? "NO FRAMES · " : ""}${rate} · ${link.lost} lost${link.corrupt ? ` · ${link.corrupt} corrupt` : ""} · last frame ${age}`;
  pill.title = `${link.frames} frames, ${link.lost} lost, ${link.corrupt} corrupt, ${link.late} late; 99 % within ${fixed(1000 * link.period_p99_s, 1)} ms of the one before`;
  say($("link-state"), replayed ? "replay" : link.stale ? "no frames" : link.waiting ? doc.activity : "frames come");
  $("rig-name").textContent = doc.source ? `${replayed ? "replay of " : ""}${doc.source.name}` : "no rig";
  $("simulated").classList.toggle("hidden", !(doc.source && doc.source.simulated));
  $("trouble").classList.toggle("hidden", !doc.trouble);
  say($("trouble-text"), doc.trouble);
}

// Everything on the stage is old once the server, or the process behind it, says nothing more.
function drawLoss() {
  const pill = $("link"), box = $("lost");
  if (!pill || !box) return;
  const silentMs = performance.now() - seen.at, server = silentMs > LOST_MS, devices = seen.hungS !== null;
  const lost = server || devices, agoS = (server ? silentMs / 1000 : 0) + (seen.hungS ?? 0);
  document.body.classList.toggle("lost", lost);
  box.classList.toggle("hidden", !lost);
  if (!lost) return;
  const ago = `last seen ${agoS < 60 ? `${Math.floor(agoS)} s` : `${Math.floor(agoS / 60)} min`} ago`;
  say($("lost-title"), server ? "No connection" : "The devices are silent");
  $("lost-why").textContent = `${ago}. ${server ? "palpate serve does not answer. " : ""}What is shown is old; the hand may still move or hold.`;
  pill.dataset.state = "stale";
  $("link-text").textContent = `${server ? "NO CONNECTION" : "DEVICES SILENT"} · ${ago}`;
}

async function tick(draw) {
  const began = performance.now();
  try {
    const last = seen.curve.length ? seen.curve[seen.curve.length - 1][0] : -1e9;
    const reply = await fetch(`/live?generation=${seen.generation}&after_s=${last}`, { cache: "no-store", signal: AbortSignal.timeout(SILENT_MS) });
    const doc = await reply.json();
    if (doc.generation !== seen.generation) Object.assign(seen, { generation: doc.generation, curve: [], band: [] });
    seen.curve.push(...doc.curve);
    const newest = seen.band.length ? seen.band[seen.band.length - 1][0] : -1e9;
    seen.band.push(...doc.band.filter((b) => b[0] > newest));
    if (seen.curve.length > 4500) seen.curve.splice(0, seen.curve.length - 4500);
    if (seen.band.length > 900) seen.band.splice(0, seen.band.length - 900);
    Object.assign(seen, { at: performance.now(), hungS: doc.link.hung_s });
    if ($("link") && $("verdict")) {
      drawHead(doc);
      draw(doc);
      document.body.dataset.activity = doc.activity;
      document.body.dataset.recording = doc.recording ?? "";
      document.body.dataset.drawn = seen.drawn += 1;
      drawLoss();
    }
  } catch {
    // drawLoss says how long nothing came.
  }
  setTimeout(tick, Math.max(10, PERIOD_MS - (performance.now() - began)), draw);
}

export function follow(draw) {
  setInterval(drawLoss, LOOK_MS);
  tick(draw);
}
