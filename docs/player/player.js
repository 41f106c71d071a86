// Plays the recorded simulated grasps of play.md, from the JSON that the page carries. No other file
// is loaded, so it also plays from a folder on a disk.
"use strict";
(() => {
  const place = document.getElementById("grasp-player"), data = document.getElementById("grasp-data");
  if (!place || !data) return;
  const recorded = JSON.parse(data.textContent);
  const SVG = "http://www.w3.org/2000/svg", DEEPEST = 80;
  const LEFT = 40, TOP = 26, RIGHT = 690, BOTTOM = 220, MIDDLE = 110, HALF = 80;
  const [TIME, PHASE, WIDTH, FORCE, LOW, HIGH, PIXELS] = recorded.grasps[0].columns.keys();
  let grasp, at_s = 0, playing = true, before = null, shown = {};

  const html = (name, set = {}, ...inside) => { const one = Object.assign(document.createElement(name), set); one.append(...inside); return one; };
  const draw = (name, set = {}, text = "") => {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(set)) one.setAttribute(key, value);
    one.textContent = text;
    return one;
  };

  function color(percent) {
    if (percent === null) return "#8a8a8a";
    const stops = percent <= 0 ? recorded.fall : recorded.rise;
    const where = Math.min(Math.abs(percent) / DEEPEST, 1) * (stops.length - 1), low = Math.min(Math.floor(where), stops.length - 2);
    return `rgb(${stops[low].map((from, k) => Math.round(from + (where - low) * (stops[low + 1][k] - from))).join(" ")})`;
  }

  const last = () => grasp.moments[grasp.moments.length - 1];
  const x = (time_s) => LEFT + (RIGHT - LEFT) * time_s / last()[TIME];
  const highest = () => 1.1 * Math.max(1, ...grasp.moments.map((m) => m[HIGH] ?? 0));
  const y = (force_n) => BOTTOM - (BOTTOM - TOP) * force_n / highest();

  function drawHand() {
    const hand = draw("svg", { viewBox: "0 0 220 120", class: "hand", role: "img", "aria-label": "gripper" });
    const held = grasp.moments.find((m) => m[PHASE] === "squeeze") ?? last(), scale = HALF / Math.max(...grasp.moments.map((m) => m[WIDTH]));
    hand.append(draw("ellipse", { cx: MIDDLE, cy: 60, rx: held[WIDTH] * scale, ry: 36, fill: "#f3c9c1", stroke: "#6b7280" }));
    shown.fingers = [-1, 1].map((side) => [side, scale, draw("rect", { y: 18, width: 12, height: 84, rx: 3, fill: "currentColor" })]);
    hand.append(...shown.fingers.map(([, , bar]) => bar));
    return hand;
  }

  function drawPixels() {
    const columns = grasp.moments[0][PIXELS].length / grasp.finger_of_row.length;
    shown.pixels = grasp.moments[0][PIXELS].map(() => html("span"));
    const fingers = [...new Set(grasp.finger_of_row)].map((finger) => {
      const of = shown.pixels.filter((_, index) => grasp.finger_of_row[Math.floor(index / columns)] === finger);
      return html("div", { className: "finger", style: `grid-template-columns: repeat(${columns}, 3.6rem)` }, ...of);
    });
    return html("div", { className: "fingers" }, ...fingers);
  }

  function drawChart() {
    const chart = draw("svg", { viewBox: "0 0 700 250", class: "chart", role: "img", "aria-label": "grip force over time with its 90 % interval" });
    const label = (at, up, text, anchor = "middle") => draw("text", { x: at, y: up, "text-anchor": anchor, fill: "currentColor" }, text);
    const rule = (x1, y1, x2, y2, set = {}) => draw("line", { x1, y1, x2, y2, stroke: "currentColor", opacity: 0.2, ...set });
    for (let n = 0; n <= highest(); n += 1) chart.append(rule(LEFT, y(n), RIGHT, y(n)), label(LEFT - 6, y(n) + 4, n, "end"));
    for (let s = 0; s <= last()[TIME]; s += 1) chart.append(label(x(s), BOTTOM + 16, s));
    chart.append(label(LEFT - 6, TOP - 10, "N", "end"), label(RIGHT, BOTTOM + 30, "s", "end"));
    chart.append(rule(LEFT, y(grasp.target_n), RIGHT, y(grasp.target_n), { stroke: "#d55e00", opacity: 1, "stroke-dasharray": "5 4" }));
    chart.append(Object.assign(label(LEFT + 4, y(grasp.target_n) - 5, `target ${grasp.target_n} N`, "start")));
    shown.band = draw("polygon", { fill: "#2f8fd0", opacity: 0.3 });
    shown.curve = draw("polyline", { fill: "none", stroke: "#2f8fd0", "stroke-width": 2 });
    shown.now = rule(0, TOP, 0, BOTTOM, { opacity: 0.6 });
    chart.append(shown.band, shown.curve, shown.now);
    return chart;
  }

  function choose(index) {
    grasp = recorded.grasps[index];
    at_s = 0;
    shown.scene.replaceChildren(html("div", { className: "left" }, drawHand(), drawPixels()), drawChart());
    shown.slider.max = last()[TIME];
    update();
  }

  function update() {
    const past = grasp.moments.filter((m) => m[TIME] <= at_s), now = past[past.length - 1] ?? grasp.moments[0], known = past.filter((m) => m[FORCE] !== null);
    for (const [side, scale, bar] of shown.fingers) bar.setAttribute("x", MIDDLE + side * now[WIDTH] * scale - (side < 0 ? 12 : 0));
    shown.pixels.forEach((pixel, index) => {
      const percent = now[PIXELS][index];
      pixel.textContent = percent === null ? "open" : `${percent} %`;
      pixel.style.background = color(percent);
      pixel.style.color = percent !== null && percent < -45 ? "#000" : "#fff";
    });
    shown.band.setAttribute("points", [...known.map((m) => `${x(m[TIME])},${y(m[LOW])}`), ...known.reverse().map((m) => `${x(m[TIME])},${y(m[HIGH])}`)].join(" "));
    shown.curve.setAttribute("points", known.map((m) => `${x(m[TIME])},${y(m[FORCE])}`).join(" "));
    for (const end of ["x1", "x2"]) shown.now.setAttribute(end, x(now[TIME]));
    const force = now[FORCE] === null ? "" : `, ${now[FORCE].toFixed(2)} N (90 %: ${now[LOW].toFixed(2)} to ${now[HIGH].toFixed(2)})`;
    shown.state.textContent = `${now[TIME].toFixed(1)} s, ${now[PHASE]}, ${now[WIDTH].toFixed(1)} mm${force}`;
    const isOver = now[PHASE] === "release";
    shown.verdict.textContent = isOver ? grasp.verdict : "";
    const rows = isOver ? grasp.answers.map(([name, unit, value, low, high, truth]) => html("li", {}, `${name} ${value} ${unit} (90 %: ${low} to ${high}), true value ${truth ?? "not known"}`)) : [];
    shown.answers.replaceChildren(...rows);
    shown.slider.value = at_s;
    shown.play.textContent = playing ? "Pause" : "Play";
  }

  function step(time_ms) {
    if (playing && before !== null) {
      at_s += (time_ms - before) / 1000 * Number(shown.speed.value);
      // A pause at the end, to read the verdict.
      if (at_s > last()[TIME] + 4) at_s = 0;
      update();
    }
    before = time_ms;
    requestAnimationFrame(step);
  }

  const option = (value, text) => html("option", { value, textContent: text });
  shown.scene = html("div", { className: "scene" });
  shown.play = html("button", { type: "button", onclick: () => { playing = !playing; update(); } });
  shown.slider = html("input", { type: "range", min: 0, step: 0.04, ariaLabel: "time", oninput: () => { playing = false; at_s = Number(shown.slider.value); update(); } });
  shown.speed = html("select", { ariaLabel: "speed" }, ...[0.25, 0.5, 1, 2].map((speed) => option(speed, `${speed} ×`)));
  shown.speed.value = 1;
  const chosen = html("select", { ariaLabel: "object", onchange: () => choose(chosen.value) }, ...recorded.grasps.map((one, index) => option(index, `${one.object} to ${one.target_n} N`)));
  shown.state = html("p", { className: "state" });
  shown.verdict = html("p", { className: "verdict" });
  shown.answers = html("ul");
  const label = html("strong", { textContent: "SIMULATED" });
  place.replaceChildren(html("div", { className: "controls" }, chosen, shown.play, shown.slider, shown.speed, label), shown.scene, shown.state, shown.verdict, shown.answers);
  playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  choose(0);
  requestAnimationFrame(step);
})();
