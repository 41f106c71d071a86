// The operator's view: one verdict, what to do next, and the force, to be read from two metres.
import { $, fixed, follow, say, whys } from "/static/follow.js";

function draw(doc) {
  const { verdict, operator, measured } = doc, card = $("verdict");
  card.dataset.kind = verdict.kind;
  $("shape").setAttribute("href", `#shape-${verdict.kind}`);
  say($("verdict-text"), operator.word);
  say($("verdict-why"), [verdict.text, ...whys(doc)].filter((part) => part.toLowerCase() !== operator.word.toLowerCase()).join(" · "));
  say($("next-text"), operator.next);
  const gripping = ["grasping", "replaying"].includes(doc.activity);
  say($("force-now"), fixed(gripping && measured.force_now ? measured.force_now.value : null, 1));
  say($("force-target"), `target: ${operator.target}`);
}

follow(draw);
