"""The tuned numbers of the grasp, each with its range, unit, source and quantity.

A source is the paper, a datasheet, a study of this project, development sensors of the twin, a
requirement, or a guess. `docs/grasp-states.md` shows the numbers as a table. No other file of this
folder holds a tuned number; settings of a user or a rig are in `Plan` and `SafetyLimits`.

An entry of a docstring is `name : range unit, source. Quantity.` Unit 1 means dimensionless.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import Any

_ENTRY = re.compile(r"(\w+) : (\S+ to \S+) (.+?), ([a-z ]+)\.\s+(.+)")


@dataclass(frozen=True, slots=True)
class ReadingNumbers:
    """From frames and reports to an estimate.

    mean_s : 0.02 to 0.14 s, twin.
        Span of the frames averaged for a reading at rest. The sheet's response to a fast closing
        takes 0.3 s, so a mean over more of it reads too little.
    now_s : 0.05 to 0.3 s, guess.
        Span of the present readings of a moving hand, and shortest step with a measured current.
    rest_frames : 5 to 15 frames, guess. Fewest frames at rest for the rest values.
    fewest_frames : 2 to 6 frames, guess. Fewest frames or reports in a mean or comparison.
    quiet_s : 0.2 to 0.5 s, twin.
        Time after a movement or a stop until its disturbance and the sheet's response are over.
    lag_s : 0.06 to 0.12 s, twin. Time in which a rising load is hidden by the sheet's lag.
    contact_percent : -3 to -0.5 %, twin.
        Larger fall that counts as contact (ten times the noise of a mean).
    report_error_steps : 1 to 4 steps, datasheet. Error of a position report, in steps of the drive.
    """

    mean_s: float = 0.05
    now_s: float = 0.14
    rest_frames: int = 8
    fewest_frames: int = 3
    quiet_s: float = 0.3
    lag_s: float = 0.06
    contact_percent: float = -1.0
    report_error_steps: float = 3.0


@dataclass(frozen=True, slots=True)
class Approach:
    """The fast approach, and its stop at contact.

    overrun_steps : 1 to 3 steps, twin.
        Allowed travel from contact until the hand stops; sets the speed of a sweep.
    lookahead_frames : 1.25 to 4 frames, guess.
        How far ahead of the hand a command is, in frame periods.
    size_error_mm : 2 to 10 mm, requirement. Error of an expected size.
    most_push_steps : 2 to 8 steps, guess. Largest advance while one finger pushes.
    one_finger_fraction : 0.1 to 0.5 1, guess.
        Below this ratio of the weaker to the stronger finger, one pushes alone.
    """

    overrun_steps: float = 2.0
    lookahead_frames: float = 2.0
    size_error_mm: float = 5.0
    most_push_steps: float = 4.0
    one_finger_fraction: float = 0.3


@dataclass(frozen=True, slots=True)
class TouchDetection:
    """Detection of a contact while the hand moves at constant speed.

    baseline_s : 0.4 to 1 s, twin. Span of the readings compared with.
    window_s : 0.004 to 0.07 s, guess. Span of the readings averaged for the current value.
    steady_s : 0.3 to 0.6 s, twin.
        Time after a start, or after slowing down, until the rise of a movement is constant.
    threshold_sd : 4 to 8 sd, twin.
        Change that counts as contact, in standard deviations of the noise.
    min_change : 0.004 to 0.02 1, twin.
        Smallest change that counts as contact; twice this for a slow fall.
    friction_error_fraction : 0.1 to 0.3 1, guess. Relative error of the calibrated gear friction.
    """

    baseline_s: float = 0.6
    window_s: float = 0.016
    steady_s: float = 0.4
    threshold_sd: float = 6.0
    min_change: float = 0.008
    friction_error_fraction: float = 0.15


@dataclass(frozen=True, slots=True)
class Squeeze:
    """Size of the next closing step.

    force_fraction : 0.5 to 1 1, twin. Fraction of the missing force that one step may add.
    stiffening_ratio : 1.1 to 1.6 1, guess.
        Allowed slope of the next step relative to that of the last steps.
    max_target_ratio : 1.2 to 2 1, requirement. Force limit of a step relative to the target.
    max_overshoot_n : 0.2 to 1 N, requirement. Added to that limit.
    near_fraction : 0.85 to 1 1, twin. Fraction of the target at which the squeeze ends.
    min_rise_n : 0.1 to 0.3 N, twin. Smallest rise of force that exceeds noise.
    firm_n_per_mm : 4 to 10 N/mm, twin. Objects above this stiffness need no firmer squeeze.
    firm_mm : 0.5 to 2 mm, guess.
        Deformation that ends a firmer squeeze, because it certainly damages the object.
    stiffness_tolerance : 0.15 to 0.4 1, guess.
        Relative uncertainty, to either side, of a stiffness that counts as known.
    soft_n_per_mm : 0.4 to 1.5 N/mm, study rupture. Stiffness of the softest fruit that is gripped.
    """

    force_fraction: float = 0.75
    stiffening_ratio: float = 1.3
    max_target_ratio: float = 1.5
    max_overshoot_n: float = 0.5
    near_fraction: float = 0.93
    min_rise_n: float = 0.15
    firm_n_per_mm: float = 6.0
    firm_mm: float = 1.0
    stiffness_tolerance: float = 0.25
    soft_n_per_mm: float = 0.7


@dataclass(frozen=True, slots=True)
class Settle:
    """The settled force, and its corrections.

    drift_sd : 0.03 to 0.1 ln, paper. Change of the gain since calibration.
    decide_after_s : 0.3 to 1 s, guess.
        Time of the decision, from the end of the last movement. Not a multiple of the frame
        interval at 15 Hz, as `Plan.confirm_s`.
    target_tolerance : 0.03 to 0.1 1, requirement.
        Largest error of the settled force, relative to the target, without a correction.
    most_adjustments : 3 to 10 corrections, guess. Largest number towards the target.
    correction_s : 0.3 to 1 s, guess. Duration of a correction.
    hysteresis_sd : 0.1 to 0.3 ln, guess. Hysteresis of soft fingers.
    max_slope_drop : 2 to 8 1, guess. Largest factor by which a correction may lower the slope.
    easing_fraction : 0.2 to 0.5 1, guess.
        Fraction of the target force by which the hand opens below it.
    backlash : 0.2 to 1 mm or kPa, guess.
        Travel of the drive on reversal before the fingers follow, with a margin.
    """

    drift_sd: float = 0.05
    decide_after_s: float = 0.37
    target_tolerance: float = 0.05
    most_adjustments: int = 6
    correction_s: float = 0.5
    hysteresis_sd: float = 0.15
    max_slope_drop: float = 4.0
    easing_fraction: float = 0.3
    backlash: float = 0.3


@dataclass(frozen=True, slots=True)
class Tighten:
    """Slip of a held object, and the reaction of the hand.

    baseline_s : 0.5 to 2 s, twin. Longest span of the pressure centres compared with.
    least_baseline_s : 0.3 to 1 s, twin. Shortest span, before the noise of this hold is known.
    gap_s : 0.05 to 0.2 s, twin. Newest part of a hold that does not count as noise.
    window_s : 0.004 to 0.07 s, guess. Span of the centres averaged for the current value.
    threshold_sd : 8 to 16 sd, study tighten. Shift that counts as slip, in sd of the noise.
    force_fraction : 0.5 to 1 1, study tighten. Rise of the grip force relative to the present.
    """

    baseline_s: float = 1.0
    least_baseline_s: float = 0.5
    gap_s: float = 0.1
    window_s: float = 0.016
    threshold_sd: float = 12.0
    force_fraction: float = 1.0


@dataclass(frozen=True, slots=True)
class Guards:
    """Thresholds of the monitors of sheet, gripper and grip.

    patience_s : 1 to 10 s, guess.
        Longest wait for a stable sheet, first frames, or a changing pixel.
    sheet_factor : 2 to 4 1, twin. Largest drift of the sheet's rest resistance.
    pixel_factor : 1.3 to 2 1, twin.
        Largest drift of one pixel's rest resistance relative to the others.
    max_force_ratio : 1.1 to 1.5 1, guess.
        Force relative to the target at which a movement is stopped.
    lost_fraction : 0.2 to 0.5 1, twin.
        Fraction of the grip's reading below which the object is gone.
    blind_doublings : 1.2 to 2 1, study faults.
        Travel without a rise of the reading, relative to that of the last doubling of the force.
    one_finger_hints : 1.5 to 4 hints, study faults.
        Load, in hints of -3 %, at which one finger grips alone.
    idle_commands : 3 to 8 commands, guess. Commands without movement that raise the alarm.
    idle_fraction : 0.2 to 0.5 1, guess.
        Fraction of the expected travel below which the hand did not move.
    range_fraction : 0.05 to 0.2 1, guess.
        Distance outside the range, relative to it, at which a report is impossible.
    max_speed_ratio : 1.3 to 2 1, guess. Largest speed relative to the commanded speed.
    max_current_ma : 5000 to 50000 mA, datasheet. Largest current of such a motor.
    period_frames : 9 to 31 frames, guess. Frame intervals whose median is the frame period.
    """

    patience_s: float = 3.0
    sheet_factor: float = 2.5
    pixel_factor: float = 1.6
    max_force_ratio: float = 1.25
    lost_fraction: float = 0.35
    blind_doublings: float = 1.5
    one_finger_hints: float = 2.0
    idle_commands: int = 4
    idle_fraction: float = 0.3
    range_fraction: float = 0.1
    max_speed_ratio: float = 1.5
    max_current_ma: float = 20000.0
    period_frames: int = 15


@dataclass(frozen=True, slots=True)
class Pixels:
    """Thresholds of failed pixels.

    fault_frames : 2 to 4 frames, study faults.
        Consecutive frames, at an end of the range or all equal, that are a fault.
    loaded_fraction : 0.3 to 0.7 1, guess. Fall of the resistance, relative to rest, that is a load.
    jump_fraction : 0.02 to 0.1 1, guess. Change of a reading within one frame that is a jump.
    max_equal_frames : 6 to 20 frames, study faults. Largest number of equal frames in a row.
    stuck_counts : 3 to 8 counts, study faults.
        Expected change of an unchanged pixel that is stuck; above the flicker of a converter.
    stuck_steps : 3 to 8 steps, study faults. Travel without a change of any pixel that is a fault.
    min_spread_counts : 4 to 20 counts, study faults.
        Smallest spread of the rest values in which equal pixels are a fault.
    """

    fault_frames: int = 2
    loaded_fraction: float = 0.5
    jump_fraction: float = 0.05
    max_equal_frames: int = 10
    stuck_counts: int = 4
    stuck_steps: int = 4
    min_spread_counts: int = 8


@dataclass(frozen=True, slots=True)
class Current:
    """Thresholds of the evidence in the servo's current.

    single_sd : 4 to 6 sd, study faults. Threshold of a rise in one movement.
    repeated_sd : 2.5 to 4 sd, study faults. Threshold of a rise in two consecutive movements.
    sheet_ratio : 1.5 to 3 1, study faults.
        Force from the current that is allowed relative to the sheet's force.
    equal_readings : 10 to 30 readings, study faults.
        Equal currents in a row that mean a stuck sensor.
    margin_ma : 10 to 50 mA, datasheet. Added to the limit of an uncalibrated current.
    """

    single_sd: float = 4.5
    repeated_sd: float = 3.0
    sheet_ratio: float = 2.0
    equal_readings: int = 16
    margin_ma: float = 20.0


READING, APPROACH, TOUCH = ReadingNumbers(), Approach(), TouchDetection()
SQUEEZE, SETTLE, TIGHTEN, GUARDS = Squeeze(), Settle(), Tighten(), Guards()
PIXELS, CURRENT = Pixels(), Current()
GROUPS: dict[str, Any] = {
    name: value for name, value in vars().items() if name.isupper() and not name.startswith("_")
}


def rows() -> list[tuple[str, ...]]:
    """Return name, value, range, unit, source and quantity of every number.

    >>> rows()[0][:4]
    ('READING.mean_s', '0.05', '0.02 to 0.14', 's')
    """
    found = []
    for name, group in GROUPS.items():
        described = {entry[0]: entry[1:] for entry in _ENTRY.findall(type(group).__doc__ or "")}
        found += [
            (f"{name}.{one.name}", f"{one.default:g}", *described[one.name])
            for one in fields(group)
        ]
    return found
