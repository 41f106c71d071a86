"""The simulated servo current: gear friction in motion and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.arrays import FloatArray
from palpate.twin.devices import ServoCurrent
from palpate.twin.ranges import LAB, Ranges

#: No temperature effect; 40 mA of friction, independent of the load.
PLAIN = replace(
    LAB,
    servo_friction_ma=(40.0, 40.0),
    servo_friction_fraction=(0.0, 0.0),
    servo_friction_ripple=(0.0, 0.0),
    servo_friction_movement_sd=(0.0, 0.0),
    servo_warm_fraction=(0.0, 0.0),
)


def _current(ranges: Ranges, *, session: int = 1) -> ServoCurrent:
    return ServoCurrent(ranges, servo_seed=0, session_seed=session, start_s=0.0)


def _sweep(current: ServoCurrent, widths_mm: FloatArray) -> FloatArray:
    return np.array(
        [current.read_ma(0.0, force_n=0.0, width_mm=width, moving=True) for width in widths_mm]
    )


def test_servo_current_friction_sign_follows_direction() -> None:
    current = _current(PLAIN)
    assert _sweep(current, np.arange(60.0, 20.0, -0.1))[1:].mean() == pytest.approx(40.0, abs=1.0)
    assert _sweep(current, np.arange(20.0, 60.0, 0.1))[1:].mean() == pytest.approx(-40.0, abs=1.0)


def test_servo_current_friction_varies_between_movements() -> None:
    current = _current(replace(PLAIN, servo_friction_movement_sd=(0.2, 0.2)))
    closing, opening = np.arange(60.0, 50.0, -0.1), np.arange(50.0, 60.0, 0.1)
    means = []
    for _ in range(60):
        means.append(_sweep(current, closing)[1:].mean())
        _sweep(current, opening)
    assert np.std(np.log(means)) == pytest.approx(0.2, rel=0.25)


def test_servo_current_ripple_repeats_with_position() -> None:
    ranges = replace(PLAIN, servo_friction_ripple=(0.25, 0.25), servo_friction_period_mm=(5.0, 5.0))
    widths_mm = np.arange(60.0, 20.0, -0.05)
    one, other = (_sweep(_current(ranges, session=session), widths_mm) for session in (1, 2))
    assert np.corrcoef(one[1:], other[1:])[0, 1] > 0.4
    assert np.std(one[1:]) > 40.0 * 0.25 / np.sqrt(2)


def test_servo_current_at_rest_is_constant_within_friction_band() -> None:
    current, held = _current(PLAIN), []
    for number in range(80):
        width_mm = 60.0 - 0.1 * number
        reads = [
            current.read_ma(0.0, force_n=0.0, width_mm=width_mm, moving=False) for _ in range(12)
        ]
        held.append(np.mean(reads[1:] if number else reads))
    assert min(held[1:]) < -30.0
    assert max(held[1:]) > 30.0
    assert np.std(held[1:]) == pytest.approx(40.0 / np.sqrt(3), rel=0.2)
