"""The tuned numbers of the grasp, each with its range, unit, source and quantity.

A source is the paper, a datasheet, a study of this project, development sensors of the twin, a
requirement, or a guess. `docs/grasp-states.md` shows them as a table. No other file of this folder
holds a tuned number (`tests/unit/grasp/test_config.py`); what a user or a rig sets is in `Plan` and
`SafetyLimits`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import Any

_ENTRY = re.compile(r"(\w+) : (\S+ to \S+) (.+?), ([a-z ]+)\.\s+(.+)")


@dataclass(frozen=True, slots=True)
class ReadingNumbers:
    """From frames and reports to an estimate.

    now_s : 0.05 to 0.3 s, guess. Span of the frames whose mean is read as now.
    now_frames : 2 to 6 frames, guess. Fewest frames that are read as now.
    quiet_s : 0.2 to 0.5 s, twin. A movement's spike, and the sheet's answer, are over.
    lag_s : 0.06 to 0.12 s, twin. A pixel hides its fall under a rising load.
    felt_percent : -3 to -0.5 %, twin. A larger fall is a contact (ten times a mean's noise).
    report_steps : 1 to 4 steps, datasheet. Error of a report, in steps of the drive.
    """

    now_s: float = 0.14
    now_frames: int = 3
    quiet_s: float = 0.3
    lag_s: float = 0.06
    felt_percent: float = -1.0
    report_steps: float = 3.0


@dataclass(frozen=True, slots=True)
class Approach:
    """Closing at speed, and the touch that ends it.

    overrun_steps : 1 to 3 steps, twin.
        Travel from a touch until the hand stands. Less is a slower approach, by `start_sweep`.
    ahead_frames : 1.25 to 4 frames, guess. Reach of a command ahead.
    ahead_s : 0.01 to 0.05 s, guess. And beyond those frames.
    haste_frames : 1 to 2 frames, guess. The same where no object is expected yet.
    expected_mm : 2 to 10 mm, requirement. Error of an expected size.
    stand_s : 0.15 to 0.4 s, twin. Spike of a movement at speed is over.
    idle_s : 0.3 to 2 s, guess. A hand that does not move is sent again.
    back_steps : 2 to 8 steps, guess. Furthest way back from a touch, or on where one finger pushes.
    alone_fraction : 0.1 to 0.5 1, guess. One finger pushes alone below this ratio of both.
    short_steps : 0.2 to 1 steps, twin. Second touch begins before the first, at least.
    short_fraction : 0.5 to 1 1, twin.
        Second touch begins before the first, of its force on a block.
    """

    overrun_steps: float = 2.0
    ahead_frames: float = 2.0
    ahead_s: float = 0.02
    haste_frames: float = 1.25
    expected_mm: float = 5.0
    stand_s: float = 0.21
    idle_s: float = 0.7
    back_steps: float = 4.0
    alone_fraction: float = 0.3
    short_steps: float = 0.4
    short_fraction: float = 0.8


@dataclass(frozen=True, slots=True)
class TouchDetection:
    """Detection of a contact while the hand moves at constant speed.

    history_s : 0.4 to 1 s, twin. Readings compared with.
    latest_s : 0.004 to 0.07 s, guess. Readings taken as now.
    steady_s : 0.3 to 0.6 s, twin. A movement's rise is steady.
    level_s : 0.1 to 0.4 s, guess. Span of a movement's level.
    slowed_s : 0.2 to 0.4 s, twin. Older fast movements do not count.
    sd : 4 to 8 sd, twin. Change that is a touch.
    fraction : 0.004 to 0.02 1, twin. Least change, and unseen noise; a slow fall is twice this.
    gears_fraction : 0.1 to 0.3 1, guess. Friction of the gears is mapped no better.
    """

    history_s: float = 0.6
    latest_s: float = 0.016
    steady_s: float = 0.4
    level_s: float = 0.2
    slowed_s: float = 0.25
    sd: float = 6.0
    fraction: float = 0.008
    gears_fraction: float = 0.15


@dataclass(frozen=True, slots=True)
class Squeeze:
    """Size of the next closing step.

    force_fraction : 0.5 to 1 1, twin. Of the missing force that one step may add.
    further : 1 to 2 1, guess. Of the depth so far that a step may add.
    stiffening : 1.1 to 1.6 1, guess. Slope over that of the last steps.
    most_of_target : 1.2 to 2 1, requirement. Of the target that no step exceeds.
    most_beyond_n : 0.2 to 1 N, requirement. And beyond the target, no step exceeds.
    near_fraction : 0.85 to 1 1, twin. Of the target where the squeeze ends.
    sure_n : 0.1 to 0.3 N, twin. Rise that noise does not make.
    soft_n_per_mm : 0.4 to 1.5 N/mm, study rupture. Softest fruit that is gripped.
    listen_s : 0.05 to 0.3 s, guess. Least time of a step whose current is read.
    firm_n_per_mm : 4 to 10 N/mm, twin. Stiffer needs no firmer squeeze.
    """

    force_fraction: float = 0.75
    further: float = 1.2
    stiffening: float = 1.3
    most_of_target: float = 1.5
    most_beyond_n: float = 0.5
    near_fraction: float = 0.93
    sure_n: float = 0.15
    soft_n_per_mm: float = 0.7
    listen_s: float = 0.1
    firm_n_per_mm: float = 6.0


@dataclass(frozen=True, slots=True)
class Settle:
    """The settled force, and its corrections.

    every_s : 0.07 to 0.5 s, guess. Between two forecasts.
    since_sd : 0.03 to 0.1 ln, paper. Gain changes after calibration.
    relaxed : 0.85 to 1 1, twin. Of the closing force left at 20 s.
    relaxed_sd : 0.02 to 0.1 ln, twin. Scatter of that.
    kept_factor : 1.5 to 3 1, guess. A reading of what is held changes by no more until 20 s.
    haste_sd : 0.05 to 0.2 ln, twin. Lag of larger steps.
    hysteresis_sd : 0.1 to 0.3 ln, guess. Hysteresis of soft fingers.
    less_steep : 2 to 8 1, guess. A correction's slope may be less.
    eased_fraction : 0.2 to 0.5 1, guess. Of the goal that the hand opens below it.
    correction_s : 0.3 to 1 s, guess. Duration of a correction.
    """

    every_s: float = 0.2
    since_sd: float = 0.05
    relaxed: float = 0.96
    relaxed_sd: float = 0.03
    kept_factor: float = 2.0
    haste_sd: float = 0.12
    hysteresis_sd: float = 0.15
    less_steep: float = 4.0
    eased_fraction: float = 0.3
    correction_s: float = 0.5


@dataclass(frozen=True, slots=True)
class Guards:
    """Thresholds of the monitors of sheet, gripper and grip.

    patience_s : 1 to 10 s, guess. A sheet comes to rest; the first frames come; a pixel moves.
    sheet_factor : 2 to 4 1, twin. Drift of a sheet's rest.
    pixel_factor : 1.3 to 2 1, twin. Drift of a pixel's rest against the others'.
    too_far : 1.1 to 1.5 1, guess. Of the target that ends a movement.
    late_s : 0.06 to 0.12 s, twin. The sheet shows a rising force this late.
    lost_fraction : 0.2 to 0.5 1, twin. Of a grip that is left: gone.
    left_fraction : 0.6 to 0.85 1, guess. Of a touch still read after the way back.
    falls_fraction : 0.005 to 0.03 1, study faults. Fall of the reading at each closing step.
    falls_steps : 3 to 5 steps, study faults. Steps that fall in a row.
    rises_fraction : 0.05 to 0.2 1, study faults. Rise of the reading while opening.
    alone_hints : 1.5 to 4 hints, study faults. A hint is -3 %. One finger grips, the other not.
    opening_s : 5 to 30 s, guess. Longest opening.
    idle_commands : 3 to 8 commands, guess. Without any movement.
    idle_fraction : 0.2 to 0.5 1, guess. Of the way, or no movement.
    shown_fraction : 0.003 to 0.02 1, guess. Of the travel, a way that shows anything.
    range_fraction : 0.05 to 0.2 1, guess. Of the travel, a report beyond the gripper's range.
    too_fast : 1.3 to 2 1, guess. Of the rate that was sent.
    most_ma : 5000 to 50000 mA, datasheet. Of any such motor.
    intervals : 9 to 31 frames, guess. Whose median is the period.
    """

    patience_s: float = 3.0
    sheet_factor: float = 2.5
    pixel_factor: float = 1.6
    too_far: float = 1.25
    late_s: float = 0.1
    lost_fraction: float = 0.35
    left_fraction: float = 0.75
    falls_fraction: float = 0.01
    falls_steps: int = 3
    rises_fraction: float = 0.1
    alone_hints: float = 2.0
    opening_s: float = 10.0
    idle_commands: int = 4
    idle_fraction: float = 0.3
    shown_fraction: float = 0.005
    range_fraction: float = 0.1
    too_fast: float = 1.5
    most_ma: float = 20000.0
    intervals: int = 15


@dataclass(frozen=True, slots=True)
class Pixels:
    """Thresholds of failed pixels.

    frames : 2 to 4 frames, study faults.
        At an end of the range, or equal; no more are alike in a sensor that flickers.
    loaded_fraction : 0.3 to 0.7 1, guess. Of its resistance lost to a load.
    jump_fraction : 0.02 to 0.1 1, guess. Of a reading, in one frame.
    moves : 5 to 12 moves, study faults. Without a change: the pixel is stuck.
    other_moves : 1 to 5 moves, study faults. Of the others meanwhile, at most.
    all_moves : 3 to 6 moves, study faults. Without a change of any pixel.
    few_moves : 1 to 4 moves, study faults. Without a change, in a long time.
    flicker_frames : 15 to 60 frames, guess. Show whether a sensor flickers.
    most_alike : 6 to 20 frames, study faults. Alike that are not new.
    unlike_counts : 4 to 20 counts, study faults. Pixels differ at rest.
    """

    frames: int = 2
    loaded_fraction: float = 0.5
    jump_fraction: float = 0.05
    moves: int = 8
    other_moves: int = 3
    all_moves: int = 4
    few_moves: int = 2
    flicker_frames: int = 30
    most_alike: int = 10
    unlike_counts: int = 8


@dataclass(frozen=True, slots=True)
class Current:
    """Thresholds of the evidence in the servo's current.

    sd : 4 to 6 sd, study faults. A rise seen in one movement is accepted.
    twice_sd : 2.5 to 4 sd, study faults. Two in a row are believed.
    readings : 3 to 8 readings, guess.
        In a mean; short movements of an empty hand that show what its gears take.
    sheet_factor : 1.5 to 3 1, study faults. Of what the sheet shows.
    equal_readings : 10 to 30 readings, study faults. A stuck current.
    more_ma : 10 to 50 mA, datasheet. And this much more.
    """

    sd: float = 4.5
    twice_sd: float = 3.0
    readings: int = 4
    sheet_factor: float = 2.0
    equal_readings: int = 16
    more_ma: float = 20.0


READING, APPROACH, TOUCH = ReadingNumbers(), Approach(), TouchDetection()
SQUEEZE, SETTLE, GUARDS = Squeeze(), Settle(), Guards()
PIXELS, CURRENT = Pixels(), Current()
GROUPS: dict[str, Any] = {
    name: value for name, value in vars().items() if name.isupper() and not name.startswith("_")
}


def rows() -> list[tuple[str, ...]]:
    """Return name, value, range, unit, source and quantity of every number.

    >>> rows()[0][:4]
    ('READING.now_s', '0.14', '0.05 to 0.3', 's')
    """
    found = []
    for name, group in GROUPS.items():
        described = {entry[0]: entry[1:] for entry in _ENTRY.findall(type(group).__doc__ or "")}
        found += [
            (f"{name}.{one.name}", f"{one.default:g}", *described[one.name])
            for one in fields(group)
        ]
    return found
