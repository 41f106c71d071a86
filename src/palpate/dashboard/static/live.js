// The whole page: both fingers, the curve, the verdict and what was measured.
import { $, esc, fixed, follow, say, seen, whys } from "/static/follow.js";

const WINDOW_S = 30, DEEPEST = 80;
// A pixel that comes loose reads a hundred times its rest value: it must not flatten everything else.
const HIGHEST = 100;
const RAMP = [[20, 18, 46], [101, 21, 110], [212, 72, 66], [250, 193, 39], [252, 255, 164]];
const UNITS = { size_mm: ["Size", "mm", 1], force_n: ["Grip force", "N", 2], stiffness_n_per_mm: ["Stiffness", "N/mm", 2], settled_percent: ["Settled at 20 s", "%", 1] };
const STATUS = { too_short: "short hold", not_settling: "not settling", saturated: "outside range", fell_back: "fell back" };

function color(percent) {
  const place = Math.min(Math.max(-percent / DEEPEST, 0), 1) * (RAMP.length - 1);
  const below = Math.min(Math.floor(place), RAMP.length - 2);
  const rgb = RAMP[below].map((c, i) => Math.round(c + (place - below) * (RAMP[below + 1][i] - c)));
  const bright = 0.3 * rgb[0] + 0.6 * rgb[1] + 0.1 * rgb[2] > 120;
  return [`rgb(${rgb})`, bright ? "#111" : "#fff"];
}

// -- two fingers, seen from between them: each pad faces the reader --------------------------------
function pad(x, finger, pixels, touching) {
  const rows = pixels.finger_of_row.map((f, row) => [f, row]).filter(([f]) => f === finger).map(([, row]) => row);
  const cols = pixels.percent[0].length, gap = rows.length > 6 ? 1 : 4;
  const width = (138 - gap * (cols - 1)) / cols, height = (164 - gap * (rows.length - 1)) / rows.length;
  let out = `<rect x="${x}" y="26" width="158" height="184" rx="16" fill="var(--pad)" stroke="${touching ? "var(--accent)" : "var(--metal)"}" stroke-width="${touching ? 5 : 2}"/>`;
  rows.forEach((row, i) => {
    for (let col = 0; col < cols; col += 1) {
      const value = pixels.percent[row][col], left = x + 10 + col * (width + gap), top = 36 + i * (height + gap);
      const [fill, ink] = value === null ? ["none", "#fff"] : color(value);
      const words = value === null ? (pixels.ohm[row][col] === null ? "open" : "dead") : `${fixed(value, 0)}`;
      out += `<g><title>R${row} C${col}: ${pixels.ohm[row][col] === null ? "open" : `${fixed(pixels.ohm[row][col], 0)} ohm`}</title>
        <rect class="pixel" data-row="${row}" data-col="${col}" x="${left}" y="${top}" width="${width}" height="${height}" rx="${gap > 1 ? 6 : 0}" fill="${fill}" stroke="${value === null ? "#ff6b6b" : "none"}" stroke-dasharray="4 3"/>
        ${width > 24 && height > 14 ? `<text x="${left + width / 2}" y="${top + height / 2 + 5}" text-anchor="middle" font-size="${Math.min(17, height * 0.5)}" style="fill:${ink}">${words}</text>` : ""}</g>`;
    }
  });
  return out;
}

function object(middle, gap, scale, doc) {
  const size = doc.measured.values.size_mm, outcome = doc.verdict.text;
  if (outcome.startsWith("nothing there")) return "";
  const known = size && size.value > 0 && scale > 0;
  const across = known ? size.value * scale : Math.min(gap * 0.62, 120);
  const name = doc.source.subject ? doc.source.subject.replace(/-/g, " ") : "unknown";
  return `<ellipse cx="${middle}" cy="118" rx="${across / 2}" ry="${Math.min(across / 2, 86)}" fill="var(--accent)" fill-opacity="${known ? 0.22 : 0.08}" stroke="var(--accent)" stroke-width="2" ${known ? "" : 'stroke-dasharray="7 6"'}/>
    ${across > 70 ? `<text x="${middle}" y="116" text-anchor="middle" font-size="17" font-weight="600">${known ? `${fixed(size.value, 1)} mm` : "?"}</text>
    <text class="soft" x="${middle}" y="136" text-anchor="middle" font-size="${name.length > 14 ? 11 : 13}">${esc(name)}</text>` : ""}`;
}

function drawFingers(doc) {
  const svg = $("fingers");
  if (!svg) return;
  if (!doc.pixels) { svg.innerHTML = `<text class="soft" x="400" y="120" text-anchor="middle" font-size="17">${esc(doc.activity)} …</text>`; return; }
  const hand = doc.hand, fingers = [...new Set(doc.pixels.finger_of_row)], scale = hand && hand.drive === "width" ? 4.1 : 0;
  const gap = !hand || hand.value === null ? 220 : scale ? hand.value * scale : 300 * (1 - 0.75 * hand.closed);
  const label = !hand || hand.value === null ? "" : `${fixed(hand.value, 1)} ${scale ? "mm apart" : "kPa"}${hand.moving ? ", moving" : ""}`;
  let out = `<rect x="60" y="4" width="680" height="10" rx="5" fill="var(--metal)"/>`;
  fingers.slice(0, 2).forEach((finger, i) => {
    const x = i === 0 ? 400 - gap / 2 - 158 : 400 + gap / 2, mean = doc.pixels.finger_percent[i], touching = mean !== null && mean <= -10;
    out += `<rect x="${x + 59}" y="0" width="40" height="30" rx="5" fill="var(--metal)"/>` + pad(x, finger, doc.pixels, touching);
    out += `<text x="${x + 79}" y="231" text-anchor="middle" font-size="14">finger ${finger} <tspan font-weight="700">${fixed(mean, 1)} %</tspan>${touching ? " · contact" : ""}</text>`;
  });
  if (fingers.length > 1) out += object(400, gap, scale, doc);
  out += `<text class="soft" x="400" y="222" text-anchor="middle" font-size="13">${label}</text>`;
  svg.innerHTML = out;
}

// -- the aggregate, the movements, the forecast ----------------------------------------------------
function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) found.push(value);
  return found;
}

function drawCurve(doc) {
  const svg = $("curve");
  if (!svg) return;
  const width = svg.clientWidth || 800, height = svg.clientHeight || 240, box = { l: 52, r: 14, t: 10, b: 26 };
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const last = seen.curve.length ? seen.curve[seen.curve.length - 1][0] : 0;
  const zero = doc.began_s ?? (seen.curve.length ? seen.curve[0][0] : 0);
  const start = Math.max(zero, last - WINDOW_S), end = Math.max(last, start + WINDOW_S);
  const curve = seen.curve.filter(([t]) => t >= start).map(([t, v]) => [t, Math.min(v, HIGHEST)]), band = seen.band.filter(([t]) => t >= start);
  const values = [0, ...curve.map((p) => p[1]), ...band.flatMap((b) => [b[1], b[3]])].slice(curve.length ? 1 : 0);
  // Never closer than this: noise must not look like a signal.
  const middle = (Math.max(...values) + Math.min(...values)) / 2, half = Math.max(4, 0.56 * (Math.max(...values) - Math.min(...values)));
  const low = middle - half, high = middle + half;
  const x = (t) => box.l + ((t - start) / (end - start)) * (width - box.l - box.r);
  const y = (v) => box.t + ((high - v) / (high - low)) * (height - box.t - box.b);
  const line = (points) => points.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join(" ");
  let out = "";
  for (const [from, to] of doc.moves) {
    if ((to ?? last) < start) continue;
    const left = x(Math.max(from, start));
    out += `<rect class="move" x="${left}" y="${box.t}" width="${Math.max(1.5, x(to ?? last) - left)}" height="${height - box.t - box.b}" fill="var(--muted)" opacity="0.22"/>`;
  }
  for (const value of ticks(low, high)) out += `<line x1="${box.l}" x2="${width - box.r}" y1="${y(value)}" y2="${y(value)}" stroke="var(--line)"/><text class="soft" x="${box.l - 8}" y="${y(value) + 4}" text-anchor="end" font-size="12">${fixed(value, 0)}</text>`;
  for (const value of ticks(start - zero, end - zero)) out += `<text class="soft" x="${x(value + zero)}" y="${height - 8}" text-anchor="middle" font-size="12">${fixed(value, 0)} s</text>`;
  if (band.length) {
    // It speaks of the hold: a movement after the last forecast ends it.
    const now = band[band.length - 1], after = doc.moves.find(([from]) => from > now[0]), until = Math.max(after ? after[0] : last, now[0]);
    const shown = [...band, [until, now[1], now[2], now[3]]];
    const outline = [...shown.map((b) => [b[0], b[3]]), ...shown.reverse().map((b) => [b[0], b[1]])];
    out += `<polygon id="band" data-half-width="${(now[3] - now[1]) / 2}" data-count="${seen.band.length}" points="${line(outline)}" fill="var(--band)" opacity="0.28"/>`;
    out += `<polyline points="${line(shown.map((b) => [b[0], b[2]]))}" fill="none" stroke="var(--band)" stroke-width="2.5" stroke-dasharray="7 5"/>`;
    const right = x(until) > width - 240, at = right ? width - box.r : x(until) + 12;
    out += `<text id="settles" x="${at}" y="${y(Math.max(...band.map((b) => b[3]))) - 8}" text-anchor="${right ? "end" : "start"}" font-size="14" font-weight="700" style="fill:var(--band);paint-order:stroke;stroke:var(--surface);stroke-width:4px">settles at ${fixed(now[2], 1)} % [${fixed(now[1], 1)}, ${fixed(now[3], 1)}]</text>`;
  }
  out += `<polyline points="${line(curve)}" fill="none" stroke="var(--curve)" stroke-width="2" stroke-linejoin="round"/>`;
  if (curve.length) out += `<circle cx="${x(last)}" cy="${y(curve[curve.length - 1][1])}" r="4" fill="var(--curve)"/>`;
  svg.innerHTML = out;
}

// -- words and numbers -----------------------------------------------------------------------------
function bar(one) {
  const marks = [one.low, one.value, one.high, ...(typeof one.truth === "number" ? [one.truth] : [])].filter((v) => v !== null);
  const low = Math.min(...marks), span = Math.max(...marks) - low || 1, x = (v) => 8 + ((v - low) / span) * 184;
  const inside = one.low <= one.truth && one.truth <= one.high;
  return `<svg viewBox="0 0 200 18" preserveAspectRatio="none" aria-hidden="true"><line x1="${x(one.low)}" x2="${x(one.high)}" y1="12" y2="12" stroke="var(--accent)" stroke-width="3"/>
    <circle cx="${x(one.value)}" cy="12" r="4.5" fill="var(--accent)"/>
    ${typeof one.truth === "number" ? `<path d="M${x(one.truth) - 5} 0h10l-5 8z" fill="${inside ? "var(--good)" : "var(--bad)"}"/>` : ""}</svg>`;
}

function drawMeasures(measured) {
  for (const [name, [title, unit, digits]] of Object.entries(UNITS)) {
    const card = $(`measure-${name}`), one = measured.values[name];
    if (!card) continue;
    card.dataset.decided = measured.decided;
    const state = !one ? "" : one.status !== "ok" ? `<span class="note">${STATUS[one.status] ?? one.status}</span>` : measured.decided ? "" : "<span>so far</span>";
    const truth = one && typeof one.truth === "number" ? one.truth : null;
    if (one && one.text) {
      card.title = "no number: only a bound is known";
      card.innerHTML = `<div class="name"><span>${title}</span></div><div class="value num">${one.text} <span>${unit}</span></div>
        <div class="range num">${truth === null ? "" : `true ${fixed(truth, digits)}`}</div>`;
      continue;
    }
    const range = !one ? "" : `${truth === null ? "90 %: " : ""}${fixed(one.low, digits)} to ${fixed(one.high, digits)}${truth === null ? "" : ` · true ${fixed(truth, digits)}`}`;
    card.title = "with its 90 % interval";
    card.innerHTML = `<div class="name"><span>${title}</span>${state}</div><div class="value num">${one ? fixed(one.value, digits) : "–"} <span>${unit}</span></div>
      <div class="range num">${range}</div>${one ? bar(one) : ""}`;
  }
}

function drawVerdict(doc) {
  const card = $("verdict");
  if (!card) return;
  const said = doc.verdict, parts = whys(doc);
  card.dataset.kind = said.kind;
  if (doc.phase && said.kind === "busy" && doc.measured.force_now_n >= 0.05) parts.push(`about ${fixed(doc.measured.force_now_n, 1)} N`);
  say($("verdict-text"), said.text);
  say($("verdict-firm"), said.firmness ?? "");
  say($("verdict-why"), parts.join(" · "));
}

follow((doc) => { drawVerdict(doc); drawFingers(doc); drawCurve(doc); drawMeasures(doc.measured); });
