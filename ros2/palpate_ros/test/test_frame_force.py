"""Force of frames with saturated, open and unreadable pixels."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_ros.frame_force import FrameForce
from tests.factories import WEIGHTS

from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.sensor.sample import Sample, SampleReader
from palpate.twin.rig import calibrate_twin

PRESSED = np.full((4, 2), 600)
READER = SampleReader(RIGID_LAYOUT, np.full((4, 2), 11_000.0))


def sample(time_s: float, counts: np.ndarray) -> Sample:
    return READER.read(Frame(time_s=time_s, sequence=0, counts=counts))


def with_pixel(counts: int) -> np.ndarray:
    frame = PRESSED.copy()
    frame[1, 0] = counts
    return frame


@pytest.mark.parametrize("made_by", ["weights", "load cell"])
def test_bad_pixel_leaves_force_finite_and_next_frame_right(made_by: str) -> None:
    pairs = WEIGHTS
    if made_by == "load cell":
        pairs = calibrate_twin(seed=5, level="lab", apart_from="").force
    force = FrameForce(SimpleNamespace(force=pairs, force_law={}, layout=RIGID_LAYOUT))
    before = [force.limits_n(sample(0.1 * frame, PRESSED)) for frame in range(5)][-1]
    for time_s, counts, within in ((0.5, 1023, 1e-6), (0.7, 0, 0.1)):
        value, low, high = force.limits_n(sample(time_s, with_pixel(counts)))
        assert 0 < value == low < math.inf == high
        after = force.limits_n(sample(time_s + 0.1, PRESSED))
        assert after == pytest.approx(before, rel=within)
    assert force.limits_n(sample(0.9, np.zeros((4, 2)))) == ()
    assert force.limits_n(sample(1.0, PRESSED)) == pytest.approx(before, rel=0.1)
