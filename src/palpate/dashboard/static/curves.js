// Force and reading over time, on one time axis that counts from the contact.
import { $, handState, seen } from "/static/poll.js";
import { keptAt, zeroOf } from "/static/compare.js";
import { fixed, range, t } from "/static/words.js";

// A grasp that ended stays in sight whole, from before its contact to after its release.
const WINDOW_S = 30, BEFORE_S = 2, AFTER_S = 3, POINTS = 400;
// A pixel that comes loose reads a hundred times its rest value: it must not flatten everything else.
const HIGHEST = 100;
const BOX = { l: 46, r: 12, t: 18, b: 26 };
const NAMES = { contact: "contact", answer: "answer", adjusted: "adjusted", damage_limit: "limit met", slipped: "slipped", stopped: "stopped", force_limit: "force limit", held: "released" };
let pointed = null;

function ticks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let value = Math.ceil(low / step - 1e-9) * step; value <= high + 1e-9 * step; value += step) found.push(value);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

// What both curves share: the window of time, and what happened in it.
function shared(doc) {
  const newest = seen.curve.length ? seen.curve[seen.curve.length - 1][0] : 0, first = seen.curve.length ? seen.curve[0][0] : 0;
  const grasp = doc.replay ? doc.replay.grasp : doc.grasp, zero = zeroOf(doc);
  const touched = Boolean(grasp && grasp.touched_s !== null), kept = keptAt(zero, touched);
  const until = !doc.replay && doc.activity === "watching" && touched && grasp.moments.length ? grasp.moments.at(-1)[0] + AFTER_S : null;
  const last = until === null ? newest : Math.min(newest, until);
  const start = doc.replay ? Math.min(first, kept[0]?.[0] ?? first) : Math.max(first, until === null ? newest - WINDOW_S : zero - BEFORE_S);
  const end = doc.replay ? Math.max(last, kept.at(-1)?.[0] ?? last) : (until ?? Math.max(last, start + WINDOW_S));
  const all = seen.curve.filter(([time]) => time >= start && time <= last), every = Math.max(1, Math.ceil(all.length / POINTS));
  // Every so many by their number in time, so that a curve does not shimmer as it moves.
  const curve = all.filter(([time], i) => i === all.length - 1 || Math.round(time * 50) % every === 0);
  const moments = (grasp ? grasp.moments : []).filter(([time]) => time >= start);
  const now = doc.replay ? doc.replay.time_s : last;
  return { last, zero, start, end, curve, moments, now, replay: Boolean(doc.replay), newtons: Boolean(doc.source?.newtons), hand: handState(doc), touched, kept: kept.filter(([time]) => time >= start && time <= end), bounds: grasp ? grasp.bounds : {}, moves: doc.moves.filter(([, to]) => (to ?? last) >= start), band: seen.band.filter(([time]) => time >= start) };
}

// A large screen is looked at from further away.
const LARGE = matchMedia("(min-width: 1800px) and (min-height: 1000px)"), zoom = () => (LARGE.matches ? 1.35 : 1);

function canvas(svg, view, [low, high]) {
  const width = (svg.clientWidth || 400) / zoom(), height = (svg.clientHeight || 240) / zoom();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const x = (time) => BOX.l + ((time - view.start) / (view.end - view.start)) * (width - BOX.l - BOX.r);
  const y = (v) => BOX.t + ((high - v) / (high - low)) * (height - BOX.t - BOX.b);
  return { width, height, x, y, low, high, clip: `clip-${svg.id}`, line: (points) => points.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join(" ") };
}

function ground(c, view) {
  const bottom = c.height - BOX.b, right = c.width - BOX.r;
  let out = `<clipPath id="${c.clip}"><rect x="${BOX.l}" y="${BOX.t}" width="${right - BOX.l}" height="${bottom - BOX.t}"/></clipPath>`;
  for (const [from, to] of view.moves) {
    const left = c.x(Math.max(from, view.start));
    out += `<rect class="move" x="${left}" y="${BOX.t}" width="${Math.max(1.5, c.x(to ?? view.last) - left)}" height="${bottom - BOX.t}"/>`;
  }
  const [values, digits] = ticks(c.low, c.high, 4);
  for (const value of values) out += `<line class="grid" x1="${BOX.l}" x2="${right}" y1="${c.y(value)}" y2="${c.y(value)}"/><text class="soft" x="${BOX.l - 7}" y="${c.y(value) + 4}" text-anchor="end" font-size="12">${fixed(value, digits)}</text>`;
  for (const value of ticks(view.start - view.zero, view.end - view.zero, c.width < 500 ? 4 : 8)[0]) out += `<text class="soft" x="${c.x(value + view.zero)}" y="${c.height - 8}" text-anchor="middle" font-size="12">${fixed(value, 0)} s</text>`;
  return out + happened(c, view);
}

// What the controller noted, and nothing that the page found out by itself.
function happened(c, view) {
  let out = "", free = -Infinity;
  for (const [time, name, finger] of view.moments) {
    const at = c.x(time);
    if (finger !== null) {
      if (name.startsWith("finger_")) out += `<path class="mark" data-name="${name}" d="M${at} ${c.height - BOX.b}l-4 6h8z"><title>${t("finger {n}", { n: finger })}: ${name === "finger_contact" ? "contact" : "removal"}</title></path>`;
      continue;
    }
    if (!NAMES[name]) continue;
    out += `<line class="mark" data-name="${name}" x1="${at}" x2="${at}" y1="${BOX.t}" y2="${c.height - BOX.b}"/>`;
    const width = 6.4 * NAMES[name].length, left = at > c.width - 60, right = at < BOX.l + 20;
    const from = left ? at - width : right ? at : at - width / 2, fits = from > free;
    if (fits) out += `<text class="soft" x="${at + (left ? -2 : 0)}" y="${BOX.t - 5}" font-size="11" text-anchor="${left ? "end" : right ? "start" : "middle"}">${NAMES[name]}</text>`;
    if (fits) free = from + width + 6;
  }
  return out;
}

// The band, and its words: they are drawn over all else.
function forecast(c, view, id, [low, value, high], digits, unit, lines) {
  const band = view.band.filter((b) => b[high] !== undefined);
  if (!band.length) return ["", ""];
  // It speaks of the hold: a movement after the last forecast ends it.
  const last = band[band.length - 1], after = view.moves.find(([from]) => from > last[0]), until = Math.max(after ? after[0] : view.last, last[0]);
  const now = band.filter((b) => b[0] <= view.now).pop() ?? band[0];
  const shown = [...band, Object.assign([...last], { 0: until })], settles = `${"settles at"} ${fixed(now[value], digits)} ${unit}`;
  const outline = [...shown.map((b) => [b[0], b[high]]), ...[...shown].reverse().map((b) => [b[0], b[low]])];
  const above = Math.min(...shown.map((b) => c.y(b[high]))) - 8, below = Math.max(...shown.map((b) => c.y(b[low]))) + 18;
  const [words, left, base] = place(c, [`${settles} ${range(now[low], now[high], digits)}`, settles], c.x(until) + 10, above, below, lines);
  return [`<g clip-path="url(#${c.clip})"><polygon id="${id}" data-half-width="${(now[high] - now[low]) / 2}" data-count="${seen.band.length}" points="${c.line(outline)}" fill="var(--band)" opacity="0.28"/>
    <polyline points="${c.line(shown.map((b) => [b[0], b[value]]))}" fill="none" stroke="var(--band)" stroke-width="2.5" stroke-dasharray="7 5"/></g>`,
    `<text class="settles" id="${id}-settles" x="${left}" y="${base}" font-size="13">${words}</text>`];
}

// Points with a value, in stretches: what has none between them is a gap.
function stretches(points, column) {
  const found = [[]];
  for (const p of points) if (p[column] !== undefined) found[found.length - 1].push(p); else if (found[found.length - 1].length) found.push([]);
  return found.filter((one) => one.length);
}

// The lines of readings, as they are on the screen.
function drawn(c, view, column) {
  return [view.curve, view.kept].map((points) => points.filter((p) => p[column] !== undefined).map((p) => [c.x(p[0]), c.y(p[column])]));
}

// Words near the band, the longest for which there is a place that no line runs through.
function place(c, choices, after, above, below, lines) {
  const top = BOX.t + 14, bottom = c.height - BOX.b - 6;
  const crossed = (left, width, base) => lines.some((line) => line.some(([x, y], i) => {
    const [fromX, fromY] = line[Math.max(0, i - 1)];
    return x > left - 4 && fromX < left + width + 4 && Math.max(y, fromY) > base - 14 && Math.min(y, fromY) < base + 5;
  }));
  const places = choices.flatMap((words) => {
    const width = 7.4 * words.length, right = c.width - BOX.r - width;
    return [after, right, BOX.l + 6].flatMap((left) => [above, below, top, bottom].map((base) => [words, Math.min(left, right), Math.min(Math.max(base, top), bottom), width]));
  });
  return places.find(([, left, base, width]) => !crossed(left, width, base)) ?? places[0];
}

// Of another recording, under the one that is shown.
function compared(c, view, column) {
  return stretches(view.kept, column).map((points) => `<polyline class="kept" clip-path="url(#${c.clip})" points="${c.line(points.map((p) => [p[0], p[column]]))}"/>`).join("");
}

// Whether another level runs where the words of this one would be: they go below its own line.
const crowded = (c, { value }, levels) => levels.some((one) => one.value > value && c.y(value) - c.y(one.value) < 18);

// A line over all of the curve, and its words: at its left end, or its right.
function level(c, one, levels) {
  const { value, name, kind, right } = one, beyond = value > c.high, at = beyond ? BOX.t + 1 : c.y(value), from = right ? `x="${c.width - BOX.r - 4}" text-anchor="end"` : `x="${BOX.l + 6}"`;
  return [`<line class="level ${kind}" data-value="${value}" x1="${BOX.l}" x2="${c.width - BOX.r}" y1="${at}" y2="${at}" ${beyond ? 'opacity="0"' : ""}/>`, `<text class="level ${kind}" ${from} y="${beyond ? BOX.t + 12 : crowded(c, one, levels) ? at + 14 : at - 5}" font-size="12">${name} ${fixed(value, 1)} N${beyond ? " ↑" : ""}</text>`];
}

// A level with its words, as lines that no other words may cross.
function levelLines(c, one, levels) {
  const { value, right } = one, at = c.y(Math.min(value, c.high)), words = crowded(c, one, levels) ? at + 18 : at - 18, [begins, ends] = right ? [c.width - BOX.r - 140, c.width] : [BOX.l, BOX.l + 130];
  return [[[BOX.l, at], [c.width, at]], [[begins, words], [ends, words]]];
}

function ending(c, view, column) {
  const lines = stretches(view.curve, column).map((points) => points.map((p) => [p[0], p[column]])), points = lines.flat();
  if (!points.length) return "";
  const past = view.replay ? `<rect class="future" x="${c.x(view.now)}" y="${BOX.t}" width="${Math.max(0, c.x(view.end) - c.x(view.now))}" height="${c.height - BOX.t - BOX.b}"/>` : "";
  const at = atNow(view, column);
  const dot = at ? `<circle cx="${c.x(at[0])}" cy="${Math.max(BOX.t, c.y(at[column]))}" r="4" fill="var(--curve)"/>` : "";
  return `${lines.map((one) => `<polyline clip-path="url(#${c.clip})" points="${c.line(one)}" fill="none" stroke="var(--curve)" stroke-width="2" stroke-linejoin="round"/>`).join("")}${past}${dot}`;
}

const nearest = (points, time) => points.reduce((best, p) => (Math.abs(p[0] - time) < Math.abs(best[0] - time) ? p : best), points[0]);

// The point of this moment; nothing where it has no value.
function atNow(view, column) {
  const one = view.curve.length ? nearest(view.curve, view.now) : null;
  return one && one[column] !== undefined ? one : null;
}

// -- readings under the pointer ----------------------------------------------------------------------
function reading(c, view, svg, column, words) {
  const out = $(`${svg.id}-at`), points = view.curve.filter((p) => p[column] !== undefined);
  const time = pointed === null ? null : view.start + ((pointed - BOX.l) / (c.width - BOX.l - BOX.r)) * (view.end - view.start);
  const inside = points.length > 0 && time !== null && time >= view.start && time <= view.last + 0.5;
  const one = inside ? nearest(points, time) : atNow(view, column);
  out.classList.toggle("pointed", inside);
  if (!one) { out.textContent = view.hand; return ""; }
  const other = inside ? view.kept.filter((p) => p[column] !== undefined) : [];
  const keptReading = other.length ? ` · ${"kept"} ${words(nearest(other, one[0]))}` : "";
  out.textContent = inside ? `${fixed(one[0] - view.zero, 1)} s: ${words(one)}${keptReading}` : words(one);
  return inside ? `<line class="cross" x1="${c.x(one[0])}" x2="${c.x(one[0])}" y1="${BOX.t}" y2="${c.height - BOX.b}"/><circle cx="${c.x(one[0])}" cy="${c.y(one[column])}" r="5" fill="none" stroke="var(--ink)" stroke-width="2"/>` : "";
}

export function begin() {
  document.addEventListener("pointermove", (event) => {
    const svg = event.target.closest?.("#force, #curve");
    pointed = svg ? (event.clientX - svg.getBoundingClientRect().left) / zoom() : null;
  });
}

// -- the two -----------------------------------------------------------------------------------------
function drawForce(view) {
  const svg = $("force");
  if (!svg) return;
  const values = view.curve.filter((p) => p[3] !== undefined), settled = view.band.filter((b) => b[6] !== undefined).map((b) => b[6]);
  $("force-card").classList.toggle("hidden", !view.newtons);
  if (!view.newtons) return;
  const highest = Math.max(1, ...values.map((p) => p[3]), ...view.kept.map((p) => p[3] ?? 0), ...settled);
  const { target_n: target, damage_low_n: damage, ceiling_n: ceiling } = view.bounds, known = (value) => value !== null && value !== undefined;
  const levels = [{ value: target, name: "target", kind: "target" }, known(damage) ? { value: damage, name: "damage limit", kind: "limit", right: true } : { value: ceiling < 2.5 * highest ? ceiling : null, name: "ceiling", kind: "limit", right: true }].filter((one) => known(one.value));
  const limits = [target, damage].filter((value) => known(value) && value < 2.5 * highest);
  const c = canvas(svg, view, [0, 1.15 * Math.max(highest, ...limits, ...values.map((p) => Math.min(p[4], 1.5 * p[3])))]);
  const intervals = stretches(view.curve, 3).map((one) => `<polygon clip-path="url(#${c.clip})" points="${c.line([...one.map((p) => [p[0], p[4]]), ...[...one].reverse().map((p) => [p[0], p[2]])])}"/>`);
  const lines = [...drawn(c, view, 3), ...levels.flatMap((one) => levelLines(c, one, levels))];
  const [band, settles] = forecast(c, view, "force-band", [4, 5, 6], 2, "N", lines), drawnLevels = levels.map((one) => level(c, one, levels));
  svg.innerHTML = `${ground(c, view)}<g id="force-interval" fill="var(--curve)" opacity="0.16">${intervals.join("")}</g>${compared(c, view, 3)}${band}${drawnLevels.map(([line]) => line).join("")}${ending(c, view, 3)}${settles}${drawnLevels.map(([, words]) => words).join("")}${reading(c, view, svg, 3, (p) => `${fixed(p[3], 2)} N ${range(p[2], p[4], 2)}`)}`;
}

function drawReading(view) {
  const svg = $("curve");
  if (!svg) return;
  const capped = { ...view, curve: view.curve.map((p) => (p[1] > HIGHEST ? Object.assign([...p], { 1: HIGHEST }) : p)) };
  const values = capped.curve.length ? [...capped.curve.map((p) => p[1]), ...view.kept.map((p) => Math.min(p[1], HIGHEST)), ...view.band.flatMap((b) => [b[1], b[3]])] : [0];
  // Never closer than this: noise must not look like a signal.
  const middle = (Math.max(...values) + Math.min(...values)) / 2, half = Math.max(4, 0.56 * (Math.max(...values) - Math.min(...values)));
  const c = canvas(svg, view, [middle - half, middle + half]);
  const [band, settles] = forecast(c, view, "band", [1, 2, 3], 1, "%", drawn(c, capped, 1));
  svg.innerHTML = `${ground(c, view)}${compared(c, view, 1)}${band}${ending(c, capped, 1)}${settles}${reading(c, capped, svg, 1, (p) => `${fixed(p[1], 1)} %`)}`;
}

export function drawCurves(doc) {
  const view = shared(doc);
  drawForce(view);
  drawReading(view);
  const counts = view.touched ? "s from contact" : "";
  for (const one of document.querySelectorAll(".counts")) if (one.textContent !== counts) one.textContent = counts;
}
