"""Settling learned from a sensor's own holds, on invented sheets that settle in their own way."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.holds import Hold
from palpate.settling.conformal import PROVING_HOLDS
from palpate.settling.own import OwnRelaxation
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray, Status

TIME_S = np.arange(1, 303) / 15.0


def holds(seed: int, count: int, *, noise: float = 0.03) -> FloatArray:
    """Sheets that gain a fifth between 2.5 s and 20 s, late: no general prior expects that."""
    rng = np.random.default_rng(seed)
    level = -rng.uniform(20, 60, count)[:, None]
    share = 0.3 * np.exp(0.1 * rng.standard_normal(count))[:, None]
    shape = 1.0 - share * np.exp(-((TIME_S / 9.0) ** 1.5))
    return np.asarray(level * shape + noise * rng.standard_normal((count, TIME_S.size)))


def named(values: FloatArray) -> tuple[Hold, ...]:
    return tuple(
        Hold(hold_id=str(place), channel=None, time_s=TIME_S, values=row)
        for place, row in enumerate(values)
    )


def settled(values: FloatArray) -> FloatArray:
    return np.asarray(values[:, (TIME_S > 19.5) & (TIME_S <= 20.0)].mean(axis=1))


@pytest.fixture(scope="module")
def own() -> OwnRelaxation:
    return OwnRelaxation(holds=named(holds(1, 20)))


def test_own_holds_beat_the_general_prior(own: OwnRelaxation) -> None:
    tested = holds(2, 20)
    errors = [
        np.abs(predict_settled(TIME_S, tested, cutoff_s=2.5, method=method).value - settled(tested))
        for method in (own, Relaxation())
    ]
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])


def test_intervals_cover_at_their_level(own: OwnRelaxation) -> None:
    tested = holds(3, 60)
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    truth = settled(tested)
    assert 0.85 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 1.0
    assert np.all(found.high - found.low < 0.3 * np.abs(truth))


def test_the_unit_does_not_matter(own: OwnRelaxation) -> None:
    tested = holds(4, 3)
    same = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    scaled = OwnRelaxation(holds=named(7.0 * holds(1, 20)))
    other = predict_settled(TIME_S, 7.0 * tested, cutoff_s=2.5, method=scaled)
    assert other.value == pytest.approx(7.0 * same.value, rel=1e-3)
    assert np.all(other.low < other.high)


def test_at_the_horizon_nothing_is_left_to_learn(own: OwnRelaxation) -> None:
    tested = holds(6, 2)
    found = predict_settled(TIME_S, tested, cutoff_s=20.0, method=own)
    assert found.value == pytest.approx(settled(tested), abs=0.1)


def test_no_holds_are_refused() -> None:
    with pytest.raises(CalibrationError, match="no hold to learn from"):
        OwnRelaxation(holds=())


def test_holds_that_end_too_early_teach_nothing() -> None:
    short = TIME_S < 10.0
    taught = tuple(
        Hold(hold_id=h.hold_id, channel=None, time_s=TIME_S[short], values=h.values[short])
        for h in named(holds(7, 5))
    )
    tested = holds(8, 2)
    found, general = (
        predict_settled(TIME_S, tested, cutoff_s=2.5, method=method)
        for method in (OwnRelaxation(holds=taught), Relaxation())
    )
    assert found.value.tolist() == general.value.tolist()


def creeping(count: int, *, tilt: float, seed: int = 10) -> list[Hold]:
    """Return holds in ohm that all lose the same share, of any size."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 20.5, 0.1)
    shape = 1.0 - tilt * np.log((time_s + 1.0) / 21.0)
    return [
        Hold(
            hold_id=str(number),
            channel=None,
            time_s=time_s,
            values=rng.uniform(100, 900) * shape * (1 + 2e-4 * rng.standard_normal(time_s.size)),
        )
        for number in range(count)
    ]


def test_more_own_holds_narrow_the_interval() -> None:
    *past, hold = creeping(25, tilt=0.05)
    widths = []
    for count in (3, 6, 12, 24):
        found = predict_settled(hold, method=OwnRelaxation(holds=tuple(past[:count])))
        assert found.low < hold.values[197:201].mean() < found.high
        widths.append(float(found.high - found.low))
    assert widths == sorted(widths, reverse=True)


def test_a_constant_multiple_is_found_where_it_is_true() -> None:
    rng = np.random.default_rng(11)
    time_s = np.arange(0.0, 20.5, 0.1)
    # Contact rings in another way each time, and all that follows is one tenth less.
    holds = tuple(
        Hold(
            hold_id=str(number),
            channel=None,
            time_s=time_s,
            values=np.where(time_s < 10, 1.0 + rng.uniform(0.1, 0.9) * np.exp(-time_s), 0.9),
        )
        for number in range(13)
    )
    found = predict_settled(holds[-1], cutoff_s=9.0, method=OwnRelaxation(holds=holds[:-1]))
    assert found.value == pytest.approx(0.9, rel=0.003)


def test_own_holds_prove_an_interval() -> None:
    rng = np.random.default_rng(12)
    time_s = np.arange(0.0, 20.5, 0.1)
    holds = [
        Hold(
            hold_id=str(number),
            channel=None,
            time_s=time_s,
            values=100 * (1 + 0.3 * np.exp(-time_s / 2) + 2e-4 * rng.standard_normal(time_s.size)),
        )
        for number in range(PROVING_HOLDS + 1)
    ]
    *past, hold = holds
    assert predict_settled(hold, cutoff_s=5.0).status is Status.UNPROVEN
    few = OwnRelaxation(holds=tuple(past[:-1]))
    assert predict_settled(hold, cutoff_s=5.0, method=few).status is Status.UNPROVEN
    enough = OwnRelaxation(holds=tuple(past))
    assert predict_settled(hold, cutoff_s=5.0, method=enough).status is Status.OK


def test_past_holds_without_a_sample_before_the_cutoff_count_nothing() -> None:
    late = tuple(
        Hold(hold_id=h.hold_id, channel=None, time_s=h.time_s[30:], values=h.values[30:])
        for h in creeping(4, tilt=0.05)
    )
    [hold] = creeping(1, tilt=0.05, seed=13)
    own = predict_settled(hold, cutoff_s=2.0, method=OwnRelaxation(holds=late))
    assert own.value == predict_settled(hold, cutoff_s=2.0).value
