// Keeps the curves of a replay for comparison with the next replay, aligned at the contact.
import { $, received } from "/static/poll.js";

let kept = null, shown = null;

// The shown grasp: replayed, running or last.
export const graspOf = (doc) => (doc.replay ? doc.replay.grasp : doc.grasp);

// The zero of the time axis: the contact, otherwise the start of the grasp or curve.
export function zeroOf(doc) {
  const grasp = graspOf(doc);
  return grasp ? (grasp.touched_s ?? grasp.began_s) : received.curve.length ? received.curve[0][0] : 0;
}

// The kept curve on the time axis of the shown grasp; empty before the contact.
export function keptAt(zero, touched) {
  return kept && touched ? kept.points.map(([time, ...rest]) => [time + zero, ...rest]) : [];
}

export function begin() {
  document.addEventListener("click", (event) => {
    if (!event.target.closest?.("#keep") || !shown) return;
    const zero = zeroOf(shown);
    kept = kept ? null : { name: shown.source.name.replace(/\.mcap$/, ""), points: received.curve.map(([time, ...rest]) => [time - zero, ...rest]) };
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
  // The kept curve is drawn only after a contact.
  const drawn = kept !== null && typeof graspOf(doc)?.touched_s === "number";
  for (const key of document.querySelectorAll(".kept-key")) {
    key.classList.toggle("hidden", !drawn);
    key.lastElementChild.textContent = kept?.name ?? "";
  }
}
