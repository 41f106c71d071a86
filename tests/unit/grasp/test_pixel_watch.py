"""Pixels that fail, and what only looks like it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.grasp.belief import Observation
from palpate.grasp.pixel_watch import PixelWatch
from palpate.grasp.plan import Plan
from palpate.gripper.interface import GripperState
from palpate.sensor.array import Frame

REST = 350


def watched(plan: Plan, frames: list[Any], *, step_mm: float = 0.0) -> list[str | None]:
    """Return what the watch says of each frame; the fingers close by a step between them."""
    watch = PixelWatch(plan)
    said = []
    for number, counts in enumerate(frames):
        frame = Frame(time_s=number / 15, sequence=number, counts=np.asarray(counts))
        state = GripperState(time_s=number / 15, width_mm=74.0 - number * step_mm)
        said.append(watch.complaint(Observation(frame=frame, gripper=state)))
    return said


def at_rest(count: int) -> list[Any]:
    """Return frames in which every pixel flickers by a count."""
    return [np.full((4, 2), REST) + number % 2 for number in range(count)]


@pytest.mark.parametrize(("counts", "how"), [(0, "open"), (1023, "short")])
def test_an_end_of_the_range_is_named_at_its_second_frame(
    plan: Plan, counts: int, how: str
) -> None:
    frames = at_rest(6)
    for frame in frames[3:]:
        frame[2, 1] = counts
    said = watched(plan, frames)
    assert said[:4] == [None] * 4
    assert said[4] == f"pixel R2 C1 reads {how}; see what `palpate doctor` says"


def test_one_flicker_is_no_fault(plan: Plan) -> None:
    frames = at_rest(6)
    frames[3][2, 1] = 0
    assert watched(plan, frames) == [None] * 6


def test_a_sheet_pressed_beyond_the_range_is_no_short(plan: Plan) -> None:
    frames = at_rest(2)
    for number in range(8):
        frames.append(np.minimum(REST + 100 * number + np.arange(8).reshape(4, 2) * 9, 1023))
    assert frames[-1].max() == 1023
    assert watched(plan, frames) == [None] * 10


def test_a_short_under_load_jumps_alone(plan: Plan) -> None:
    frames = [np.full((4, 2), 900) + number % 2 for number in range(6)]
    for frame in frames[3:]:
        frame[0, 0] = 1023
    assert "R0 C0 reads short" in str(watched(plan, frames)[4])


def test_a_pixel_that_sleeps_through_movements_is_stuck(plan: Plan) -> None:
    frames = at_rest(30)
    for frame in frames:
        frame[1, 0] = REST
    said = watched(plan, frames, step_mm=0.5)
    first = next(number for number, words in enumerate(said) if words)
    assert said[first] == "pixel R1 C0 reads stuck; see what `palpate doctor` says"
    assert 7 <= first <= 9


def test_a_sensor_that_is_all_quiet_is_not_judged(plan: Plan) -> None:
    frames = [np.full((4, 2), REST)] * 30
    assert watched(plan, frames, step_mm=0.5) == [None] * 30


def test_pixels_that_the_calibration_does_not_know_are_not_missed(plan: Plan) -> None:
    from dataclasses import replace

    rest_ohm = plan.rest_ohm.copy()
    rest_ohm[3, 1] = np.nan
    frames = at_rest(5)
    for frame in frames:
        frame[3, 1] = 0
    assert watched(replace(plan, rest_ohm=rest_ohm), frames) == [None] * 5
