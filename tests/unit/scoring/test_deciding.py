"""Decision time: the first prediction with a sufficiently narrow interval."""

from __future__ import annotations

import numpy as np

from palpate.measurement import Status
from palpate.scoring.deciding import EARLIEST_S, find_decision
from palpate.settling.relaxation import Relaxation

TIME_S = np.arange(0.0, 21.0, 0.07)
HOLD = 100.0 - 4.0 * np.log(TIME_S + 0.5)


def test_find_decision_smaller_half_width_decides_later() -> None:
    loose, strict = (
        find_decision(TIME_S, HOLD, method=Relaxation(), half_width_percent=percent)
        for percent in (8.0, 2.0)
    )
    assert loose.decided
    assert strict.decided
    assert EARLIEST_S < loose.time_s < strict.time_s
    half_width = (strict.estimate.high - strict.estimate.low) / 2
    assert half_width <= 0.02 * strict.estimate.value


def test_find_decision_ignores_later_samples() -> None:
    decision = find_decision(TIME_S, HOLD, method=Relaxation(), half_width_percent=4.0)
    changed = np.where(decision.time_s < TIME_S, 1e6, HOLD)
    second = find_decision(TIME_S, changed, method=Relaxation(), half_width_percent=4.0)
    assert second.time_s == decision.time_s
    assert second.estimate.value == decision.estimate.value


def test_find_decision_constant_hold_is_not_decided() -> None:
    decision = find_decision(
        TIME_S, np.full_like(TIME_S, 5.0), method=Relaxation(), half_width_percent=1.0
    )
    assert not decision.decided
    assert decision.estimate.status is Status.NOT_SETTLING
