"""What an item is: probabilities, doubts, and what is none of the kinds taught."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import (
    UNKNOWN,
    FeaturePoint,
    Identifier,
    TaughtItem,
    as_labelled,
    put_together,
    touch_of,
)

#: ln of size and stiffness of two kinds that differ in size, and one that differs in stiffness.
KINDS = {"small": (3.2, 1.0), "large": (4.1, 1.0), "hard": (4.1, 2.5)}
SPREAD, ERROR = 0.08, 0.10


def touch(
    value: Sequence[float], *, sd: float = ERROR, calibration: str = "monday"
) -> FeaturePoint:
    return FeaturePoint(value=np.array(value), sd=np.full(2, sd), calibration=calibration)


def felt(
    rng: np.random.Generator, kind: str, *, grasps: int = 2, shift: float = 0.0, sd: float = ERROR
) -> tuple[FeaturePoint, ...]:
    """Grasps of one item; the calibration's own error shifts all of them alike."""
    true = np.array(KINDS[kind]) + SPREAD * rng.standard_normal(2) + shift
    return tuple(
        touch((true + 0.03 * rng.standard_normal(2)).tolist(), sd=sd) for _ in range(grasps)
    )


def taught(rng: np.random.Generator, *, items: int = 20, shift: float = 0.0) -> list[TaughtItem]:
    return [
        TaughtItem(kind=kind, touches=felt(rng, kind, shift=shift))
        for kind in KINDS
        for _ in range(items)
    ]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def test_known_kinds_are_named_and_seldom_rejected(rng: np.random.Generator) -> None:
    known = Identifier(taught(rng))
    said = [(kind, known.identify(felt(rng, kind))) for kind in KINDS for _ in range(100)]
    assert np.mean([identity.best_guess == kind for kind, identity in said]) > 0.97
    assert np.mean([identity.rejected for _, identity in said]) <= 0.09


def test_a_stranger_is_unknown_and_says_so(rng: np.random.Generator) -> None:
    identity = Identifier(taught(rng)).identify([touch((5.5, -1.0))])
    assert identity.rejected
    assert identity.kind == UNKNOWN
    assert identity.usual <= 0.05
    assert identity.confidence == pytest.approx(1 - identity.usual)


def test_probabilities_sum_to_one_with_something_else_among_them(rng: np.random.Generator) -> None:
    identity = Identifier(taught(rng)).identify([touch((3.6, 1.0))])
    assert sum(identity.probability.values()) == pytest.approx(1.0)
    assert set(identity.probability) == {*KINDS, UNKNOWN}
    assert identity.probability[UNKNOWN] > 0.2


def test_a_wide_interval_spreads_the_probability(rng: np.random.Generator) -> None:
    known = Identifier(taught(rng))
    sharp, wide = (known.identify([touch((3.3, 1.0), sd=sd)]) for sd in (0.05, 4.0))
    assert sharp.probability["small"] > 0.85
    assert wide.probability["small"] < 0.6
    assert wide.probability["large"] > 5 * sharp.probability["large"]


def test_the_common_error_counts_in_full_under_another_calibration(
    rng: np.random.Generator,
) -> None:
    known = Identifier(taught(rng))
    at = (3.45, 1.0)
    same = known.identify([touch(at, sd=0.4)])
    other = known.identify([touch(at, sd=0.4, calibration="tuesday")])
    assert other.probability["small"] < same.probability["small"]
    many = known.identify([touch(at, sd=0.4, calibration="tuesday")] * 50)
    assert many.probability["small"] < same.probability["small"], "it does not average away"


def test_repeated_grasps_tell_how_much_of_the_error_is_their_own(rng: np.random.Generator) -> None:
    # Grasps of one item scatter by 0.03, and 0.10 is stated.
    assert Identifier(taught(rng)).own_share == pytest.approx(0.09 + 0.03, abs=0.04)
    single = [TaughtItem(kind=i.kind, touches=i.touches[:1]) for i in taught(rng)]
    assert Identifier(single).own_share == pytest.approx(0.5)


def test_an_error_that_all_taught_items_share_drops_out(rng: np.random.Generator) -> None:
    known = Identifier(taught(rng, shift=0.5))
    said = [known.identify(felt(rng, kind, shift=0.5)).kind == kind for kind in KINDS]
    assert all(said)


def test_nothing_is_rejected_by_too_few_taught_items(rng: np.random.Generator) -> None:
    known = Identifier(taught(rng, items=5))
    assert known.items_missing == 4
    assert not known.identify([touch((9.0, -5.0))]).rejected
    assert Identifier(taught(rng, items=7)).items_missing == 0


def test_a_kind_with_too_few_items_is_named(rng: np.random.Generator) -> None:
    few = [*taught(rng), TaughtItem(kind="rare", touches=felt(rng, "hard"))]
    with pytest.raises(InputError, match="found rare 1; label more"):
        Identifier(few)
    with pytest.raises(InputError, match="found none at all"):
        Identifier([])


def test_an_item_without_a_grasp_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match="never grasped"):
        Identifier(taught(rng)).identify([])


def test_a_label_is_certain() -> None:
    assert as_labelled("kiwi").probability == {"kiwi": 1.0}
    assert as_labelled(UNKNOWN).rejected


def test_a_touch_needs_every_feature() -> None:
    size = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    nothing = Measurement(value=0.0, low=0.0, high=1.0, unit="n_per_mm")
    features = ("size_mm", "stiffness_n_per_mm")
    measured = {"size_mm": size, "stiffness_n_per_mm": nothing}
    assert touch_of({"size_mm": size}, features=features, calibration="a") is None
    assert touch_of(measured, features=features, calibration="a") is None


def test_averaging_leaves_the_common_error() -> None:
    one = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    assert put_together([one] * 100, own_share=1.0).high == pytest.approx(40.1)
    assert put_together([one] * 100, own_share=0.0).high == pytest.approx(41.0)
