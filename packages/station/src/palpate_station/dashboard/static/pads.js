// The pads with their pixels, opposite each other on a gripper and side by side without one.
import { $, setText, received } from "/static/poll.js";
import { fingerName, fixed, pixelName, t, integer, w } from "/static/words.js";
import { color } from "/static/colors.js";

const PAD = { top: 26, margin: 10, wide: 138, tall: 164 }, SIDE_GAP = 56, RECENT_S = 30;
// Phases before the object is held.
const APPROACH = ["sweep", "felt", "approach", "contact"];
let built = null, pads = [], chosen = null, caption = 14;
export const chosenPixel = () => chosen;

// Size of a pad with square pixels.
function shape(rows, cols) {
  const cell = Math.min(PAD.wide / cols, PAD.tall / rows);
  return { cell, width: cell * cols + 2 * PAD.margin, height: cell * rows + 2 * PAD.margin };
}

function build(svg, doc) {
  const of = doc.pixels.finger_of_row, cols = doc.pixels.percent[0].length;
  pads = [...new Set(of)].map((finger) => {
    const rows = of.flatMap((f, row) => (f === finger ? [row] : []));
    return { finger, rows, ...shape(rows.length, cols) };
  });
  svg.innerHTML = `<g id="hand"><rect class="metal" id="rail" y="4" height="10" rx="5"/></g><g id="object"></g>${pads.map((pad, i) => padSvg(pad, i, cols)).join("")}<text class="soft" id="opening" text-anchor="middle" />`;
}

function padSvg(pad, index, cols) {
  const gap = pad.cell > 24 ? 4 : 1, side = pad.cell - gap;
  let out = `<g class="pad" id="pad-${index}"><rect class="metal stem" x="${pad.width / 2 - 20}" y="0" width="40" height="30" rx="5"/>
    <rect class="sheet" y="${PAD.top}" width="${pad.width}" height="${pad.height}" rx="14" fill="var(--pad)"/>`;
  pad.rows.forEach((row, i) => {
    for (let col = 0; col < cols; col += 1) {
      const x = PAD.margin + col * pad.cell + gap / 2, y = PAD.top + PAD.margin + i * pad.cell + gap / 2;
      out += `<g class="cell" data-row="${row}" data-col="${col}"><title></title>
        <rect class="pixel" data-row="${row}" data-col="${col}" x="${x}" y="${y}" width="${side}" height="${side}" rx="${gap > 1 ? 5 : 0}"/>
        <text x="${x + side / 2}" y="${y + side / 2 + Math.min(17, side * 0.45) * 0.35}" text-anchor="middle" font-size="${Math.min(17, side * 0.42)}"></text>
        <path class="found" d="M${x + side - 12} ${y + 3}h9v9z"/></g>`;
    }
  });
  return `${out}<g class="centre hidden"><title>centre of pressure</title><circle r="7"/><path d="M-11 0h22M0-11v22"/></g><text class="name" x="${pad.width / 2}" y="${PAD.top + pad.height + 21}" text-anchor="middle"></text></g>`;
}

function drawCells(svg, doc) {
  const found = new Map((doc.pixels.findings ?? []).map((one) => [`${one.row},${one.col}`, one]));
  for (const cell of svg.querySelectorAll(".cell")) {
    const { row, col } = cell.dataset, value = doc.pixels.percent[row][col], ohm = doc.pixels.ohm[row][col];
    const [title, rect, text] = cell.children, one = found.get(`${row},${col}`);
    const [fill, ink] = value === null ? ["none", "#fff"] : color(value);
    rect.style.fill = fill;
    rect.classList.toggle("dead", value === null);
    cell.classList.toggle("chosen", chosen !== null && chosen.row === +row && chosen.col === +col);
    cell.classList.toggle("ill", one !== undefined);
    text.style.fill = ink;
    const small = +text.getAttribute("font-size") < 6;
    setText(text, small ? "" : value === null ? (ohm === null ? "open" : "dead") : fixed(value, 0));
    // Updates only the tooltip under the pointer; all 384 would use a sixth of the browser's time.
    if (cell.matches(":hover")) title.textContent = `${pixelName(row, col)}: ${ohm === null ? "open" : t("{n} ohm", { n: integer(ohm) })}${one ? `; ${one.text}` : ""}`;
  }
}

const isSmall = (svg) => svg.clientWidth < 560;

// Captions keep their size when the drawing is scaled down on a phone.
function view(svg, left, top, width, height) {
  svg.setAttribute("viewBox", `${left} ${top} ${width} ${height}`);
  const scale = Math.min(svg.clientWidth / width, svg.clientHeight / height) || 1;
  caption = Math.max(14, Math.min(20, 13 / scale));
  svg.style.setProperty("--caption", `${caption}px`);
}

// Positions the pads; returns the gap between the fingers, or null without a gripper.
function place(svg, doc) {
  const hand = doc.hand, between = hand !== null && pads.length === 2;
  const small = isSmall(svg), width = small ? 500 : 700, middle = width / 2;

  svg.querySelectorAll(".metal").forEach((part) => part.classList.toggle("hidden", !between));
  if (!between) {
    const totalWidth = pads.reduce((sum, pad) => sum + pad.width + SIDE_GAP, -SIDE_GAP);
    const rows = totalWidth > 1.6 * width ? 2 : 1, perRow = Math.ceil(pads.length / rows), tall = Math.max(...pads.map((pad) => pad.height)) + (small ? 80 : 62);
    pads.forEach((pad, i) => {
      const line = Math.floor(i / perRow), mates = pads.slice(line * perRow, (line + 1) * perRow);
      const left = -mates.reduce((sum, mate) => sum + mate.width + SIDE_GAP, -SIDE_GAP) / 2;
      $(`pad-${i}`).setAttribute("transform", `translate(${left + (i - line * perRow) * (pad.width + SIDE_GAP)}, ${line * tall})`);
    });
    const span = Math.max(width * 0.6, ...[0, 1].map((line) => pads.slice(line * perRow, (line + 1) * perRow).reduce((sum, pad) => sum + pad.width + SIDE_GAP, 0)));
    view(svg, -span / 2, PAD.top - 8, span, rows * tall - 20);
    return null;
  }
  const scale = hand.drive === "width" ? (small ? 2.2 : 4.1) : 0;
  const gap = hand.value === null ? 220 : scale ? hand.value * scale : (small ? 170 : 300) * (1 - 0.75 * hand.closed);
  // Below the pads are two lines for each finger and one line for the hand.
  const foot = PAD.top + Math.max(...pads.map((pad) => pad.height)) + 21;
  view(svg, 0, 0, width, foot + 60);
  $("opening").setAttribute("y", foot + 2.5 * caption);
  const rail = $("rail");
  rail.setAttribute("x", 10);
  rail.setAttribute("width", width - 20);
  pads.forEach((pad, i) => $(`pad-${i}`).setAttribute("transform", `translate(${i === 0 ? middle - gap / 2 - pad.width : middle + gap / 2}, 0)`));
  return { gap, scale, middle };
}

function object({ gap, scale, middle }, doc) {
  const size = doc.measured.values.size_mm;
  if (doc.nothing_there) return "";
  const known = size && size.value > 0, held = isHeld(doc);
  // An object in contact with both fingers fills the gap, even if the gap is not to scale.
  const across = held ? gap + 4 : known && scale > 0 ? size.value * scale : Math.min(gap * 0.62, 120);
  const grips = held && (doc.pointed_s !== undefined || !APPROACH.includes(doc.grasp.phase));
  const word = known ? `${fixed(size.value, 1)} mm` : grips ? "held" : "", colour = doc.measured.damaged ? "var(--bad)" : "var(--accent)";
  return `<ellipse cx="${middle}" cy="118" rx="${across / 2}" ry="${Math.min(across / 2, 86)}" fill="${colour}" fill-opacity="${known || held ? 0.22 : 0.08}" stroke="${colour}" stroke-width="2" ${known || held ? "" : 'stroke-dasharray="7 6"'}/>
    <text class="thing" x="${middle}" y="123" text-anchor="middle" font-size="${Math.min(17, (1.7 * gap) / word.length)}" font-weight="600">${word}</text>`;
}

const touching = (doc) => (doc.grasp && doc.pointed_s === undefined ? doc.grasp.fingers : doc.pixels.touching);

// Whether the object is held: from the controller's events, or at the cursor from the pads' readings.
function isHeld({ grasp, hand, pixels, pointed_s: pointed }) {
  if (pointed !== undefined) return pixels.touching.length === pads.length;
  return Boolean(grasp) && grasp.touched_s !== null && !hand.open && !hand.opening && !hasSlipped(grasp);
}

const hasSlipped = (grasp) => Boolean(grasp?.moments.some(([, name]) => name === "slipped"));

// Centre of pressure: the mean position of the pixels, weighted by their increase in conductance.
function markCentre(group, pad, percent) {
  let [sum, x, y] = [0, 0, 0];
  pad.rows.forEach((row, i) => percent[row].forEach((value, col) => {
    const gained = value === null ? 0 : Math.max(0, 100 / (100 + value) - 1);
    sum += gained;
    x += gained * (PAD.margin + (col + 0.5) * pad.cell);
    y += gained * (PAD.top + PAD.margin + (i + 0.5) * pad.cell);
  }));
  const mark = group.querySelector(".centre");
  mark.classList.toggle("hidden", !(sum > 0.05));
  if (sum > 0.05) mark.setAttribute("transform", `translate(${x / sum}, ${y / sum})`);
}

function namePads(svg, doc) {
  const fingers = touching(doc);
  pads.forEach((pad, i) => {
    const group = $(`pad-${i}`), mean = doc.pixels.finger_percent[i], force = doc.pixels.finger_n[i], touches = fingers.includes(i);
    group.classList.toggle("touching", touches);
    group.classList.toggle("slipped", hasSlipped(doc.grasp));
    markCentre(group, pad, doc.pixels.percent);
    group.lastElementChild.innerHTML = `${fingerName(pad.finger, !doc.hand)}: <tspan font-weight="700">${fixed(mean, 1)} %</tspan>${touches ? `<tspan x="${pad.width / 2}" dy="1.15em">contact${force === undefined ? "" : `, ${fixed(force, 1)} N`}</tspan>` : ""}`;
  });
}

// -- details of the selected pixel -----------------------------------------------------------------
function drawChosen(doc) {
  const box = $("pixel");
  if (!box) return;
  box.classList.toggle("hidden", chosen === null);
  if (chosen === null) return;
  const { row, col } = chosen, ohm = doc.pixels.ohm[row][col], percent = doc.pixels.percent[row][col];
  const one = (doc.pixels.findings ?? []).find((f) => f.row === row && f.col === col);
  $("pixel-name").textContent = pixelName(row, col);
  setText($("pixel-wiring"), w("part.wiring", { row, col }));
  $("pixel-ohm").textContent = ohm === null ? "open" : t("{n} ohm", { n: integer(ohm) });
  $("pixel-percent").textContent = percent === null ? "" : `${fixed(percent, 1)} %`;
  $("pixel-found").textContent = one ? one.text : "";
  const end = doc.pixels.time_s, values = received.pixels.filter((p) => p.time_s <= end && p.time_s > end - RECENT_S).map((p) => p.ohm[row]?.[col]).filter((v) => typeof v === "number");
  $("pixel-range").textContent = values.length ? t("last {s} s: {low} to {high} ohm", { s: RECENT_S, low: integer(Math.min(...values)), high: integer(Math.max(...values)) }) : "";
}

export function choosePixel(row, col) {
  chosen = chosen !== null && chosen.row === row && chosen.col === col ? null : { row, col };
}

export function begin() {
  document.addEventListener("click", (event) => {
    const cell = event.target.closest?.(".cell");
    if (cell) choosePixel(+cell.dataset.row, +cell.dataset.col);
    if (event.target.closest?.("#pixel-close")) chosen = null;
  });
  // Keyboard: the arrow keys select a pixel while the pads have the focus.
  document.addEventListener("keydown", (event) => {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (!step || event.target.id !== "fingers" || !built) return;
    event.preventDefault();
    const [rows, cols] = built.split("/")[0].split("x").map(Number);
    const { row, col } = chosen ?? { row: -step[0], col: -step[1] };
    chosen = { row: (row + step[0] + rows) % rows, col: (col + step[1] + cols) % cols };
  });
}

export function drawFingers(doc) {
  const svg = $("fingers");
  if (!svg) return;
  if (!doc.pixels) {
    if (built !== null || !svg.firstChild) svg.innerHTML = "<text class='soft' x='350' y='120' text-anchor='middle' font-size='17'></text>";
    built = null;
    svg.setAttribute("viewBox", "0 0 700 240");
    svg.firstChild.textContent = `${doc.activity} …`;
    return;
  }
  const grid = `${doc.pixels.percent.length}x${doc.pixels.percent[0].length}/${doc.pixels.finger_of_row}`;
  if (built !== grid || !$("pad-0")) {
    build(svg, doc);
    built = grid;
    chosen = null;
  }
  const between = place(svg, doc), hand = doc.hand;
  $("object").innerHTML = between ? object(between, doc) : "";
  const opening = $("opening");
  opening.setAttribute("x", between ? between.middle : 0);
  opening.textContent = !between || hand.value === null ? "" : [...(doc.source.subject ? [doc.source.subject.replace(/-/g, " ")] : []), between.scale ? t("{width} mm apart", { width: fixed(hand.value, 1) }) : `${fixed(hand.value, 1)} kPa`, ...(hand.moving ? ["moving"] : [])].join(", ");
  namePads(svg, doc);
  drawCells(svg, doc);
  drawChosen(doc);
  const at = doc.pointed_s === undefined ? "" : ` at ${fixed(doc.pointed_s, 1)} s`;
  $("fingers-title").textContent = between ? `Fingers${at || ", view from the object"}` : pads.length === 1 ? "Pad" : t("{n} pads", { n: pads.length });
}
