"""What a sheet shows after it was let go of is no force."""

from __future__ import annotations

import numpy as np

from palpate.dashboard.recovery import Recovery


def steps(recovery: Recovery, *frames: tuple[float, float, bool]) -> list[bool]:
    """Return for times, changes of both fingers and open hands whether the load is gone."""
    return [
        recovery.step(time_s, np.full(2, percent), open_hand=open_hand)
        for time_s, percent, open_hand in frames
    ]


def test_a_hand_that_is_open_and_calm_presses_what_its_sheet_shows_then() -> None:
    assert steps(Recovery(), (0.0, 0.0, True), (1.0, 0.0, True)) == [True, False]
    assert steps(Recovery(), (0.0, -5.0, True), (9.0, -4.0, True)) == [True, True]
    recovery = Recovery()
    steps(recovery, (0.0, 0.0, True), (1.0, 0.0, True))
    assert steps(recovery, (2.0, -30.0, True)) == [False]


def test_the_sheet_of_a_hand_that_opened_shows_a_load_that_is_gone_until_it_is_calm() -> None:
    recovery = Recovery()
    held = steps(recovery, (0.0, -30.0, False), (1.0, 20.0, False))
    # The spike of the movement crosses the rest values: one calm frame is no recovery.
    gone = steps(recovery, (1.1, 0.5, True), (1.2, -6.0, True), (3.0, -0.9, True), (3.9, 0.1, True))
    assert (held, gone) == ([False, False], [True, True, True, True])
    assert steps(recovery, (4.1, -0.2, True), (5.0, -30.0, True)) == [False, False]


def test_it_is_not_calm_while_one_finger_is_not_or_does_not_read() -> None:
    for other in (-3.0, np.nan):
        recovery = Recovery()
        recovery.step(0.0, np.array([-30.0, -30.0]), open_hand=False)
        changes = np.array([0.0, other])
        assert [recovery.step(t, changes, open_hand=True) for t in (1.0, 3.0)] == [True, True]
