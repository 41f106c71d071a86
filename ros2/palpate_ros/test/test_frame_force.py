"""Force of frames with saturated, open and unreadable pixels."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_ros.frame_force import FrameForce

from palpate.estimate.force import PowerForceLaw
from palpate.estimate.force_law import ForceLaw
from palpate.sensor.array import RIGID_LAYOUT

REST_OHM, PRESSED = np.full((4, 2), 11_000.0), np.full((4, 2), 3000.0)
LAWS = {
    "power": PowerForceLaw.fit([4.0, 13.0, 42.0, 112.0], force_n=[0.5, 1.5, 4.0, 9.0]),
    "memory": ForceLaw.fit([13.0, 42.0, 112.0], force_n=[1.5, 4.0, 9.0]),
}


def with_pixel(ohm: float) -> np.ndarray:
    frame = PRESSED.copy()
    frame[1, 0] = ohm
    return frame


@pytest.mark.parametrize("law", list(LAWS))
def test_bad_pixel_leaves_force_finite_and_next_frame_right(law: str) -> None:
    calibration = SimpleNamespace(force_law=LAWS[law].as_dict(), rest_ohm=REST_OHM)
    force = FrameForce(calibration, layout=RIGID_LAYOUT)
    before = [force.limits_n(0.1 * frame, PRESSED) for frame in range(5)][-1]
    value, low, high = force.limits_n(0.5, with_pixel(0.0))
    assert 0 < value == low < math.inf == high
    assert force.limits_n(0.6, PRESSED) == pytest.approx(before)
    assert np.isfinite(force.limits_n(0.7, with_pixel(math.inf))).all()
    assert np.isfinite(force.limits_n(0.8, with_pixel(math.nan))).all()
    assert force.limits_n(0.9, np.full((4, 2), math.nan)) == ()
    assert force.limits_n(1.0, PRESSED) == pytest.approx(before, rel=0.1)
