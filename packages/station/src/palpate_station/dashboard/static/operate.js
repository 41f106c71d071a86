// The operator's page: verdict, next step and force, readable from two metres.
import { $, esc, fit, follow, handState, headline, isDriver, joined, mayDrive, setText, reasons } from "/static/poll.js";
import { begin as beginSound, sound, warn } from "/static/sound.js";
import { fixed, w } from "/static/words.js";

// Time for which a screen without control reports a scan.
const IGNORED_MS = 8000;
let ignoredUntil = 0;

function draw(doc) {
  const { verdict, operator, measured } = doc, card = $("verdict"), isGrasping = doc.activity === "grasping";
  if (!card.dataset.fits) [card, $("lost"), $("next-step")].forEach(fit);
  card.dataset.kind = verdict.kind;
  $("shape").setAttribute("href", `#shape-${verdict.kind}`);
  card.dataset.bin = operator.is_bin;
  card.dataset.color = operator.color ?? "";
  setText($("verdict-item"), operator.item || (isGrasping ? doc.item : ""));
  headline(card, $("verdict-text"), operator.word);
  card.dataset.past = operator.is_past;
  setText($("badge"), operator.badge);
  setText($("verdict-firm"), joined(operator.measured));
  setText($("verdict-why"), [operator.is_past ? w("item.past") : "", joined(operator.detail), ...reasons(doc)].filter(Boolean).join("\u00a0· "));
  const isIgnored = performance.now() < ignoredUntil && !isDriver(doc);
  setText($("next-text"), isIgnored ? w(mayDrive() ? "scan.ignored" : "scan.ignored_view") : isDriver(doc) ? operator.next : mayDrive() || operator.watch !== w("watch.nobody") ? operator.watch : w("watch.view"));
  $("next-step").dataset.refused = isIgnored || (isDriver(doc) && operator.is_refused);
  $("next-step").dataset.watch = !isDriver(doc);
  setText($("opens"), operator.opens);
  // The end of a long name is its serial number.
  const field = document.querySelector("input.scanned");
  if (field && (field !== document.activeElement || field.selectionEnd === field.value.length)) field.scrollLeft = field.scrollWidth;
  // The force is shown if known (a stopped hand still presses), otherwise the state of the hand, which
  // is open for a moment when a grasp starts.
  const now = measured.force_now, state = now || (isGrasping && doc.hand?.open) ? "" : handState(doc);
  setText($("force-now"), state || fixed(now?.value, 1));
  setText($("force-title"), w(doc.link.stale ? "force.last" : "force.now"));
  setText($("force-unit"), state ? "" : "N");
  $("force-now").classList.toggle("words", Boolean(state));
  setText($("force-target"), doc.hand !== null ? w("target", operator) : now ? w("force.range", { low: fixed(now.low, 1), high: fixed(now.high, 1) }) : "");
}

// The line of the lot, and the alarms, which open as a list.
function drawStrip({ lot, alarms }) {
  setText($("lot"), lot);
  $("alarms").classList.toggle("hidden", !alarms.length);
  setText($("alarms-title"), w("alarms", { n: alarms.length }));
  const rows = alarms.map(([at, text]) => `<li><b>${esc(at)}</b> ${esc(text)}</li>`).reverse().join("");
  if ($("alarms-list").dataset.rows !== rows) Object.assign($("alarms-list"), { innerHTML: rows }).dataset.rows = rows;
}

beginSound();
window.addEventListener("palpate-scan-ignored", () => {
  ignoredUntil = performance.now() + IGNORED_MS;
  warn();
});
follow((doc) => { draw(doc); drawStrip(doc); sound(doc.verdict.kind, doc.alarm_count); }, () => sound("lost"));
