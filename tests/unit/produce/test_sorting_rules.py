"""Sorting rules: decision from the evidence, repeated grasps and score."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from tests.factories import NOON, make_grasp

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.produce.identify.identifier import Identifier, Identity
from palpate.produce.learning import UNKNOWN
from palpate.produce.records import About, Verdict
from palpate.produce.sorting.conditions import Evidence, OneOf, Within
from palpate.produce.sorting.hand import TimedGrasp
from palpate.produce.sorting.rules import Rule, RuleBook, decide
from palpate.produce.sorting.run import bin_verdict, combine_evidence, sort_item
from palpate.produce.sorting.score import Placed, find_true_bin, score_sorting

KIWIS, RIPE = OneOf("class", frozenset({"kiwi"})), OneOf("ripeness", frozenset({"ripe"}))
KIWI = Rule(bin="kiwi", conditions=(KIWIS,), line=3)
LIME = Rule(bin="lime", conditions=(OneOf("class", frozenset({"lime"})),), line=6)
UNKNOWN_RULE = Rule(bin="strangers", conditions=(OneOf("class", frozenset({UNKNOWN})),), line=9)
BOOK = RuleBook(rules=(KIWI, LIME, UNKNOWN_RULE), default_bin="by hand")


def identity_of(kiwi: float, lime: float, *, rejected: bool = False) -> Identity:
    probability = {"kiwi": kiwi, "lime": lime, UNKNOWN: 1 - kiwi - lime}
    best = UNKNOWN if rejected else ("kiwi" if kiwi > lime else "lime")
    usual = 0.01 if rejected else 0.5
    return Identity(kind=best, probability=probability, usual=usual, rejected=rejected, grasps=1)


def mm(value: float, half: float = 0.5) -> Measurement:
    return Measurement(value=value, low=value - half, high=value + half, unit="mm")


def grasp(size_mm: float, stiffness: float, *, outcome: Outcome = Outcome.HELD) -> TimedGrasp:
    low, high = 0.8 * stiffness, 1.25 * stiffness
    measured = Measurement(value=stiffness, low=low, high=high, unit="n_per_mm")
    one = make_grasp(
        "A1",
        rig="test",
        outcome=outcome,
        measurements={"size_mm": mm(size_mm), "stiffness_n_per_mm": measured},
        calibration_id="monday",
    )
    return TimedGrasp(grasp=one, lasted_s=10.0)


def test_decide_first_confident_rule_applies_with_reason() -> None:
    found = decide(BOOK, Evidence(identity=identity_of(0.95, 0.04), grasps=1))
    assert (found.bin, found.needs_regrasp, found.rule) == ("kiwi", False, KIWI)
    assert found.why == "kiwi: kiwi 95 %; rule on line 3 met with 95 %; 1 grasp"


def test_decide_ambiguous_kind_requests_grasps_up_to_the_limit() -> None:
    ambiguous = identity_of(0.55, 0.40)
    assert decide(BOOK, Evidence(identity=ambiguous, grasps=1)).needs_regrasp
    last = decide(BOOK, Evidence(identity=ambiguous, grasps=3))
    assert (last.bin, last.needs_regrasp, last.probability) == ("by hand", False, None)
    assert "kiwi 55 % or lime 40 %" in last.why
    assert "closest rule on line 3 (kiwi): 55 %, 80 % required" in last.why


def test_decide_unknown_item_is_grasped_twice() -> None:
    unknown = identity_of(0.2, 0.1, rejected=True)
    assert decide(BOOK, Evidence(identity=unknown, grasps=1)).needs_regrasp
    found = decide(BOOK, Evidence(identity=unknown, grasps=2))
    assert (found.bin, found.needs_regrasp) == ("strangers", False)


def test_decide_undecided_earlier_rule_requests_a_grasp() -> None:
    small = Rule(bin="small", conditions=(KIWIS, Within("size_mm", 0, 50)), line=1)
    book = RuleBook(rules=(small, KIWI), default_bin="by hand")
    at_limit = Evidence(identity=identity_of(0.97, 0.02), size_mm=mm(50), grasps=1)
    assert decide(book, at_limit).needs_regrasp
    after_last_grasp = Evidence(identity=identity_of(0.97, 0.02), size_mm=mm(50), grasps=3)
    assert decide(book, after_last_grasp).bin == "kiwi"


def test_decide_missing_verdict_is_named_without_a_further_grasp() -> None:
    ripe = Rule(bin="ripe", conditions=(KIWIS, RIPE), line=2)
    book = RuleBook(rules=(ripe,), default_bin="by hand")
    found = decide(book, Evidence(identity=identity_of(0.97, 0.02), grasps=1))
    assert not found.needs_regrasp
    assert "the rule on line 2 requires a ripeness verdict" in found.why
    known = Evidence(identity=identity_of(0.97, 0.02), ripeness={"ripe": 0.9}, grasps=1)
    assert decide(book, known).bin == "ripe"


def test_decide_applies_firmness_conditions() -> None:
    firm = Rule(bin="firm", conditions=(Within("firmness", 50, 100),), line=2)
    book = RuleBook(rules=(firm,), default_bin="by hand", most_grasps=2)
    index = Measurement(value=60.0, low=54.0, high=66.0, unit="index")
    found = decide(book, Evidence(firmness=index, grasps=1))
    assert found.why.startswith("firm: firmness 60 (54 to 66) within 50 to 100; rule on line 2")
    wide = Measurement(value=55.0, low=40.0, high=70.0, unit="index")
    assert decide(book, Evidence(firmness=wide, grasps=1)).needs_regrasp
    one = grasp(50.0, 1.4).grasp
    seen = combine_evidence(
        [replace(one, measurements={**one.measurements, "firmness": index})], identifier=None
    )
    assert seen.firmness.value == 60.0


def test_decide_without_matching_rule_uses_the_default_bin() -> None:
    book = RuleBook(rules=(LIME,), default_bin="by hand")
    found = decide(book, Evidence(identity=identity_of(0.98, 0.01), grasps=1))
    assert (found.bin, found.needs_regrasp) == ("by hand", False)
    assert "no rule matches" in found.why


def _identifier() -> Identifier:
    rng = np.random.default_rng(3)
    items = []
    for kind, ln_mm, ln_k in (("kiwi", np.log(50), np.log(1.5)), ("lime", np.log(45), np.log(4))):
        for _ in range(15):
            at = np.array([ln_mm, ln_k]) + np.array([0.04, 0.2]) * rng.standard_normal(2)
            items.append((kind, [at + 0.05 * rng.standard_normal(2) for _ in range(2)]))
    return Identifier(items)


def test_sort_item_grasps_until_a_rule_applies() -> None:
    results = [grasp(48.0, 2.3), grasp(51.0, 1.2), grasp(51.0, 1.2)]
    expected_mm: list[float | None] = []

    def take(turn: int, size: Measurement | None) -> TimedGrasp:
        expected_mm.append(None if size is None else size.value)
        return results[turn]

    done = sort_item("A1", book=BOOK, identifier=_identifier(), grasp=take)
    assert done.decision.bin == "kiwi"
    assert len(done.grasps) == 2
    assert done.grasping_s == 20.0
    assert expected_mm == [None, 48.0], "the second grasp uses the measured size"
    assert done.size_mm.value == pytest.approx(49.5)


def test_sort_item_slipped_grasps_count_without_evidence() -> None:
    slipped = grasp(50.0, 1.4, outcome=Outcome.SLIPPED)
    done = sort_item("A1", book=BOOK, identifier=_identifier(), grasp=lambda turn, size: slipped)
    assert (done.decision.bin, done.identity, len(done.grasps)) == ("by hand", None, 3)


def test_sort_item_stated_kind_replaces_identification() -> None:
    done = sort_item(
        "A1", book=BOOK, identifier=None, grasp=lambda turn, size: grasp(20.0, 9.0), kind="lime"
    )
    assert (done.decision.bin, len(done.grasps)) == ("lime", 1)


def make_verdict(
    about: About, text: str, probability: float | None, *, hours: int = 0, **details: object
) -> Verdict:
    return Verdict(
        item_id="A1",
        about=about,
        text=text,
        probability=probability,
        given_at=NOON + timedelta(hours=hours),
        details=details,
    )


def test_combine_evidence_uses_the_latest_verdict_of_each_subject() -> None:
    stages = {"ripe": 0.6, "overripe": 0.4}
    verdicts = [
        make_verdict(About.BRUISE, "bruised", 0.9),
        make_verdict(About.BRUISE, "sound", 0.7, hours=2),
        make_verdict(About.RIPENESS, "hard", 0.8),
        make_verdict(About.RIPENESS, "ripe", 0.6, hours=1, probabilities=stages),
    ]
    known = combine_evidence([], identifier=None, verdicts=verdicts)
    assert known.bruised == pytest.approx(0.3)
    assert known.ripeness == stages
    assert combine_evidence([], identifier=None, verdicts=verdicts[2:3]).ripeness == {"hard": 0.8}


def test_bin_verdict_contains_bin_rule_line_and_reason() -> None:
    done = sort_item("A1", book=BOOK, identifier=_identifier(), grasp=lambda t, s: grasp(50, 1.4))
    verdict = bin_verdict(done, given_at=NOON)
    assert (verdict.about, verdict.text, verdict.details["rule_line"]) == (About.BIN, "kiwi", 3)
    assert verdict.explanation == done.decision.why


def test_score_sorting_returns_purity_and_items_per_hour() -> None:
    placed = [
        Placed(bin="kiwi", true_bin="kiwi", grasps=1, grasping_s=10.0),
        Placed(bin="kiwi", true_bin="lime", grasps=3, grasping_s=30.0),
        Placed(bin="by hand", true_bin="lime", grasps=1, grasping_s=10.0),
    ]
    found = score_sorting(placed, book=BOOK)
    assert found.purity == 0.5
    assert found.left_over == pytest.approx(1 / 3)
    assert found.bins == {"kiwi": (2, 1), "by hand": (1, 0)}
    assert found.items_per_hour == pytest.approx(3600 * 3 / (50 + 3 * 4 + 2 * 1.5))
    assert score_sorting(placed[2:], book=BOOK).purity is None
    with pytest.raises(ValueError, match="no sorted item"):
        score_sorting([], book=BOOK)


def test_find_true_bin_follows_the_rules() -> None:
    assert find_true_bin(BOOK, kind="kiwi", is_trained=True, size_mm=50) == "kiwi"
    assert find_true_bin(BOOK, kind="walnut", is_trained=False, size_mm=33) == "strangers"
    assert find_true_bin(BOOK, kind="egg", is_trained=True, size_mm=44) == "by hand"
