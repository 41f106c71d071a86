"""Sorting rules: decision from the evidence, repeated grasps and score."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from functools import cache

import numpy as np
import pytest
from packages.station.tests.factories import NOON, make_grasp

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate_station.identify.identifier import Identifier, Identity
from palpate_station.learning import UNKNOWN
from palpate_station.records import About, Verdict
from palpate_station.sorting.conditions import Evidence, OneOf, Within
from palpate_station.sorting.hand import TimedGrasp
from palpate_station.sorting.rules import Rule, RuleBook, decide
from palpate_station.sorting.run import bin_verdict, combine_evidence, sort_item
from palpate_station.sorting.score import Placed, find_true_bin, score_sorting

KIWIS, RIPE = OneOf("class", frozenset({"kiwi"})), OneOf("ripeness", frozenset({"ripe"}))
KIWI = Rule(bin="kiwi", conditions=(KIWIS,), line=3)
LIME = Rule(bin="lime", conditions=(OneOf("class", frozenset({"lime"})),), line=6)
UNKNOWN_RULE = Rule(bin="strangers", conditions=(OneOf("class", frozenset({UNKNOWN})),), line=9)


def book_of(*rules: Rule, most_grasps: int = 3) -> RuleBook:
    return RuleBook(rules=rules, default_bin="by hand", most_grasps=most_grasps)


BOOK = book_of(KIWI, LIME, UNKNOWN_RULE)


def seen(kiwi: float, lime: float, *, rejected: bool = False, grasps: int = 1, **more) -> Evidence:
    probability = {"kiwi": kiwi, "lime": lime, UNKNOWN: 1 - kiwi - lime}
    best = UNKNOWN if rejected else ("kiwi" if kiwi > lime else "lime")
    usual = 0.01 if rejected else 0.5
    identity = Identity(
        kind=best, probability=probability, usual=usual, rejected=rejected, grasps=1
    )
    return Evidence(identity=identity, grasps=grasps, **more)


def measured(value: float, low: float, high: float, unit: str) -> Measurement:
    return Measurement(value=value, low=low, high=high, unit=unit)


def grasp(size_mm: float, stiffness: float, *, outcome: Outcome = Outcome.HELD) -> TimedGrasp:
    found = {
        "size_mm": measured(size_mm, size_mm - 0.5, size_mm + 0.5, "mm"),
        "stiffness_n_per_mm": measured(stiffness, 0.8 * stiffness, 1.25 * stiffness, "n_per_mm"),
    }
    one = make_grasp("A1", outcome=outcome, measurements=found, calibration_id="monday")
    return TimedGrasp(grasp=one, lasted_s=10.0)


def test_decide_first_confident_rule_applies_with_reason() -> None:
    found = decide(BOOK, seen(0.95, 0.04))
    assert (found.bin, found.needs_regrasp, found.rule) == ("kiwi", False, KIWI)
    assert found.why == "kiwi: kiwi 95 %; rule on line 3 met with 95 %; 1 grasp"


def test_decide_ambiguous_kind_requests_grasps_up_to_the_limit() -> None:
    assert decide(BOOK, seen(0.55, 0.40)).needs_regrasp
    last = decide(BOOK, seen(0.55, 0.40, grasps=3))
    assert (last.bin, last.needs_regrasp, last.probability) == ("by hand", False, None)
    assert "kiwi 55 % or lime 40 %" in last.why
    assert "closest rule on line 3 (kiwi): 55 %, 80 % required" in last.why


def test_decide_unknown_item_is_grasped_twice() -> None:
    assert decide(BOOK, seen(0.2, 0.1, rejected=True)).needs_regrasp
    found = decide(BOOK, seen(0.2, 0.1, rejected=True, grasps=2))
    assert (found.bin, found.needs_regrasp) == ("strangers", False)


def test_decide_undecided_earlier_rule_requests_a_grasp() -> None:
    book = book_of(Rule(bin="small", conditions=(KIWIS, Within("size_mm", 0, 50)), line=1), KIWI)
    at_limit = seen(0.97, 0.02, size_mm=measured(50, 49.5, 50.5, "mm"))
    assert decide(book, at_limit).needs_regrasp
    assert decide(book, replace(at_limit, grasps=3)).bin == "kiwi"


def test_decide_missing_verdict_is_named_without_a_further_grasp() -> None:
    book = book_of(Rule(bin="ripe", conditions=(KIWIS, RIPE), line=2))
    found = decide(book, seen(0.97, 0.02))
    assert not found.needs_regrasp
    assert "the rule on line 2 requires a ripeness verdict" in found.why
    assert decide(book, seen(0.97, 0.02, ripeness={"ripe": 0.9})).bin == "ripe"


def test_decide_applies_firmness_conditions() -> None:
    firm = Rule(bin="firm", conditions=(Within("firmness", 50, 100),), line=2)
    book = book_of(firm, most_grasps=2)
    index = measured(60.0, 54.0, 66.0, "index")
    found = decide(book, Evidence(firmness=index, grasps=1))
    assert found.why.startswith("firm: firmness 60 (54 to 66) within 50 to 100; rule on line 2")
    wide = measured(55.0, 40.0, 70.0, "index")
    assert decide(book, Evidence(firmness=wide, grasps=1)).needs_regrasp
    one = grasp(50.0, 1.4).grasp
    firmer = replace(one, measurements={**one.measurements, "firmness": index})
    assert combine_evidence([firmer], identifier=None).firmness.value == 60.0


def test_decide_without_matching_rule_uses_the_default_bin() -> None:
    found = decide(book_of(LIME), seen(0.98, 0.01))
    assert (found.bin, found.needs_regrasp) == ("by hand", False)
    assert "no rule matches" in found.why


@cache
def identifier() -> Identifier:
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

    done = sort_item("A1", book=BOOK, identifier=identifier(), grasp=take)
    assert (done.decision.bin, len(done.grasps), done.grasping_s) == ("kiwi", 2, 20.0)
    assert expected_mm == [None, 48.0], "the second grasp uses the measured size"
    assert done.size_mm.value == pytest.approx(49.5)
    verdict = bin_verdict(done, given_at=NOON)
    assert (verdict.about, verdict.text, verdict.details["rule_line"]) == (About.BIN, "kiwi", 3)
    assert verdict.explanation == done.decision.why


def test_sort_item_slipped_grasps_count_without_evidence() -> None:
    slipped = grasp(50.0, 1.4, outcome=Outcome.SLIPPED)
    done = sort_item("A1", book=BOOK, identifier=identifier(), grasp=lambda turn, size: slipped)
    assert (done.decision.bin, done.identity, len(done.grasps)) == ("by hand", None, 3)


def test_sort_item_stated_kind_replaces_identification() -> None:
    done = sort_item(
        "A1", book=BOOK, identifier=None, grasp=lambda turn, size: grasp(20.0, 9.0), kind="lime"
    )
    assert (done.decision.bin, len(done.grasps)) == ("lime", 1)


def test_combine_evidence_uses_the_latest_verdict_of_each_subject() -> None:
    stages = {"ripe": 0.6, "overripe": 0.4}
    verdicts = [
        Verdict(
            item_id="A1",
            about=about,
            text=text,
            probability=probability,
            given_at=NOON + timedelta(hours=hours),
            details=details,
        )
        for about, text, probability, hours, details in (
            (About.BRUISE, "bruised", 0.9, 0, {}),
            (About.BRUISE, "sound", 0.7, 2, {}),
            (About.RIPENESS, "hard", 0.8, 0, {}),
            (About.RIPENESS, "ripe", 0.6, 1, {"probabilities": stages}),
        )
    ]
    known = combine_evidence([], identifier=None, verdicts=verdicts)
    assert known.bruised == pytest.approx(0.3)
    assert known.ripeness == stages
    assert combine_evidence([], identifier=None, verdicts=verdicts[2:3]).ripeness == {"hard": 0.8}


def test_score_sorting_returns_purity_and_items_per_hour() -> None:
    placed = [
        Placed(bin="kiwi", true_bin="kiwi", grasps=1, grasping_s=10.0),
        Placed(bin="kiwi", true_bin="lime", grasps=3, grasping_s=30.0),
        Placed(bin="by hand", true_bin="lime", grasps=1, grasping_s=10.0),
    ]
    found = score_sorting(placed, book=BOOK)
    assert (found.purity, found.left_over) == (0.5, pytest.approx(1 / 3))
    assert found.bins == {"kiwi": (2, 1), "by hand": (1, 0)}
    assert found.items_per_hour == pytest.approx(3600 * 3 / (50 + 3 * 4 + 2 * 1.5))
    assert score_sorting(placed[2:], book=BOOK).purity is None
    with pytest.raises(ValueError, match="no sorted item"):
        score_sorting([], book=BOOK)
    assert find_true_bin(BOOK, kind="kiwi", is_trained=True, size_mm=50) == "kiwi"
    assert find_true_bin(BOOK, kind="walnut", is_trained=False, size_mm=33) == "strangers"
    assert find_true_bin(BOOK, kind="egg", is_trained=True, size_mm=44) == "by hand"
