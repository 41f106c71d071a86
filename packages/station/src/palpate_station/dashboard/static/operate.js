// The operator's page: verdict, next step and force, readable from two metres.
import { $, fit, follow, handState, headline, joined, setText, reasons } from "/static/poll.js";
import { begin as beginSound, sound } from "/static/sound.js";
import { fixed, t } from "/static/words.js";

// The part of the headline that does not repeat the word above it.
function headlineDetail(word, text) {
  const [short, long] = [word.toLowerCase(), text.toLowerCase()];
  return long.endsWith(short) || long.startsWith(`${short} `) ? "" : long.startsWith(`${short}: `) ? text.slice(short.length + 2) : text;
}

function draw(doc) {
  const { verdict, operator, measured } = doc, card = $("verdict");
  if (!card.dataset.fits) [card, $("lost")].forEach(fit);
  card.dataset.kind = verdict.kind;
  $("shape").setAttribute("href", `#shape-${verdict.kind}`);
  card.dataset.bin = Boolean(verdict.bin);
  headline(card, $("verdict-text"), operator.word);
  setText($("verdict-firm"), joined(verdict.measured));
  setText($("verdict-why"), [headlineDetail(operator.word, verdict.text), ...reasons(doc)].filter(Boolean).join("\u00a0· "));
  setText($("next-text"), operator.next);
  // The force is shown if known (a stopped hand still presses), otherwise the state of the hand.
  const now = measured.force_now, state = now ? "" : handState(doc);
  setText($("force-now"), state || fixed(now?.value, 1));
  setText($("force-title"), now && doc.link.stale ? "Last force" : "Force now");
  setText($("force-unit"), state ? "" : "N");
  $("force-now").classList.toggle("words", Boolean(state));
  setText($("force-target"), doc.hand !== null ? t("target: {target}", operator) : now ? `90 %: ${t("{low} to {high}", { low: fixed(now.low, 1), high: fixed(now.high, 1) })}` : "");
}

beginSound();
follow((doc) => { draw(doc); sound(doc.verdict.kind); }, () => sound("lost"));
