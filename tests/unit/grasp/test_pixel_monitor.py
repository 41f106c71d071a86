"""Pixel failures, and similar readings without a failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from palpate.grasp.estimator import Observation
from palpate.grasp.pixel_monitor import PixelMonitor
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.gripper.interface import GripperState
from palpate.sensor.array import Frame
from palpate.sensor.sample import SampleReader

REST = 350
#: Time, closure in mm, and counts.
Moment = tuple[float, float, Any]


def see(
    watch: PixelMonitor, moments: Sequence[Moment], *, moving: bool = False, oversampling: int = 1
) -> list[Alarm | None]:
    """Return the alarm at each moment."""
    found = list[Alarm | None]()
    for number, (time_s, closure, counts) in enumerate(moments):
        frame = Frame(
            time_s=time_s, sequence=number, counts=np.asarray(counts), oversampling=oversampling
        )
        state = GripperState(time_s=time_s, width_mm=74.0 - closure, moving=moving)
        found.append(watch.check(Observation(frame=frame, gripper=state)))
    return found


def alarms(
    plan: Plan,
    frames: list[Any],
    *,
    step_mm: float = 0.0,
    moving: bool = False,
    oversampling: int = 1,
) -> list[Alarm | None]:
    """Return the alarm at each frame; the fingers close by a step between frames."""
    moments = [(number / 15, number * step_mm, counts) for number, counts in enumerate(frames)]
    return see(PixelMonitor(plan), moments, moving=moving, oversampling=oversampling)


def watched(plan: Plan, frames: list[Any], *, step_mm: float = 0.0) -> list[str | None]:
    """Return the alarm message at each frame, or None."""
    return [alarm and alarm.message for alarm in alarms(plan, frames, step_mm=step_mm)]


def flickering(count: int, *, counts: int = REST, since: int = 0, **changed: Any) -> list[Any]:
    """Return frames with a flicker of one count in every pixel.

    From frame `since` on, the pixels `where` have the counts `value`.
    """
    frames = [np.full((4, 2), counts) + number % 2 for number in range(count)]
    for frame in frames[since:] if changed else ():
        frame[changed["where"]] = changed["value"]
    return frames


@pytest.mark.parametrize(("counts", "how"), [(0, "open"), (1023, "short")])
def test_pixel_monitor_second_frame_at_range_end_raises_alarm(
    plan: Plan, counts: int, how: str
) -> None:
    frames = flickering(6, since=3, where=(2, 1), value=counts)
    said = watched(plan, frames)
    assert said[:4] == [None] * 4
    assert said[4] == f"pixel R2 C1 reads {how}; run `palpate doctor`"
    assert watched(plan, [*frames[:4], *flickering(2)]) == [None] * 6, "one frame is no fault"


@pytest.mark.parametrize("leg", ["upper", "lower"])
@pytest.mark.parametrize("line_ohm", [0.0, 0.5, 70.0, 300.0])
def test_pixel_monitor_saturated_pixel_behind_any_lines_is_short(
    plan: Plan, leg: Literal["upper", "lower"], line_ohm: float
) -> None:
    """The first and the last sum of four conversions that a sample calls saturated."""
    divider = replace(plan.layout.divider, taxel_leg=leg)
    wired = replace(plan, layout=replace(plan.layout, divider=divider, line_ohm=line_ohm))
    rest = REST if leg == "upper" else divider.full_scale - REST
    counts = np.full((4 * (divider.full_scale - 1) + 1, 4, 2), 4 * rest)
    counts[:, 1, 1] = np.arange(len(counts))
    reader = SampleReader(wired.layout, wired.rest_ohm)
    saturated = counts[reader.read_counts(counts, oversampling=4).saturated[:, 1, 1]]
    for short in (saturated[0], saturated[-1]):
        frames = [np.full((4, 2), 4 * rest), short, short]
        found = alarms(wired, frames, oversampling=4)[-1]
        assert found is not None, short[1, 1]
        assert "pixel R1 C1 reads short" in found.message


def test_pixel_monitor_frame_with_new_range_end_is_uncertain(plan: Plan) -> None:
    watch, uncertain = PixelMonitor(plan), []
    for number, counts in enumerate((REST, 1023, REST + 1, 0, REST)):
        frame = np.full((4, 2), REST)
        frame[0, 1] = counts
        assert see(watch, [(number / 15, 0.0, frame)]) == [None]
        uncertain.append(watch.is_frame_uncertain)
    assert uncertain == [False, True, False, True, False]


# -- saturation ------------------------------------------------------------------------------------


def test_pixel_monitor_saturated_sheet_is_not_short(plan: Plan) -> None:
    frames = flickering(2)
    for number in range(8):
        frames.append(np.minimum(REST + 100 * number + np.arange(8).reshape(4, 2) * 9, 1023))
    assert frames[-1].max() == 1023
    found = alarms(plan, [*frames, frames[-1]], step_mm=0.3)
    assert found[:10] == [None] * 10
    assert found[10].danger is Danger.FORCE_LIMIT


def climbing(pixels: int) -> list[Any]:
    """Return frames with pixels that rise to the range end; six are loaded."""
    frames = flickering(2)
    for number in range(20):
        frame = np.full((4, 2), 900) + number % 2
        frame[3] = REST + number % 2
        frame.ravel()[:pixels] = min(980 + 5 * number, 1023)
        frames.append(frame)
    return frames


def test_pixel_monitor_one_saturated_pixel_raises_no_alarm(plan: Plan) -> None:
    watch = PixelMonitor(plan)
    for number, counts in enumerate(climbing(1)):
        assert see(watch, [(number / 15, 0.3 * number, counts)]) == [None]
        assert number <= 4 or not watch.is_frame_uncertain
    assert "pixel R0 C0 is loaded beyond its measuring range" in str(watch.saturation_warning)


def test_pixel_monitor_saturation_that_has_ended_hides_no_repeated_frames(plan: Plan) -> None:
    watch, frames = PixelMonitor(plan), [*climbing(1), *flickering(3)]
    moments = [(number / 15, 0.3 * number, counts) for number, counts in enumerate(frames)]
    assert see(watch, moments) == [None] * len(frames)
    assert watch.saturation_warning is None
    end_s, end_mm, last = moments[-1]
    repeated = [(end_s + number / 15, end_mm + number * plan.step, last) for number in range(1, 6)]
    assert "no pixel has changed" in str(see(watch, repeated)[-1])


def test_pixel_monitor_saturation_of_most_loaded_pixels_raises_force_limit_alarm(
    plan: Plan,
) -> None:
    assert alarms(plan, climbing(4), step_mm=0.3)[-1].danger is Danger.FORCE_LIMIT
    assert alarms(plan, climbing(3), step_mm=0.3) == [None] * 22, "half of them is not most"


@pytest.mark.parametrize(("other", "is_short"), [(512, True), (513, False)])
def test_pixel_monitor_rising_pixel_is_short_without_another_loaded_pixel(
    plan: Plan, other: int, is_short: bool
) -> None:
    """At 512 counts the other pixel has exactly half its rest resistance."""
    frames = flickering(16)
    for number, frame in enumerate(frames):
        frame[0] = min(900 + 9 * number, 1023), other
    rest_ohm = np.full((4, 2), 2 * plan.layout.divider.reference_ohm)
    found = alarms(replace(plan, rest_ohm=rest_ohm), frames)[-1]
    assert (found is not None) == is_short
    assert not is_short or "R0 C0 reads short" in found.message


LOST, LIMIT = Danger.SENSOR_LOST, Danger.FORCE_LIMIT


@pytest.mark.parametrize(
    ("where", "counts", "moving", "danger", "message"),
    [
        *((np.s_[1, :], counts, False, LOST, "reads short") for counts in (REST, 900)),
        *((np.s_[:, 1], counts, False, LOST, "reads short") for counts in (REST, 900)),
        *((np.s_[:2], counts, False, LOST, "reads short") for counts in (REST, 900)),
        *((np.s_[:], counts, False, LOST, "reads short") for counts in (REST, 900)),
        (np.s_[0, 0], 900, False, LOST, "pixel R0 C0 reads short"),
        (np.s_[1, 1], 900, True, LOST, "pixel R1 C1 reads short"),
        (np.s_[:2], 900, True, LIMIT, "loaded beyond its measuring range"),
    ],
)
def test_pixel_monitor_simultaneous_shorts_are_a_load_only_while_closing(
    plan: Plan, where: Any, counts: int, moving: bool, danger: Danger, message: str
) -> None:
    frames = flickering(6, counts=counts, since=3, where=where, value=1023)
    alarm = alarms(plan, frames, moving=moving)[4]
    assert alarm.danger is danger
    assert message in alarm.message


def test_pixel_monitor_shorts_from_first_frame_raise_alarm(plan: Plan) -> None:
    assert alarms(plan, [np.full((4, 2), 1023)] * 2)[1].danger is Danger.SENSOR_LOST


@pytest.mark.parametrize(
    ("moved_mm", "after_s", "danger"),
    [
        (0.25, 0.3, LIMIT),
        (0.25, 0.31, LOST),
        # The error of a position report, three steps of 1/16 mm.
        (0.1875, 0.3, LOST),
    ],
)
def test_pixel_monitor_simultaneous_shorts_within_disturbance_of_movement_are_a_load(
    plan: Plan, moved_mm: float, after_s: float, danger: Danger
) -> None:
    loaded, short = np.full((4, 2), 900), np.full((4, 2), 900)
    short[:2] = 1023
    moments = [(-1.0, 0.0, loaded), (0.0, moved_mm, loaded + 1)]
    moments += [(after_s + 0.1 * number, moved_mm, short - number % 2) for number in range(2)]
    assert see(PixelMonitor(replace(plan, resolution=0.0625)), moments)[-1].danger is danger


# -- stuck pixels and repeated frames --------------------------------------------------------------


def rising(count: int, *, counts: float, noise: int = 0) -> list[Any]:
    """Return frames in which all pixels rise evenly by so many counts; R1 C0 does not change."""
    rng = np.random.default_rng(4)
    frames = []
    for number in range(count):
        frame = np.full((4, 2), REST) + round(counts * number / (count - 1))
        frame = frame + rng.integers(-noise, noise + 1, (4, 2))
        frame[1, 0] = REST
        frames.append(frame)
    return frames


@pytest.mark.parametrize("rows", [4, 2])
@pytest.mark.parametrize(
    ("frames", "is_stuck"),
    [
        (rising(12, counts=6), True),
        (rising(250, counts=6), True),
        # Too little, too few frames, and one that changed within them.
        (rising(12, counts=3), False),
        (rising(11, counts=6), False),
        ([*rising(6, counts=6), np.full((4, 2), REST + 1), *rising(6, counts=6)], False),
        # Only noise.
        (rising(100, counts=0, noise=1), False),
    ],
)
def test_pixel_monitor_pixel_is_stuck_while_the_others_change(
    plan: Plan, rows: int, frames: list[Any], is_stuck: bool
) -> None:
    """All pixels have rest values, or only one other pixel has."""
    if rows == 2:
        rest_ohm = np.full((4, 2), np.nan)
        rest_ohm[1:3, 0] = plan.rest_ohm[1:3, 0]
        plan = replace(plan, rest_ohm=rest_ohm)
    # The reading of a hand in the middle of a movement.
    said = [alarm and alarm.message for alarm in alarms(plan, frames, step_mm=0.02, moving=True)]
    assert (said[-1] is not None) == is_stuck
    assert not is_stuck or said[-1] == "pixel R1 C0 reads stuck; run `palpate doctor`"


def test_pixel_monitor_two_noiseless_pixels_are_not_stuck(plan: Plan) -> None:
    frames = rising(30, counts=40)
    for frame in frames:
        frame[2, 1] = REST
    assert watched(plan, frames) == [None] * 30


@pytest.mark.parametrize(("counts", "is_stuck"), [(60, False), (REST, True)])
def test_pixel_monitor_insensitive_pixel_is_not_stuck(
    plan: Plan, counts: int, is_stuck: bool
) -> None:
    """A change of 2.6 % is six counts of 350, and one count of 60."""
    frames = rising(20, counts=6)
    for frame in frames:
        frame[1, 0] = counts
    assert (watched(plan, frames)[-1] is not None) == is_stuck


@pytest.mark.parametrize("step_mm", [1.0, 0.25])
def test_pixel_monitor_repeated_frames_raise_alarm_after_a_travel_of_four_steps(
    plan: Plan, step_mm: float
) -> None:
    frames = [np.full((4, 2), REST)] * 30
    said = watched(plan, frames, step_mm=step_mm)
    first = round(4.0 / step_mm)
    assert said[:first] == [None] * first
    assert "no pixel has changed" in str(said[first])
    assert watched(plan, frames) == [None] * 30, "a hand at rest does not disturb the sheet"
    # At constant speed nothing disturbs a quiet sheet.
    assert alarms(plan, frames, step_mm=step_mm, moving=True) == [None] * 30


def test_pixel_monitor_repeated_frames_at_rest_raise_alarm_unless_usual(plan: Plan) -> None:
    """After flicker without equal frames, eleven equal frames are a fault."""
    rng = np.random.default_rng(2)
    frames = [REST + rng.integers(0, 3, (4, 2)) for _ in range(40)]
    said = watched(plan, [*frames, *[frames[-1]] * 11])
    assert said[:50] == [None] * 50
    assert "no pixel has changed in 11 frames" in str(said[50])
    usual = [np.full((4, 2), REST + number // 12) for number in range(200)]
    assert watched(plan, usual) == [None] * 200


@pytest.mark.parametrize(
    ("lively", "alike", "known"), [(9, 3, True), (8, 3, False), (30, 4, False)]
)
def test_pixel_monitor_unusual_repeats_raise_alarm(
    plan: Plan, lively: int, alike: int, known: bool
) -> None:
    """Frames repeat once in normal use; later all frames repeat."""
    frames = flickering(lively - alike + 1)
    frames += [frames[-1]] * (alike - 1) + [np.full((4, 2), REST + 9)] * 12
    message = watched(plan, frames)[-1]
    assert ("no pixel has changed in 11 frames" in str(message)) == known


# -- rest values -----------------------------------------------------------------------------------


@pytest.mark.parametrize("ohm", [np.nan, 0.0])
def test_pixel_monitor_ignores_pixels_without_rest_value(plan: Plan, ohm: float) -> None:
    rest_ohm = plan.rest_ohm.copy()
    rest_ohm[3, 1] = ohm
    frames = flickering(5, where=(3, 1), value=0)
    assert watched(replace(plan, rest_ohm=rest_ohm), frames) == [None] * 5
    nothing = replace(plan, rest_ohm=np.full((4, 2), np.nan))
    assert watched(nothing, [np.zeros((4, 2))] * 5) == [None] * 5


def test_pixel_monitor_equal_pixels_raise_alarm(plan: Plan) -> None:
    """Noise changes each pixel, but all have the same reading."""
    unlike = np.linspace(8000.0, 10_000.0, 8).reshape(4, 2)
    frames = [np.linspace(300, 380, 8).reshape(4, 2).round() for _ in range(3)]
    frames += [512 + np.arange(8).reshape(4, 2) % 2 * (number % 2) for number in range(2)]
    said = watched(replace(plan, rest_ohm=unlike), frames)
    assert said[:4] == [None] * 4
    assert "all pixels read the same value, which indicates a fault" in said[4]
    assert watched(plan, frames) == [None] * 5, "these have equal rest values"


@pytest.mark.parametrize(
    ("counts", "rest_counts", "is_fault"),
    [(1, 10, True), (2, 10, False), (1, 8, True), (1, 7, False)],
)
def test_pixel_monitor_equal_pixels_need_a_spread_of_rest_values(
    plan: Plan, counts: int, rest_counts: int, is_fault: bool
) -> None:
    """Two frames with a spread of `counts`, and rest values with a spread of `rest_counts`."""
    divider = plan.layout.divider
    rest = np.linspace(512, 512 + rest_counts, 8).reshape(4, 2)
    unlike = replace(plan, rest_ohm=divider.reference_ohm * (divider.full_scale / rest - 1.0))
    first = 600 + np.arange(8).reshape(4, 2) % 2 * counts
    said = watched(unlike, [first, first + 1])
    assert said[0] is None
    assert (said[1] is not None) == is_fault
