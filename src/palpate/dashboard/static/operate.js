// The operator's view: one verdict, what to do next, and the force, to be read from two metres.
import { $, fit, follow, handState, headline, joined, say, whys } from "/static/poll.js";
import { begin as beginSound, sound } from "/static/sound.js";
import { fixed, t } from "/static/words.js";

// What the headline adds to the word above it.
function beyond(word, text) {
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
  say($("verdict-firm"), verdict.bin ? joined(verdict.firmness) : "");
  say($("verdict-why"), [beyond(operator.word, verdict.text), ...whys(doc)].filter(Boolean).join("\u00a0· "));
  say($("next-text"), operator.next);
  // A hand that was stopped still presses; without a hand the pads are pressed by whatever lies on them.
  const now = measured.force_now, state = now ? "" : handState(doc);
  say($("force-now"), state || fixed(now?.value, 1));
  say($("force-unit"), state ? "" : "N");
  $("force-now").classList.toggle("words", Boolean(state));
  say($("force-target"), doc.hand !== null ? t("target: {target}", operator) : now ? `90 %: ${t("{low} to {high}", { low: fixed(now.low, 1), high: fixed(now.high, 1) })}` : "");
}

beginSound();
follow((doc) => { draw(doc); sound(doc.verdict.kind); }, () => sound("lost"));
