// The operator's view: one verdict, what to do next, and the force, to be read from two metres.
import { $, follow, headline, say, whys } from "/static/poll.js";
import { begin as beginKiosk } from "/static/kiosk.js";
import { begin as beginSound, sound } from "/static/sound.js";
import { fixed, t } from "/static/words.js";

function draw(doc) {
  const { verdict, operator, measured } = doc, card = $("verdict");
  card.dataset.kind = verdict.kind;
  $("shape").setAttribute("href", `#shape-${verdict.kind}`);
  headline(card, $("verdict-text"), operator.word);
  say($("verdict-why"), [verdict.text, ...whys(doc)].filter((part) => part.toLowerCase() !== operator.word.toLowerCase()).join(" · "));
  say($("next-text"), operator.next);
  const gripping = ["grasping", "replaying"].includes(doc.activity);
  say($("force-now"), fixed(gripping && measured.force_now ? measured.force_now.value : null, 1));
  say($("force-target"), t("target: {target}", operator));
}

beginKiosk();
beginSound();
follow((doc) => { draw(doc); sound(doc.verdict.kind); }, () => sound("lost"));
