"""Re-zeroing: it follows drift between grasps, and says when it must not."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies.rezero import RezeroRule, RezeroState, rezero_step

RULE = RezeroRule()


def grasped(rest_after: float, *, open_mm: float = 70.0, open_s: int = 9) -> RezeroState:
    """Return the state after a grasp at 40 mm and an opening with the given reading."""
    state = RezeroState.calibrated(np.array([[1000.0, 2000.0]]))
    history = [(1.0, 70.0), (1.0, 41.0), (0.3, 40.0), *[(rest_after, open_mm)] * open_s]
    for second, (share, width_mm) in enumerate(history):
        ohm = share * np.array([[1000.0, 2000.0]])
        state = rezero_step(
            state, ohm, time_s=float(second), width_mm=width_mm, moving=False, rule=RULE
        )
    return state


def test_drift_is_followed_in_an_open_hand() -> None:
    assert grasped(1.03).rest_ohm.tolist() == [[1030.0, 2060.0]]


@pytest.mark.parametrize("open_mm", [40.0, 44.0, 45.9])
def test_a_hand_not_opened_beyond_the_contact_keeps_its_rest(open_mm: float) -> None:
    # Contact was seen at 40 mm and may have begun at 41 mm, one frame earlier.
    assert grasped(1.03, open_mm=open_mm).rest_ohm.tolist() == [[1000.0, 2000.0]]


def test_it_waits_until_spike_and_creep_have_faded() -> None:
    assert grasped(1.03, open_s=3).rest_ohm.tolist() == [[1000.0, 2000.0]]


def test_something_left_on_the_sensor_is_reported_and_not_swallowed() -> None:
    state = grasped(0.96)
    assert state.rest_ohm.tolist() == [[1000.0, 2000.0]]
    assert "-4 %" in state.advice
    assert "calibrate rest" in state.advice


def test_far_from_the_calibration_a_new_one_is_advised() -> None:
    state = RezeroState.calibrated(np.array([[1000.0]]))
    state = RezeroState(np.array([[1180.0]]), state.calibrated_ohm)
    history = [(1180.0, 41.0), (300.0, 40.0), *[(1240.0, 70.0)] * 9]
    for second, (ohm, width_mm) in enumerate(history):
        frame = np.array([[ohm]])
        state = rezero_step(
            state, frame, time_s=float(second), width_mm=width_mm, moving=False, rule=RULE
        )
    assert state.rest_ohm.item() == 1180.0
    assert "calibrate force" in state.advice


def test_an_unknown_width_never_rezeroes() -> None:
    state = RezeroState.calibrated(np.array([[1000.0]]))
    for second, ohm in enumerate([1000.0, 300.0, *[1020.0] * 20]):
        frame = np.array([[ohm]])
        state = rezero_step(
            state, frame, time_s=float(second), width_mm=None, moving=False, rule=RULE
        )
    assert state.rest_ohm.item() == 1000.0
