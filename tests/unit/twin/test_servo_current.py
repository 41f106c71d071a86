"""The simulated servo current: gear friction in motion and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.arrays import FloatArray
from palpate.twin.devices import ServoCurrent
from palpate.twin.ranges import LAB

#: No temperature effect; 40 mA of friction, independent of the load.
PLAIN = replace(
    LAB,
    servo_friction_ma=(40.0, 40.0),
    servo_friction_fraction=(0.0, 0.0),
    servo_friction_ripple=(0.0, 0.0),
    servo_friction_movement_sd=(0.0, 0.0),
    servo_warm_fraction=(0.0, 0.0),
)


@pytest.fixture
def current() -> ServoCurrent:
    return ServoCurrent(PLAIN, servo_seed=0, session_seed=1, start_s=0.0)


def sweep_ma(current: ServoCurrent, widths_mm: FloatArray) -> FloatArray:
    return np.array(
        [current.read_ma(0.0, force_n=0.0, width_mm=width, moving=True) for width in widths_mm]
    )


def test_servo_current_friction_sign_follows_direction(current: ServoCurrent) -> None:
    closing, opening = np.arange(60.0, 20.0, -0.1), np.arange(20.0, 60.0, 0.1)
    assert sweep_ma(current, closing)[1:].mean() == pytest.approx(40.0, abs=1.0)
    assert sweep_ma(current, opening)[1:].mean() == pytest.approx(-40.0, abs=1.0)


def test_servo_current_at_rest_is_constant_within_friction_band(current: ServoCurrent) -> None:
    held = []
    for number in range(80):
        width_mm = 60.0 - 0.1 * number
        reads = [
            current.read_ma(0.0, force_n=0.0, width_mm=width_mm, moving=False) for _ in range(12)
        ]
        held.append(np.mean(reads[1:] if number else reads))
    assert min(held[1:]) < -30.0
    assert max(held[1:]) > 30.0
    assert np.std(held[1:]) == pytest.approx(40.0 / np.sqrt(3), rel=0.2)
