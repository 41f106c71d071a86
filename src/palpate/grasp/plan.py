"""Plan of a grasp: the task, sensor and limits given to the controller."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.force.servo_force import CurrentLaw
from palpate.force.sheet_law import SheetLaw
from palpate.grasp.config import GUARDS, READING
from palpate.grasp.paper import Paper
from palpate.grasp.safety import SafetyLimits
from palpate.gripper.interface import GripperLimits
from palpate.object.compliance import Compliance, SoftFingerCompliance
from palpate.object.damage import DamageModel
from palpate.sensor.array import ArrayLayout

HOLD_S, LONGEST_S = 0.5, 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Plan of one grasp.

    Attributes
    ----------
    layout : ArrayLayout
        Layout of the sensor's frames.
    rest_ohm : ndarray, shape (rows, cols)
        Rest resistances of the calibration.
    law : SheetLaw
        Force from the readings of the sheet and their history.
    compliance : Compliance or None
        Compliance of pads, fingers and servo. None for pressure-driven fingers, whose pressure
        shows no width: without `bend`, neither size nor stiffness is measured.
    steepest_n : float
        Upper bound of the rise of force per mm or kPa of closing, for any object.
    gripper : GripperLimits
        Drive and range. Steps and rates are in its unit: mm or kPa.
    bend : SoftFingerCompliance or None
        Closure and compliance of pressure-driven fingers, calibrated on two blocks.
    current : CurrentLaw or None
        Servo current as a function of force while closing; None without its calibration.
    target_force_n : float or None
        Target grip force; None for a gentle squeeze, just enough for the measurement.
    lift_force_n : float or None
        Grip force required to lift the object: its weight over twice the friction coefficient,
        with a margin. The hand closes until the lower bound of the settled force exceeds it, if
        that is safe; otherwise it releases the object with outcome `too_weak`. None: no lift.
    expect_size_mm : float or None
        Expected size of the object, accurate to some millimetres. The hand approaches it at full
        speed. None: unknown.
    damage : DamageModel or None
        Damage limit learned from closings up to damage; without one, only the ceiling protects the
        object. Pressure-driven fingers can use it if they have a `bend`.
    kind : str
        Kind of object in the damage model; empty if unknown.
    paper : Paper or None
        Settings of the paper's method; None for the default method.
    safety : SafetyLimits
        Limits that no command exceeds.
    epsilon_percent : float
        Relative change that counts as contact (paper, section 4.1).
    step : float
        Closing step before contact (paper, section 4.1).
    hint_percent : float
        Relative change that may be a contact; from then on steps are at most `fine_step`.
    fine_step : float
        First step after a hint; later steps depend on the measured stiffness.
    smallest_step : float
        Smallest step; smaller ones would disturb the reading for no gain.
    resolution : float
        Commands are rounded to multiples of this: about the encoder's or regulator's resolution.
    force_step_n : float
        Intended rise of force per squeeze step.
    gentle_force_n, gentle_mm : float
        End of a squeeze without target: this force (half of it for pressure-driven fingers), or
        this deformation of the object. Of 163 recorded fruit, none ruptured within 1.25 mm of its
        first touch, and 13 within 2 mm.
    firm_force_n : float
        Force limit of a firmer squeeze with rigid fingers while the stiffness is still uncertain.
    firmness_force_n : float
        Force of the stiffness that firmness is made from, newtons.
    fewest_steps : int
        Fewest steps with contact for a measurement of size and stiffness.
    rest_s : float
        Shortest time at rest, before the first movement, for the rest values.
    dwell_s, confirm_s : float
        Wait after each step before its reading, for the movement to fade; further wait to confirm a
        contact, not a multiple of the frame interval at 15 Hz, so rounding does not decide which
        frame is the first after it.
    rate, squeeze_rate : float
        Speed of steps and of retracting before contact, and of steps after contact. The sweep has
        its own speed (`approach.start_sweep`).
    tries : int
        Number of attempts: after one without contact the hand opens, waits, and closes again.
    wait_s : float
        Wait between attempts; a touch of the open fingers ends it.
    tighten : int
        Largest number of times that the hand tightens a grip that slips while it holds (0 to 10);
        afterwards it holds on. Never above the force ceiling or the damage limit.
    hold_s : float
        Hold time between decision and release.
    longest_s : float
        Time limit of the grasp up to the decision; after it the hand opens.
    level : float
        Nominal coverage of intervals.
    """

    layout: ArrayLayout
    rest_ohm: NDArray[np.float64]
    law: SheetLaw
    compliance: Compliance | None
    steepest_n: float
    gripper: GripperLimits
    bend: SoftFingerCompliance | None = None
    current: CurrentLaw | None = None
    target_force_n: float | None = None
    lift_force_n: float | None = None
    expect_size_mm: float | None = None
    damage: DamageModel | None = None
    kind: str = ""
    paper: Paper | None = None
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    epsilon_percent: float = -10.0
    step: float = 1.0
    hint_percent: float = -3.0
    fine_step: float = 0.25
    smallest_step: float = 0.04
    resolution: float = 0.05
    force_step_n: float = 0.7
    gentle_force_n: float = 2.0
    gentle_mm: float = 1.0
    firm_force_n: float = 6.0
    firmness_force_n: float = 2.0
    fewest_steps: int = 3
    rest_s: float = 0.3
    dwell_s: float = 0.3
    confirm_s: float = 0.1
    rate: float = 20.0
    squeeze_rate: float = 5.0
    tries: int = 1
    wait_s: float = 2.0
    tighten: int = 0
    hold_s: float = HOLD_S
    longest_s: float = LONGEST_S
    level: float = 0.9

    @property
    def gripper_compliance(self) -> Compliance | None:
        """Compliance of the gripper, of either drive, if it was calibrated."""
        return self.compliance if self.bend is None else self.bend.compliance

    @property
    def visible_travel(self) -> float:
        """Smallest travel that is certain to show in the gripper's reports, mm or kPa."""
        return self.smallest_step + READING.report_error_steps * self.resolution

    @property
    def longest_opening_s(self) -> float:
        """Longest opening, s."""
        return self.gripper.span / self.gripper.fastest + GUARDS.patience_s

    @property
    def no_push_n(self) -> float:
        """Force above which contact can't be one finger pushing an object to the middle, N."""
        return 0.5 * self.gentle_force_n
