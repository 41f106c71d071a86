"""Force of single frames: robustness to spikes, and gain of the contact."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from tests.factories import touch

from palpate.estimate.gain import Gain
from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.plan import Plan


def test_confirmed_force_ignores_a_single_spike() -> None:
    estimate = ContactEstimate(frame_forces=((0.0, 1.0), (0.1, 1.0), (0.2, 9.0)))
    assert estimate.confirmed_force_n == 1.0


def test_frame_force_is_proportional_to_contact_gain(plan: Plan) -> None:
    plain = ContactEstimate()
    gain = Gain(log_mean=math.log(1.5), log_sd=0.1, law_sd=0.1)
    stronger = replace(plain, gain=gain)
    expected_n = 1.5 * plain._frame_force_n(touch(4.0), plan)
    assert stronger._frame_force_n(touch(4.0), plan) == pytest.approx(expected_n)
