// A replay whose curves stay on this page, to be seen together with those of the next, contact on contact.
import { $, seen } from "/static/poll.js";
import { t } from "/static/words.js";

let kept = null, shown = null;

// What times are counted from: the contact, where there is one.
export function zeroOf(doc) {
  const grasp = doc.replay ? doc.replay.grasp : doc.grasp;
  return grasp ? (grasp.touched_s ?? grasp.began_s) : seen.curve.length ? seen.curve[0][0] : 0;
}

// The kept curve on the time axis of what is shown now; nothing where that has no contact yet.
export function keptAt(zero, touched) {
  return kept && touched ? kept.points.map(([time, ...rest]) => [time + zero, ...rest]) : [];
}

export function begin() {
  document.addEventListener("click", (event) => {
    if (!event.target.closest?.("#keep") || !shown) return;
    const zero = zeroOf(shown);
    kept = kept ? null : { name: shown.source.name.replace(/\.mcap$/, ""), points: seen.curve.map(([time, ...rest]) => [time - zero, ...rest]) };
    drawKept(shown);
  });
}

export function drawKept(doc) {
  shown = doc;
  const button = $("keep");
  if (!button) return;
  button.ariaPressed = kept !== null;
  const [act, what] = kept ? ["Stop", " comparing"] : ["Keep", " to compare"];
  if (button.ariaLabel !== act + what) Object.assign(button, { ariaLabel: act + what, innerHTML: `${act}<span>${what}</span>` });
  // Without a contact no kept curve is drawn.
  const grasp = doc.replay ? doc.replay.grasp : doc.grasp, drawn = kept !== null && typeof grasp?.touched_s === "number";
  for (const key of document.querySelectorAll(".kept-key")) {
    key.classList.toggle("hidden", !drawn);
    key.lastElementChild.textContent = kept?.name ?? "";
  }
}
