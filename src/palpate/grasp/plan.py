"""The task, the sensor and the bounds of a grasp: the controller's inputs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.compliance import Compliance, SoftFingerCompliance
from palpate.estimate.damage import DamageModel
from palpate.estimate.force import StaticLaw
from palpate.estimate.pixel_law import PixelReading
from palpate.estimate.servo_force import CurrentLaw
from palpate.estimate.sheet_creep import SheetCreep
from palpate.grasp.paper import Paper
from palpate.grasp.safety import SafetyLimits
from palpate.gripper.interface import GripperLimits
from palpate.sensor.array import ArrayLayout
from palpate.settling.result import SettlingMethod

HOLD_S, LONGEST_S = 0.5, 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One grasp, planned.

    Attributes
    ----------
    layout : ArrayLayout
        Of the frames to come.
    rest_ohm : ndarray, shape (rows, cols)
        Rest resistances of the calibration.
    settled_law, early_law : StaticLaw
        Force from the reading at the settling horizon, and from that `dwell_s` after a movement:
        the sheet lags, so they are two laws.
    compliance : Compliance or None
        Compliance of pads, fingers and servo. None for pressure-driven fingers: their pressure
        gives no width, so there is neither size nor stiffness.
    steepest_n : float
        Upper bound of the rise of force per mm or kPa of closing, for whatever is gripped.
    gripper : GripperLimits
        Drive and range. Steps and rates are in its unit: mm or kPa.
    settling : SettlingMethod
        Predictor of the settled value.
    reading : PixelReading
        From the excess conductance of the pixels to what the laws read.
    creep : SheetCreep or None
        How this sheet creeps after a step, where its calibration had enough holds to show it.
    bend : SoftFingerCompliance or None
        Closure and compliance of pressure-driven fingers, measured on two blocks if known.
    current : CurrentLaw or None
        Servo current over force while closing, where the gripper reports it and was calibrated.
    target_force_n : float or None
        Grip force to reach; None for a gentle squeeze, just enough to measure.
    lift_force_n : float or None
        Grip force that lifting the object takes: its weight over twice the friction, with a margin.
        The hand closes further until the lower bound of the settled force passes it, within
        what is safe, or gives the object back as `too_weak`. None: nothing will be lifted.
    expect_size_mm : float or None
        Size that the object has to within some millimetres, where it is known: the hand comes near
        at full speed.
    damage : DamageModel or None
        Learned from closings that ended in damage; None where none were made, and only the ceiling
        protects the object. Fingers driven by pressure can use it if they have a `bend`.
    kind : str
        Kind of object of the damage model; empty if unknown.
    paper : Paper or None
        Settings of the paper's method, where the grasp follows it.
    safety : SafetyLimits
        Bounds that the plan can't exceed.
    epsilon_percent : float
        Relative change that is contact (paper, section 4.1).
    step : float
        Closing step before contact (paper, section 4.1).
    hint_percent : float
        Relative change that may be a touch: from there on steps are `fine_step` at most.
    fine_step : float
        First step after a hint; later ones follow from the stiffness seen.
    smallest_step : float
        Steps below this are not worth the movement's spike.
    resolution : float
        Commands go to whole steps of this: about the encoder's, or the regulator's.
    backlash : float
        How far the drive may go back before the fingers follow: more than the backlash of gears.
    force_step_n : float
        Rise of force aimed at with each step of the squeeze.
    gentle_force_n, gentle_mm : float
        Where a squeeze without target ends: at this force (half of it by fingers driven by
        pressure), or once the object has given way so far. Of 163 recorded fruit none ruptured
        within 1.25 mm of its first touch, and 13 within 2 mm.
    firm_force_n, firm_mm : float
        Limits of a firmer squeeze with rigid fingers while the stiffness is still uncertain: the
        force, and the deformation that certainly damages the object.
    stiffness_tolerance : float
        Relative uncertainty, to either side, of a stiffness that counts as known.
    fewest_steps : int
        Steps with a touch that size and stiffness need.
    rest_s, rest_frames : float and int
        Time to take the rest values before moving, and the frames that it takes at least.
    dwell_s, confirm_s : float
        Wait after each step before it is read; further wait to confirm a contact.
    rate, squeeze_rate : float
        Speed of steps and of backing off before the contact, and of steps after it. The approach at
        speed has its own (`approach.start_sweep`).
    horizon_s : float
        When the sheet counts as settled, from the end of the last movement.
    tries : int
        How often to close where nothing is found: open, wait, and close again.
    wait_s : float
        Wait between tries; a touch of the open fingers ends it.
    decide_after_s, decide_by_s : float
        Earliest and latest time of the answer, from the end of the last movement.
    correct_after_s : float
        Earliest time at which a force that is clearly not the target is corrected.
    decide_half_width : float
        The answer is given as soon as the interval of the settled excess conductance is narrower
        than this fraction of it, to either side.
    target_tolerance : float
        Fraction of the target that the settled force may miss without a further correction.
    most_adjustments : int
        Corrections towards the target before the answer is accepted as it is.
    hold_s : float
        How long to hold after the answer, before release.
    longest_s : float
        A grasp without an answer by then is given up: the hand opens.
    level : float
        Probability that intervals are meant to cover.
    """

    layout: ArrayLayout
    rest_ohm: NDArray[np.float64]
    settled_law: StaticLaw
    early_law: StaticLaw
    compliance: Compliance | None
    steepest_n: float
    gripper: GripperLimits
    settling: SettlingMethod
    reading: PixelReading = field(default_factory=PixelReading.sum_pixels)
    creep: SheetCreep | None = None
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
    backlash: float = 0.3
    force_step_n: float = 0.7
    gentle_force_n: float = 2.0
    gentle_mm: float = 1.0
    firm_force_n: float = 6.0
    firm_mm: float = 1.0
    stiffness_tolerance: float = 0.25
    fewest_steps: int = 3
    rest_s: float = 0.3
    rest_frames: int = 8
    dwell_s: float = 0.4
    confirm_s: float = 0.1
    rate: float = 20.0
    squeeze_rate: float = 5.0
    horizon_s: float = 20.0
    tries: int = 1
    wait_s: float = 2.0
    decide_after_s: float = 0.8
    decide_by_s: float = 1.2
    correct_after_s: float = 0.5
    decide_half_width: float = 0.08
    target_tolerance: float = 0.05
    most_adjustments: int = 6
    hold_s: float = HOLD_S
    longest_s: float = LONGEST_S
    level: float = 0.9

    @property
    def gripper_compliance(self) -> Compliance | None:
        """Compliance of the gripper, of either drive, if it was calibrated."""
        return self.compliance if self.bend is None else self.bend.compliance

    @property
    def no_push_n(self) -> float:
        """Force above that of one finger pushing an object to the middle, N."""
        return 0.5 * self.gentle_force_n
