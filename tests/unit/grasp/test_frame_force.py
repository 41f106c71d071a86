"""Force of single frames: robustness to spikes, and gain of the contact."""

from __future__ import annotations

from palpate.grasp.estimator import ContactEstimate


def test_confirmed_force_ignores_a_single_spike() -> None:
    estimate = ContactEstimate(frame_forces=((0.0, 1.0), (0.1, 1.0), (0.2, 9.0)))
    assert estimate.confirmed_force_n == 1.0
