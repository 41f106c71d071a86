"""Intervals from calibration holds, for methods with and without an interval of their own."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.holds import Hold
from palpate.settling.baselines import Recorded
from palpate.settling.calibrated import Calibrated
from palpate.settling.exponential import Exponential

TIME_S = np.arange(0.0, 20.5, 0.1)
SEEN = TIME_S <= 2.5


def holds(count: int, *, seed: int, scale: float = 1.0) -> list[Hold]:
    rng = np.random.default_rng(seed)
    found = []
    for index in range(count):
        origin_s, speed = rng.uniform(0.1, 1.0), rng.uniform(1.0, 3.0)
        values = scale * (50 - speed * np.log(TIME_S + origin_s) + rng.normal(0, 0.02, TIME_S.size))
        found.append(Hold(hold_id=str(index), channel=None, time_s=TIME_S, values=values))
    return found


@pytest.mark.slow
def test_calibrated_widths_cover_new_holds_at_the_nominal_level() -> None:
    values = np.stack([hold.values for hold in holds(400, seed=2)])
    settled = values[:, (TIME_S >= 19.5) & (TIME_S <= 20)].mean(axis=1)
    for method in (Recorded(), Exponential()):
        calibrated = Calibrated(method=method, holds=holds(400, seed=1), learn=False)
        for level in (0.5, 0.9):
            found = calibrated.predict(TIME_S[SEEN], values[:, SEEN], horizon_s=20.0, level=level)
            covered = np.mean((found.low <= settled) & (settled <= found.high))
            assert abs(covered - level) < 0.08, (method.name, level)
            assert found.method == method.name


def test_calibrated_without_learning_keeps_values_and_scales_widths_with_the_unit() -> None:
    values = holds(1, seed=3)[0].values[None, SEEN]
    plain = Exponential().predict(TIME_S[SEEN], values, horizon_s=20.0, level=0.9)
    one = Calibrated(method=Exponential(), holds=holds(30, seed=1), learn=False)
    other = Calibrated(method=Exponential(), holds=holds(30, seed=1, scale=7.0), learn=False)
    found = one.predict(TIME_S[SEEN], values, horizon_s=20.0, level=0.9)
    scaled = other.predict(TIME_S[SEEN], 7.0 * values, horizon_s=20.0, level=0.9)
    assert found.value.tolist() == plain.value.tolist()
    assert np.allclose(scaled.low, 7.0 * found.low, rtol=1e-6)


def test_calibrated_with_too_few_holds_has_no_interval() -> None:
    values = holds(1, seed=3)[0].values[None, SEEN]

    def interval(method: Calibrated, level: float) -> float:
        return float(method.predict(TIME_S[SEEN], values, horizon_s=20.0, level=level).low[0])

    eight = Calibrated(method=Recorded(), holds=holds(8, seed=1), learn=False)
    assert np.isnan(interval(eight, 0.9))
    assert np.isfinite(interval(eight, 0.8))
    assert np.isnan(interval(Calibrated(method=Recorded(), holds=[], learn=False), 0.5))
