// The timeline of a replay: phases, and controls for pause, position and speed.
import { $, esc } from "/static/poll.js";
import { fixed, t } from "/static/words.js";

const RELEASE_DELAY_MS = 400, SEND_MS = 80;
let touched = -Infinity, sent = -Infinity, later = 0, paused = false, drawn = null;

const emit = (name, value) => window.emitEvent(name, value);

// Limits the rate of messages while the slider is dragged.
function seek(time) {
  clearTimeout(later);
  const wait = sent + SEND_MS - performance.now();
  if (wait > 0) { later = setTimeout(seek, wait, time); return; }
  sent = performance.now();
  emit("seek", time);
}

export function begin() {
  document.addEventListener("input", (event) => {
    if (event.target.id !== "seek") return;
    touched = performance.now();
    seek(+event.target.value);
  });
  document.addEventListener("change", (event) => {
    if (event.target.id === "pace") { touched = performance.now(); emit("speed", +event.target.value); }
  });
  document.addEventListener("click", (event) => {
    if (event.target.id === "play") emit("pause", !paused);
    if (event.target.closest?.("#back, #confirm")) emit("confirm");
  });
}

function drawPhases(replay) {
  const key = `${replay.start_s}/${replay.end_s}/${replay.phases.length}`;
  if (drawn === key && $("phases").firstChild) return;
  drawn = key;
  const length = replay.end_s - replay.start_s || 1, fraction = (time) => (time - replay.start_s) / length;
  let bars = "", names = "";
  replay.phases.forEach(([from, name], i) => {
    const to = i + 1 < replay.phases.length ? replay.phases[i + 1][0] : replay.end_s, width = fraction(to) - fraction(from);
    bars += `<rect class="phase" x="${1000 * fraction(from)}" width="${1000 * width}" y="0" height="30" data-odd="${i % 2}"/>`;
    if (width > 0.12) names += `<span style="left:${100 * fraction(from)}%;width:${100 * width}%">${esc(name)}</span>`;
  });
  for (const [time, name] of replay.grasp ? replay.grasp.moments : []) if (name === "contact" || name === "answer") bars += `<rect x="${1000 * fraction(time) - 1}" width="2.5" y="0" height="30" fill="var(--accent)"><title>${name}</title></rect>`;
  $("phases").innerHTML = bars;
  $("phase-names").innerHTML = names;
}

export function drawTimeline(doc) {
  const box = $("timeline"), replay = doc.replay;
  if (!box) return;
  box.classList.toggle("hidden", !replay);
  if (!replay) return;
  drawPhases(replay);
  paused = replay.paused;
  $("play").textContent = paused ? (replay.time_s >= replay.end_s ? "Again" : "Play") : "Pause";
  const slider = $("seek");
  slider.min = replay.start_s;
  slider.max = replay.end_s;
  if (performance.now() - touched > RELEASE_DELAY_MS) {
    slider.value = replay.time_s;
    $("pace").value = String(replay.speed);
  }
  const at = replay.time_s - replay.start_s, total = replay.end_s - replay.start_s;
  const now = replay.phases.filter(([from]) => from <= replay.time_s).pop();
  slider.setAttribute("aria-valuetext", [t("{time} of {total} seconds", { time: fixed(at, 1), total: fixed(total, 1) }), ...(now ? [now[1]] : [])].join(", "));
  $("played").textContent = `${fixed(at, 1)} / ${fixed(total, 1)} s`;
}
