// Force, change, phases and pixels on one time axis that counts from the contact.
import { $, handState, received } from "/static/poll.js";
import { graspOf, keptAt, zeroOf } from "/static/compare.js";
import { chosenPixel, choosePixel } from "/static/pads.js";
import { fingerName, fixed, pixelName, range } from "/static/words.js";

const RECENT_S = 30, BEFORE_S = 2, AFTER_S = 3, STEP_S = 5, SHORTEST_S = 15, NARROWEST_S = 0.2, GAP_S = 1, POINTS = 800;
// Upper limit of plotted changes: a loose pixel with 100 times its rest value must not set the scale.
const HIGHEST = 100;
const LEFT = 46, RIGHT = 12, TOP = 16, FOOT = 24;
const NAMES = { contact: "contact", answer: "answer", adjusted: "adjusted", tightened: "tightened", damage_limit: "damage limit", damaged: "damaged", slipped: "slipped", stopped: "stopped", force_limit: "force limit", held: "released" };
let chosen = "grasp", zoomed = null, pointed = null, view = null, doc = null, drawn = "", ink = {}, inkOf = "";
const plots = {};

const LARGE = matchMedia("(min-width: 1800px) and (min-height: 1000px)"), FORCED = matchMedia("(forced-colors: active)");
// Texts are larger on a large screen, which is viewed from a greater distance.
const scale = () => (LARGE.matches ? 1.35 : 1);
const font = (px = 12) => `${px * scale()}px Roboto, system-ui, sans-serif`;

// Reads the page's current colours, because a canvas has no style sheet.
function readColours() {
  const of = `${document.body.className}/${FORCED.matches}`;
  if (inkOf === of) return;
  inkOf = of;
  const style = getComputedStyle(document.body);
  ink = Object.fromEntries(["curve", "band", "kept", "muted", "line", "ink", "good", "bad", "surface", "accent", "busy-bg"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

const last = (points) => points[points.length - 1];
const known = (value) => value !== null && value !== undefined;

// -- the visible time range, in seconds from the contact ----------------------------------------------
function fullRange() {
  const kept = view.kept;
  return [Math.min(view.first, kept[0]?.[0] ?? view.first), Math.max(view.newest, last(kept)?.[0] ?? view.newest)];
}

function visibleRange() {
  const { first, newest, now, ended } = view;
  const recent = [Math.max(first, now - RECENT_S), Math.max(now, Math.max(first, now - RECENT_S) + RECENT_S)];
  if (chosen === "all" || (view.replay && chosen === "grasp")) return fullRange();
  if (chosen === "recent" || !view.touched) return recent;
  const from = Math.max(first, -BEFORE_S);
  // The range grows in steps, so that it stays readable during a grasp.
  return [from, ended ?? from + Math.max(SHORTEST_S, STEP_S * Math.ceil((newest - from) / STEP_S))];
}

function updateView() {
  const grasp = graspOf(doc), zero = zeroOf(doc), touched = Boolean(grasp && grasp.touched_s !== null), replay = Boolean(doc.replay);
  const from = (points) => points.map(([time, ...rest]) => [time - zero, ...rest]);
  const first = (received.curve[0]?.[0] ?? zero) - zero, newest = (last(received.curve)?.[0] ?? zero) - zero;
  const moments = from(grasp?.moments ?? []);
  const isOver = !replay && doc.activity === "watching" && touched && moments.length;
  const phases = from((replay ? doc.replay : grasp)?.phases ?? []), end = last(moments)?.[0] ?? newest;
  if (isOver && known(doc.measured.damaged_s)) moments.push([doc.measured.damaged_s - zero, "damaged", null]);
  view = { envelope: view?.envelope ?? [], zero, touched, replay, first, newest, moments, phases, now: replay ? doc.replay.time_s - zero : newest, ended: isOver ? Math.min(end + AFTER_S, Math.max(newest, end)) : null, phasesEnd: isOver || replay ? end : newest, kept: from(keptAt(zero, touched)), bounds: grasp?.bounds ?? {}, moves: doc.moves.map(([a, b]) => [a - zero, b === null ? newest : b - zero]), band: from(received.band), hand: handState(doc) };
  [view.start, view.end] = zoomed ?? visibleRange();
  if (!(view.end > view.start)) view.end = view.start + 1;
  const inside = received.curve.filter(([time]) => time - zero >= view.start && time - zero <= view.end), every = Math.max(1, Math.ceil(inside.length / POINTS));
  // Thinned by sample number, so that a moving curve does not flicker.
  view.curve = from(inside.filter(([time], i) => i === inside.length - 1 || Math.round(time * 50) % every === 0));
  view.band = view.band.filter(([time]) => time >= view.start && time <= view.end);
  view.force = forceRange();
  view.change = changeRange();
}

function levels() {
  const { target_n: target, damage_low_n: damage, ceiling_n: ceiling } = view.bounds, highest = view.highest;
  return [{ value: target, name: "target", kind: "target" }, known(damage) ? { value: damage, name: "damage limit", kind: "limit" } : { value: ceiling < 2.5 * highest ? ceiling : null, name: "ceiling", kind: "limit" }].filter((one) => known(one.value));
}

function forceRange() {
  const values = view.curve.filter((p) => p[3] !== undefined), near = view.kept.filter(([time]) => time >= view.start && time <= view.end);
  view.highest = Math.max(1, ...values.map((p) => p[3]), ...near.map((p) => p[3] ?? 0), ...view.band.map((b) => b[6] ?? 0));
  const limits = levels().map((one) => one.value).filter((value) => value < 2.5 * view.highest);
  return [0, 1.15 * Math.max(view.highest, ...limits, ...values.map((p) => Math.min(p[4], 1.5 * p[3])))];
}

function changeRange() {
  const kept = view.kept.filter(([time]) => time >= view.start && time <= view.end);
  const values = [...view.curve, ...kept].map((p) => Math.min(p[1], HIGHEST)).concat(view.band.flatMap((b) => [b[1], b[3]]));
  if (!values.length) return [-4, 4];
  // Minimum range of 8 %: noise must not look like a signal.
  const low = Math.min(...values), high = Math.max(...values), half = Math.max(4, 0.56 * (high - low));
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

// -- drawings below and above the lines ----------------------------------------------------------------
const px = (u) => (value, axis) => u.valToPos(value, axis, true);

function clipped(u, draw) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  draw(ctx, px(u), bbox, devicePixelRatio * scale());
  ctx.restore();
}

function drawLine(ctx, at, points, column) {
  let open = false;
  ctx.beginPath();
  for (const p of points) {
    if (!known(p[column])) { open = false; continue; }
    ctx[open ? "lineTo" : "moveTo"](at(p[0], "x"), at(p[column], "y"));
    open = true;
  }
  ctx.stroke();
}

const drawBelow = (low, value, high) => (u) => clipped(u, (ctx, at, box, unit) => {
  ctx.fillStyle = ink.muted;
  ctx.globalAlpha = 0.22;
  for (const [from, to] of view.moves) ctx.fillRect(at(from, "x"), box.top, Math.max(1.5, at(to, "x") - at(from, "x")), box.height);
  ctx.globalAlpha = 1;
  if (value !== 2 && view.touched && view.envelope.length) {
    Object.assign(ctx, { fillStyle: ink.muted, globalAlpha: 0.18 });
    ctx.beginPath();
    for (const [time, , most] of view.envelope) ctx.lineTo(at(time, "x"), at(most, "y"));
    for (const [time, least] of [...view.envelope].reverse()) ctx.lineTo(at(time, "x"), at(least, "y"));
    ctx.fill();
    ctx.globalAlpha = 1;
  }
  Object.assign(ctx, { strokeStyle: ink.kept, lineWidth: 2 * unit });
  ctx.setLineDash([5 * unit, 3 * unit]);
  drawLine(ctx, at, view.kept, value === 2 ? 1 : 3);
  const band = forecast(high);
  if (!band.length) return;
  ctx.fillStyle = ink.band;
  ctx.globalAlpha = 0.28;
  ctx.beginPath();
  for (const b of band) ctx.lineTo(at(b[0], "x"), at(b[high], "y"));
  for (const b of [...band].reverse()) ctx.lineTo(at(b[0], "x"), at(b[low], "y"));
  ctx.fill();
  ctx.globalAlpha = 1;
  Object.assign(ctx, { strokeStyle: ink.band, lineWidth: 2.5 * unit });
  ctx.setLineDash([7 * unit, 5 * unit]);
  drawLine(ctx, at, band, value);
});

// The forecast band, extended until the next movement of the fingers.
function forecast(high) {
  const band = view.band.filter((b) => b[high] !== undefined);
  if (!band.length) return [];
  const final = last(band), after = view.moves.find(([from]) => from > final[0]), until = Math.max(after ? after[0] : Math.min(view.newest, view.end), final[0]);
  return [...band, Object.assign([...final], { 0: until })];
}

function drawAbove(u) {
  const isForce = u === plots.force, box = u.bbox, unit = devicePixelRatio * scale(), at = px(u);
  clipped(u, (ctx) => {
    if (isForce) for (const { value, kind } of levels()) {
      Object.assign(ctx, { strokeStyle: kind === "target" ? ink.good : ink.bad, lineWidth: 1.5 * unit });
      ctx.setLineDash(kind === "target" ? [9 * unit, 4 * unit] : []);
      ctx.strokeRect(box.left - 9, at(value, "y"), box.width + 18, 0);
    }
    if (view.replay) {
      Object.assign(ctx, { fillStyle: ink.surface, globalAlpha: 0.6 });
      ctx.fillRect(at(view.now, "x"), box.top, box.width, box.height);
      ctx.globalAlpha = 1;
    }
    const one = atNow(isForce ? 3 : 1);
    if (!one || (zoomed ?? view.ended) !== null) return;
    ctx.fillStyle = ink.curve;
    ctx.beginPath();
    ctx.arc(at(one[0], "x"), Math.max(box.top, at(isForce ? one[3] : Math.min(one[1], HIGHEST), "y")), 4 * unit, 0, 7);
    ctx.fill();
  });
  drawMoments(u, at, box, unit);
}

// Marks the controller's events.
function drawMoments(u, at, box, unit) {
  const { ctx } = u, bottom = box.top + box.height;
  let free = -Infinity;
  ctx.save();
  Object.assign(ctx, { font: font(11 * devicePixelRatio), textAlign: "left", textBaseline: "alphabetic" });
  for (const [time, name, finger] of view.moments) {
    if (time < view.start || time > view.end) continue;
    const x = at(time, "x"), damaged = name === "damaged";
    Object.assign(ctx, { fillStyle: damaged ? ink.bad : ink.muted, strokeStyle: damaged ? ink.bad : ink.muted, lineWidth: (damaged ? 2.5 : 1) * unit });
    if (finger !== null) {
      if (!name.startsWith("finger_")) continue;
      ctx.fillStyle = ink.accent;
      ctx.beginPath();
      for (const [dx, dy] of [[0, 0], [-4, 6], [4, 6]]) ctx.lineTo(x + dx * unit, bottom + dy * unit);
      ctx.fill();
    }
    if (!NAMES[name]) continue;
    ctx.setLineDash(damaged ? [] : [2 * unit, 3 * unit]);
    ctx.beginPath();
    ctx.moveTo(x, box.top);
    ctx.lineTo(x, bottom);
    ctx.stroke();
    if (u !== plots[shownPlots()[0]]) continue;
    const width = ctx.measureText(NAMES[name]).width, from = Math.min(Math.max(x - width / 2, box.left), box.left + box.width - width);
    if (from < free) continue;
    ctx.fillText(NAMES[name], from, box.top - 4 * unit);
    free = from + width + 6 * unit;
  }
  ctx.restore();
}

// -- earlier grasps of this kind on this rig, stored by the browser --------------------------------------
const GHOSTS = 20, FEWEST_GHOSTS = 3, GHOST_STEP_S = 0.1, GHOST_S = 30;
let ghostOf = null, ghosts = [], keptGeneration = null;

function recallGhosts() {
  const name = `palpate-ghosts/${doc.source?.name}/${doc.kind}`;
  if (name === ghostOf) return;
  ghostOf = name;
  ghosts = JSON.parse(localStorage.getItem(name) ?? "[]");
}

// Stores the force of a finished grasp at intervals of 0.1 s from the contact.
function keepGhost() {
  // A page opened after the end of a grasp does not store that grasp again.
  keptGeneration ??= view.ended === null ? -1 : doc.generation;
  if (view.ended === null || view.newest < view.ended || keptGeneration === doc.generation) return;
  keptGeneration = doc.generation;
  const curve = [], released = view.moments.find(([, name]) => name === "held")?.[0] ?? GHOST_S, until = view.zero + Math.min(GHOST_S, released);
  for (const p of received.curve) if (known(p[3]) && p[0] >= view.zero && p[0] < until) curve[Math.floor((p[0] - view.zero) / GHOST_STEP_S)] = +p[3].toFixed(2);
  const stored = localStorage.getItem(ghostOf) ?? "[]", own = JSON.stringify(Array.from(curve, (n, i) => n ?? (curve[i] = curve[i - 1] ?? null)));
  // Another page of this browser may have stored the same grasp.
  ghosts = [...JSON.parse(stored), ...(stored.includes(own) ? [] : [JSON.parse(own)])].slice(-GHOSTS);
  localStorage.setItem(ghostOf, JSON.stringify(ghosts));
}

// The central 90 % of the stored forces at each time with at least three grasps.
function envelope() {
  const found = [], others = view.ended !== null && keptGeneration === doc.generation ? ghosts.slice(0, -1) : ghosts;
  for (let i = 0; i < GHOST_S / GHOST_STEP_S; i += 1) {
    const values = others.map((one) => one[i]).filter(known).sort((a, b) => a - b), edge = Math.floor(0.05 * values.length);
    if (values.length >= FEWEST_GHOSTS) found.push([i * GHOST_STEP_S, values[edge], values[values.length - 1 - edge]]);
  }
  return found;
}

// -- readings at the cursor ---------------------------------------------------------------------------
const nearest = (points, time) => points.reduce((best, p) => (Math.abs(p[0] - time) < Math.abs(best[0] - time) ? p : best), points[0]);

// The current point of the curve; null without a value.
function atNow(column) {
  const one = view.curve.length ? nearest(view.curve, view.now) : null;
  return one && known(one[column]) ? one : null;
}

const isPointed = () => pointed !== null && pointed >= view.start && pointed <= Math.min(view.end, view.newest + 0.5);

// The document with the readings of pixels and hand at the cursor, if any.
export function momentOf(doc) {
  if (!view || !isPointed() || !received.pixels.length) return doc;
  const time = pointed + view.zero, one = nearest(received.pixels.map((p) => [p.time_s, p]), time);
  // No readings are available before this page was opened.
  return time < received.pixels[0].time_s - 0.3 ? doc : { ...doc, pixels: { ...doc.pixels, ...one[1] }, hand: one[1].hand, pointed_s: one[0] - view.zero };
}

function showReading(name, column, words) {
  const out = $(`${name}-at`), points = view.curve.filter((p) => known(p[column])), inside = isPointed() && points.length > 0;
  const one = inside ? nearest(points, pointed) : atNow(column), kept = inside ? view.kept.filter((p) => known(p[column])) : [];
  out.classList.toggle("pointed", inside);
  const reading = one ? words(one) : view.hand, text = inside ? `${fixed(one[0], 1)} s: ${reading}${kept.length ? ` · kept ${words(nearest(kept, one[0]))}` : ""}` : reading;
  if (out.textContent !== text) out.textContent = text;
  const plot = $(name), values = { ariaValueMin: view.start, ariaValueMax: view.end, ariaValueNow: one ? one[0] : view.now };
  for (const [key, value] of Object.entries(values)) plot[key] = value.toFixed(1);
  plot.ariaValueText = text || "no value";
}

function showForecast(name, [low, value, high], digits, unit) {
  const band = view.band.filter((b) => b[high] !== undefined), out = $(`${name}-settles`), plot = $(name);
  const now = band.filter((b) => b[0] <= view.now).pop() ?? band[0];
  const text = now ? `forecast ${fixed(now[value], digits)} ${unit} ${range(now[low], now[high], digits)}` : "";
  if (out.textContent !== text) out.textContent = text;
  Object.assign(plot.dataset, { bands: now ? received.band.length : 0, halfWidth: now ? (now[high] - now[low]) / 2 : "", bandEnd: now ? last(forecast(high))[0] : "" });
}

// The events as text for screen readers.
function listMoments() {
  const rows = view.moments.filter(([, name]) => NAMES[name] || name.startsWith("finger_")).map(([time, name, finger]) => `<li data-name="${name}" data-at="${time.toFixed(2)}">${finger === null ? NAMES[name] : `${fingerName(finger)}: ${name === "finger_contact" ? "contact" : "removal"}`} at ${fixed(time, 1)} s</li>`).join("");
  if ($("moments").innerHTML !== rows) $("moments").innerHTML = rows;
}

// -- the plots ----------------------------------------------------------------------------------------
const shownPlots = () => (doc.source?.newtons ? ["force", "curve"] : ["curve"]);

const digits = (step) => [0, 1, 2].find((n) => Math.abs(step * 10 ** n - Math.round(step * 10 ** n)) < 1e-6) ?? 3;

function axes(name) {
  const line = { stroke: () => ink.line, width: 1 }, text = () => ink.muted, isLast = name === "curve";
  const minor = { size: 0, gap: 0, space: 12, grid: { show: false }, ticks: { ...line, stroke: () => ink.muted, size: 4 }, values: (u, splits) => splits.map(() => null) };
  const major = { grid: line, ticks: { ...line, stroke: () => ink.muted, size: 7 }, stroke: text, font: font() };
  return [
    minor,
    { ...minor, scale: "y", side: 3 },
    { ...major, scale: "x", side: 2, size: isLast ? FOOT * scale() : 8, space: 60, values: (u, splits, axis, space, step) => splits.map((v) => (isLast ? `${fixed(v, digits(step))} s` : "")) },
    { ...major, scale: "y", side: 3, size: LEFT * scale(), space: 26, values: (u, splits, axis, space, step) => splits.map((v) => fixed(v, digits(step))) },
  ];
}

function build(name) {
  const host = $(name), isForce = name === "force";
  const columns = isForce ? [4, 5, 6] : [1, 2, 3], none = { show: true, stroke: null, width: 0, points: { show: false } };
  const u = new uPlot({
    width: host.clientWidth || 300, height: host.clientHeight || 100, pxAlign: 0, padding: [isForce || shownPlots()[0] === name ? TOP * scale() : 6, RIGHT, 0, 0], legend: { show: false },
    scales: { x: { time: false, range: () => [view.start, view.end] }, y: { range: () => (isForce ? view.force : view.change) } },
    cursor: { y: false, points: { size: 9, fill: "transparent", stroke: () => ink.ink, width: 2 }, dataIdx: (u, series, index) => (series > 1 ? null : index), drag: { x: true, y: false, setScale: false }, sync: { key: "grasp" }, bind: { dblclick: () => () => zoom(null) } },
    series: [{}, { stroke: () => ink.curve, width: 2, points: { show: false } }, ...(isForce ? [none, none] : [])],
    bands: isForce ? [{ series: [3, 2], fill: () => faint(ink.curve) }] : [],
    axes: axes(name),
    hooks: {
      drawAxes: [drawBelow(...columns)], draw: [drawAbove],
      setCursor: [(u) => { pointed = u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : null; }],
      setSelect: [(u) => { const { left, width } = u.select; if (width > 4) zoom([u.posToVal(left, "x"), u.posToVal(left + width, "x")]); u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); }],
    },
  }, [[], ...(isForce ? [[], [], []] : [[]])], host);
  plots[name] = u;
  new ResizeObserver(() => { u.setSize({ width: host.clientWidth, height: host.clientHeight }); drawn = ""; }).observe(host);
  listen(host, u);
}

const faint = (colour) => `color-mix(in srgb, ${colour} 18%, transparent)`;

function plot(name) {
  const host = $(name);
  if (!host.firstChild) build(name);
  // The line is interrupted at gaps in the data.
  const points = view.curve.flatMap((p, i, all) => (i && p[0] - all[i - 1][0] > GAP_S ? [[all[i - 1][0] + 0.01], p] : [p]));
  const lines = name === "force" ? [3, 2, 4].map((at) => points.map((p) => p[at] ?? null)) : [points.map((p) => (known(p[1]) ? Math.min(p[1], HIGHEST) : null))];
  plots[name].setData([points.map((p) => p[0]), ...lines]);
}

// Labels of the force levels, in front of all lines.
function nameLevels() {
  const u = plots.force, found = levels();
  if (!u) return;
  u.over.querySelectorAll(".level").forEach((one, i) => { if (i >= found.length) one.remove(); });
  found.forEach(({ value, name, kind }, i) => {
    const words = u.over.querySelectorAll(".level")[i] ?? u.over.appendChild(document.createElement("span"));
    const beyond = value > view.force[1], top = beyond ? 0 : u.valToPos(value, "y");
    words.className = `level ${kind}`;
    words.dataset.value = value;
    words.textContent = `${name} ${fixed(value, 1)} N${beyond ? " ↑" : ""}`;
    words.style.top = `${Math.max(0, top - (found.some((one) => one.value > value && top - u.valToPos(one.value, "y") < 34) ? -2 : 19 * scale()))}px`;
  });
}

// -- the lane of phases, and the pixels -----------------------------------------------------------------
function surface(canvas) {
  const ratio = devicePixelRatio, [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
  const ctx = canvas.getContext("2d");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  ctx.textBaseline = "middle";
  return [ctx, width, height];
}

function drawLane() {
  const [ctx, width, height] = surface($("lane")), left = LEFT * scale(), right = width - RIGHT;
  const x = (time) => left + ((Math.min(Math.max(time, view.start), view.end) - view.start) / (view.end - view.start)) * (right - left);
  ctx.font = font(11);
  view.phases.forEach(([from, name], i) => {
    const [begin, end] = [x(from), x(view.phases[i + 1]?.[0] ?? view.phasesEnd)];
    if (end - begin < 0.5) return;
    ctx.fillStyle = ink[i % 2 ? "line" : "busy-bg"];
    ctx.fillRect(begin, 0, end - begin, height);
    ctx.fillStyle = ink.ink;
    if (ctx.measureText(name).width < end - begin - 6) ctx.fillText(name, begin + 4, height / 2 + 1);
  });
}

// A small plot for every pixel, with the same time range and a common scale.
function drawPixels() {
  const canvas = $("pixels"), grid = doc.pixels?.percent, points = received.pixels.filter((p) => p.time_s - view.zero >= view.start && p.time_s - view.zero <= view.end);
  canvas.classList.toggle("hidden", !grid);
  if (!grid) return;
  const cols = grid[0].length, count = grid.length * cols, many = count > 32, most = many ? cols * Math.ceil(grid.length / 8) : Math.max(cols, Math.floor(canvas.clientWidth / 52 / cols) * cols);
  const lines = Math.ceil(count / most), perLine = Math.min(count, cols * Math.ceil(count / lines / cols));
  canvas.style.height = `${Math.min(110, lines * (many ? 14 : 34)) * scale()}px`;
  const [ctx, width, height] = surface(canvas), box = { w: width / perLine, h: height / lines };
  const values = points.flatMap((p) => p.percent.flat()).filter(known).map((v) => Math.min(v, HIGHEST)), low = values.reduce((a, b) => Math.min(a, b), 0), high = values.reduce((a, b) => Math.max(a, b), 8);
  ctx.font = font(9);
  for (let i = 0; i < count; i += 1) {
    const row = Math.floor(i / cols), col = i % cols, x0 = (i % perLine) * box.w, y0 = Math.floor(i / perLine) * box.h, picked = chosenPixel()?.row === row && chosenPixel().col === col;
    const x = (time) => x0 + 2 + ((time - view.zero - view.start) / (view.end - view.start)) * (box.w - 5), y = (v) => y0 + 2 + ((high - Math.min(v, HIGHEST)) / (high - low)) * (box.h - 5);
    Object.assign(ctx, { strokeStyle: picked ? ink.accent : ink.line, lineWidth: picked ? 2 : 1 });
    ctx.strokeRect(x0 + 1, y0 + 1, box.w - 3, box.h - 3);
    Object.assign(ctx, { strokeStyle: ink.curve, lineWidth: 1.3 });
    ctx.beginPath();
    let open = false;
    for (const p of points) {
      const value = p.percent[row]?.[col];
      if (!known(value)) { open = false; continue; }
      ctx[open ? "lineTo" : "moveTo"](x(p.time_s), y(value));
      open = true;
    }
    ctx.stroke();
    if (isPointed()) {
      Object.assign(ctx, { strokeStyle: ink.muted, lineWidth: 1 });
      ctx.strokeRect(x(pointed + view.zero), y0 + 2, 0, box.h - 5);
    }
    if (many) continue;
    // Curves are rarely at half height. An outline keeps the name readable nevertheless.
    const name = [pixelName(row, col, "part.pixel_short"), x0 + box.w - 26 * scale(), y0 + box.h / 2 + 3 * scale()];
    Object.assign(ctx, { fillStyle: ink.muted, strokeStyle: ink.surface, lineWidth: 3 });
    ctx.strokeText(...name);
    ctx.fillText(...name);
  }
  Object.assign(canvas.dataset, { cols, perLine, count, moments: points.length });
}

// Force over the object's own deformation: the deflection of pads, fingers and servo is taken out, so
// that the points and the band of the stiffness describe the same thing. Readings at rest only: while
// the fingers move, the sheet's force lags behind their width.
const LAG_S = 0.25;
function drawPress() {
  const size = doc.measured.values.size_mm, slope = doc.measured.values.stiffness_n_per_mm, box = $("press-box");
  const points = [], isAtRest = (s) => !view.moves.some(([a, b]) => s >= a && s < b + LAG_S);
  let at = 0;
  if (doc.hand?.drive === "width" && size?.value > 0 && doc.source.newtons && view.touched) {
    for (const one of received.pixels) {
      if (one.time_s < view.zero || one.hand?.value == null || one.hand.own_mm === null || one.hand.open || one.hand.opening || !isAtRest(one.time_s - view.zero)) continue;
      while (at < received.curve.length - 1 && received.curve[at][0] < one.time_s) at += 1;
      if (known(received.curve[at]?.[3])) points.push([size.value - one.hand.value - one.hand.own_mm, received.curve[at][3]]);
    }
  }
  box.classList.toggle("hidden", points.length < 2);
  if (points.length < 2) return;
  const ends = slope ? slope.known ?? [slope.low, slope.value, slope.high] : [], words = !slope ? "" : known(slope.value) ? `stiffness ${fixed(slope.value, 2)} N/mm ${range(slope.low, slope.high, 2)}` : slope.text ? `stiffness ${slope.text} N/mm` : "";
  $("press-slope").textContent = words;
  $("press").ariaLabel = `Force over deformation: up to ${fixed(points.reduce((a, p) => Math.max(a, p[1]), 0), 1)} N at ${fixed(last(points)[0], 1)} mm. ${words}`;
  const [ctx, width, height] = surface($("press")), left = 26 * scale(), foot = height - 16 * scale();
  const widest = Math.max(0.5, 1.1 * points.reduce((a, p) => Math.max(a, p[0]), 0)), highest = Math.max(0.5, 1.15 * points.reduce((a, p) => Math.max(a, p[1]), 0));
  const x = (mm) => left + (Math.max(0, mm) / widest) * (width - left - 4), y = (n) => foot - (n / highest) * (foot - 4);
  Object.assign(ctx, { font: font(11), fillStyle: ink.muted, strokeStyle: ink.line, lineWidth: 1 });
  ctx.strokeRect(left, 4, width - left - 4, foot - 4);
  ctx.fillText(fixed(highest, 1), 0, 10);
  ctx.fillText("0", left - 10, foot - 4);
  ctx.fillText("0", left, height - 6);
  ctx.fillText("deformation of the object, mm", left + 16 * scale(), height - 6);
  ctx.fillText(fixed(widest, 1), width - 24 * scale(), height - 6);
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, 4, width - left - 4, foot - 4);
  ctx.clip();
  // A lower bound has no upper limit, so its band extends to the vertical axis.
  const ray = (k) => [x(widest), y(k === Infinity ? highest * 100 : k * widest)];
  const bound = slope && !known(slope.value) && known(ends[0]) && !known(ends[2]) ? [ends[0], null, Infinity] : ends;
  if (known(bound[0]) && known(bound[2])) {
    Object.assign(ctx, { fillStyle: ink.band, globalAlpha: 0.25 });
    ctx.beginPath();
    ctx.moveTo(x(0), y(0));
    ctx.lineTo(...ray(bound[0]));
    ctx.lineTo(...(bound[2] === Infinity ? [x(widest), y(highest)] : ray(bound[2])));
    if (bound[2] === Infinity) ctx.lineTo(x(0), y(highest));
    ctx.fill();
    ctx.globalAlpha = 1;
  }
  if (known(bound[1])) {
    Object.assign(ctx, { strokeStyle: ink.band, lineWidth: 2 });
    ctx.setLineDash([7, 5]);
    ctx.beginPath();
    ctx.moveTo(x(0), y(0));
    ctx.lineTo(...ray(bound[1]));
    ctx.stroke();
    ctx.setLineDash([]);
  }
  Object.assign(ctx, { strokeStyle: ink.curve, lineWidth: 2 });
  ctx.beginPath();
  for (const [mm, n] of points) ctx.lineTo(x(mm), y(n));
  ctx.stroke();
  ctx.restore();
}

// -- wheel, pinch, drag, double click, keys ---------------------------------------------------------------
function zoom(wanted) {
  const [first, newest] = fullRange();
  if (wanted) {
    const width = Math.min(Math.max(wanted[1] - wanted[0], NARROWEST_S), newest - first), from = Math.min(Math.max(wanted[0], first), newest - width);
    wanted = width >= newest - first ? null : [from, from + width];
  }
  zoomed = wanted;
  redraw();
}

function zoomAround(time, factor) {
  zoom([time - (time - view.start) * factor, time + (view.end - time) * factor]);
}

function listen(host, u) {
  const timeAt = (x) => u.posToVal(x - u.over.getBoundingClientRect().left, "x");
  u.over.addEventListener("wheel", (event) => {
    event.preventDefault();
    const width = view.end - view.start;
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) zoom([view.start + width * 0.1 * Math.sign(event.deltaX || event.deltaY), view.end + width * 0.1 * Math.sign(event.deltaX || event.deltaY)]);
    else zoomAround(timeAt(event.clientX), event.deltaY < 0 ? 0.8 : 1.25);
  }, { passive: false });
  let pinch = null;
  const ends = (event) => [...event.touches].map((one) => one.clientX).sort((a, b) => a - b);
  u.over.addEventListener("touchstart", (event) => { if (event.touches.length === 2) pinch = ends(event).map(timeAt); }, { passive: true });
  u.over.addEventListener("touchmove", (event) => {
    if (!pinch || event.touches.length !== 2) return;
    event.preventDefault();
    // Keeps the times under the two fingers during the pinch.
    const box = u.over.getBoundingClientRect(), [a, b] = ends(event).map((x) => (x - box.left) / box.width), width = (pinch[1] - pinch[0]) / Math.max(b - a, 0.05);
    zoom([pinch[0] - a * width, pinch[0] + (1 - a) * width]);
  }, { passive: false });
  u.over.addEventListener("touchend", () => { pinch = null; });
  host.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], middle = (view.start + view.end) / 2;
    if (step) moveCursor(Math.min(Math.max((pointed ?? view.now) + (step * (view.end - view.start)) / 50, view.start), Math.min(view.end, view.newest)));
    else if (event.key === "PageUp" || event.key === "PageDown") zoomAround(pointed ?? middle, event.key === "PageUp" ? 0.6 : 1.6);
    else if (event.key === "Home") { moveCursor(null); zoom(null); } else return;
    event.preventDefault();
  });
  host.addEventListener("blur", () => moveCursor(null));
}

function moveCursor(time) {
  pointed = time;
  for (const name of shownPlots()) plots[name]?.setCursor({ left: time === null ? -10 : plots[name].valToPos(time, "x"), top: 1 }, false);
  redraw();
}

export function begin() {
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("[data-view], #unzoom"), canvas = event.target.closest?.("#pixels");
    if (button) { chosen = button.dataset.view ?? chosen; zoom(null); }
    if (canvas?.dataset.count) {
      const { cols, perLine, count } = canvas.dataset, lines = Math.ceil(count / perLine), i = Math.floor((event.offsetY / canvas.clientHeight) * lines) * perLine + Math.floor((event.offsetX / canvas.clientWidth) * perLine);
      if (i < count) choosePixel(Math.floor(i / cols), i % cols);
    }
  });
}

function redraw() {
  if (doc) drawChart(doc);
}

export function drawChart(now) {
  if (!$("chart")) return;
  if (doc && doc.generation !== now.generation) zoomed = null;
  doc = now;
  updateView();
  readColours();
  recallGhosts();
  if (!view.replay) keepGhost();
  const newtons = shownPlots().length === 2, picked = chosenPixel();
  $("force-card").classList.toggle("hidden", !newtons);
  for (const button of document.querySelectorAll("[data-view]")) button.ariaPressed = button.dataset.view === chosen && !zoomed;
  $("unzoom").classList.toggle("hidden", !zoomed);
  // Unchanged plots, such as of a finished grasp, are not redrawn.
  const key = [doc.generation, view.start, view.end, last(view.curve)?.[0], view.now < view.end && view.replay ? view.now : "", view.kept.length, view.moments.length, view.phases.length, received.band.length, JSON.stringify(view.bounds), doc.measured.values.stiffness_n_per_mm?.text, doc.measured.decided, pointed, picked?.row, picked?.col, inkOf, newtons, view.touched, view.ended === null ? last(view.moves)?.[1] : ""].join("/");
  if (key !== drawn) {
    view.envelope = newtons ? envelope() : [];
    const ghost = document.querySelector(".ghost-key");
    ghost.classList.toggle("hidden", !view.envelope.length || !view.touched);
    ghost.lastElementChild.textContent = `last ${ghosts.length} grasps, 90 %`;
    for (const name of shownPlots()) plot(name);
    nameLevels();
    drawLane();
    drawPixels();
    drawPress();
    listMoments();
    drawn = key;
  }
  Object.assign($("chart").dataset, { start: view.start.toFixed(2), end: view.end.toFixed(2), frozen: view.ended !== null && !zoomed && chosen === "grasp", kept: view.kept.length, moves: view.moves.length });
  showForecast("curve", [1, 2, 3], 1, "%");
  showReading("curve", 1, (p) => `${fixed(p[1], 1)} %`);
  if (!newtons) return;
  showForecast("force", [4, 5, 6], 2, "N");
  showReading("force", 3, (p) => `${fixed(p[3], 2)} N ${range(p[2], p[4], 2)}`);
}
