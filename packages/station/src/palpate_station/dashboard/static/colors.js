// The colour map of the pixels, provided by the server.
const MAP = JSON.parse(document.getElementById("pixel-colors").textContent);

export function color(percent) {
  const stops = percent <= 0 ? MAP.fall : MAP.rise;
  const place = Math.min(Math.abs(percent) / MAP.deepest_percent, 1) * (stops.length - 1);
  const below = Math.min(Math.floor(place), stops.length - 2);
  const rgb = stops[below].map((c, i) => Math.round(c + (place - below) * (stops[below + 1][i] - c)));
  const bright = 0.3 * rgb[0] + 0.6 * rgb[1] + 0.1 * rgb[2] > 120;
  return [`rgb(${rgb})`, bright ? "#111" : "#fff"];
}
