"""Force check from the servo current, independent of the sheet.

The current of a closing servo overcomes gear friction and the grip force. At rest, friction may
carry part of the grip force in either direction, but the servo never draws more current than while
closing. A current above the largest friction current therefore proves a force, whatever the sheet
reads.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from palpate.force.gain import Gain
from palpate.force.servo_force import WARMTH_SD
from palpate.grasp.answers import read_force
from palpate.grasp.config import CURRENT, READING
from palpate.grasp.estimator import ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.gripper.interface import GripperState


class CurrentMonitor:
    """Bounds the grip force with the servo current, if the gripper reports it.

    `plan`: supplies the current law, force law and ceiling. Without a current law the force is
    unknown; an alarm is then a current above that of this grasp's approach that the sheet does not
    explain.

    Law, with the lower bound of the force from the mean of three successive reports, F(sd), and the
    upper bound from the sheet, S:

    - F(3 sd) of a closing or resting hand > force ceiling;
    - F(4.5 sd) of a closing hand > 2 S, S being the largest of three frames at least 0.3 s later,
      once the sheet has responded; F of a hand at rest likewise;
    - F(3 sd) > 2 S at the end of two successive movements: friction varies between movements, and
      hardly within one.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._moving = deque[tuple[float, float]](maxlen=READING.fewest_frames)
        self._still = deque[tuple[float, float]](maxlen=READING.fewest_frames)
        self._closure, self._moved_s = math.inf, math.nan
        #: Times, closures and bounds of the force that the sheet has not answered yet.
        self._pulls = deque[tuple[float, float, float]]()
        self._shown = deque[Touch](maxlen=READING.fewest_frames)
        self._frame_s = math.nan
        self._moving_ma = deque[float](maxlen=CURRENT.equal_readings)
        self._read_s = math.nan
        self._is_checked = True
        self._repeats = 0
        self._empty_ma = list[float]()
        self._unaveraged, self._rise_s = 0, math.nan
        self._absent = 0

    def check(self, state: GripperState, *, estimate: ContactEstimate) -> Alarm | None:
        """Process the gripper's next report; return an alarm for an unexplained current."""
        if math.isnan(state.current_ma):
            return self._check_presence(state)
        reading = (state.current_ma, self._plan.gripper.drive_reading(state))
        closure, before = self._plan.gripper.closure(state), self._closure
        self._closure = closure
        if self._still and (state.moving or estimate.moved_s != self._moved_s):
            # Readings from before the last command do not apply, even if its movement was too
            # short to be reported.
            self._still.clear()
            self._moving.clear()
            self._is_checked = True
        self._moved_s = estimate.moved_s
        if estimate.last is not None and estimate.last.time_s != self._frame_s:
            self._frame_s = estimate.last.time_s
            self._shown.append(estimate.last)
        if not state.moving:
            self._still.append(reading)
            return self._check_ceiling(self._still) or self._check_sheet(estimate)
        # Also check a hand that closes although it was commanded to open.
        is_closing = estimate.sent is not None and closure <= estimate.sent
        if not (is_closing or closure > before + self._plan.resolution):
            self._is_checked = True
            return None
        self._moving.append(reading)
        # A replayed recording repeats reports.
        if state.time_s != self._read_s:
            self._moving_ma.append(state.current_ma)
        self._read_s = state.time_s
        self._is_checked = False
        return (
            self._check_ceiling(self._moving)
            or self._check_closing(state.time_s, closure)
            or self._check_stuck()
            or self._check_sign()
            or self._check_rise(estimate, time_s=state.time_s)
        )

    def _check_presence(self, state: GripperState) -> Alarm | None:
        """Return an alarm if the gripper moves without reporting the calibrated current."""
        if self._plan.current is None or not state.moving or state.time_s == self._read_s:
            return None
        self._read_s = state.time_s
        self._absent += 1
        if self._absent < CURRENT.equal_readings:
            return None
        message = (
            "the gripper reports no current while it moves, but its calibration includes the "
            "current; check the driver, or calibrate without the current"
        )
        return Alarm(danger=Danger.GRIPPER_FAULT, message=message)

    def _least_n(self, readings: deque[tuple[float, float]], *, deviations: float) -> float:
        """Return the lower bound of the force, N."""
        law = self._plan.current
        if law is None or not readings:
            return 0.0
        current_ma, width_mm = np.array(readings).T
        gears = law.gears
        most_ma = float(np.mean(gears.mean_current_ma(width_mm)))
        # The scatter of friction is proportional to friction, unless the mean is below the scatter.
        scatter_ma = deviations * gears.movement_ma
        if gears.mean_ma > gears.movement_ma:
            scatter_ma = most_ma * math.expm1(scatter_ma / gears.mean_ma)
        most_ma += scatter_ma + deviations * law.noise_ma / math.sqrt(len(readings))
        per_n = law.ma_per_n * (1.0 + 2.0 * WARMTH_SD)
        return max(float(current_ma.mean()) - most_ma, 0.0) / per_n

    def _check_ceiling(self, readings: deque[tuple[float, float]]) -> Alarm | None:
        least_n = self._least_n(readings, deviations=CURRENT.repeated_sd)
        ceiling_n = self._plan.safety.force_ceiling_n
        if least_n <= ceiling_n:
            return None
        message = (
            f"the servo's current shows a grip of at least {least_n:.1f} N; the limit is "
            f"{ceiling_n:g} N"
        )
        return Alarm(danger=Danger.FORCE_LIMIT, message=message)

    def _check_stuck(self) -> Alarm | None:
        if len(self._moving_ma) < CURRENT.equal_readings or len(set(self._moving_ma)) > 1:
            return None
        message = (
            f"the servo's current was {self._moving_ma[0]:.0f} mA in {CURRENT.equal_readings} "
            "successive readings while the hand closed; the reading is stuck"
        )
        return Alarm(danger=Danger.GRIPPER_FAULT, message=message)

    def _check_sign(self) -> Alarm | None:
        """Return an alarm for a negative closing current, which can't bound the force."""
        law = self._plan.current
        usual = law is None or law.gears.mean_ma > 0
        mean_ma = float(np.mean(self._moving_ma))
        if (
            len(self._moving_ma) < CURRENT.equal_readings
            or mean_ma >= -CURRENT.margin_ma
            or not usual
        ):
            return None
        message = (
            f"the servo's current is {mean_ma:.0f} mA while the hand closes; its driver must "
            "report closing currents as positive"
        )
        return Alarm(danger=Danger.GRIPPER_FAULT, message=message)

    def _check_rise(self, estimate: ContactEstimate, *, time_s: float) -> Alarm | None:
        """Return an alarm if an uncalibrated current rises within a long movement."""
        if self._plan.current is not None or len(self._moving) < READING.fewest_frames:
            return None
        mean_ma = float(np.mean([current_ma for current_ma, _ in self._moving]))
        if len(self._empty_ma) < READING.fewest_frames:
            self._unaveraged = (self._unaveraged + 1) % READING.fewest_frames
            if self._unaveraged == 0:
                self._empty_ma.append(mean_ma)
            return None
        if mean_ma <= self._empty_hand_limit_ma:
            self._rise_s = math.nan
            return None
        if math.isnan(self._rise_s):
            self._rise_s = time_s
        has_responded = estimate.now_s > self._rise_s + READING.lag_s
        if not has_responded or estimate.confirmed_force_n > self._plan.no_push_n:
            return None
        return self._report_unexplained_rise(mean_ma)

    @property
    def _empty_hand_limit_ma(self) -> float:
        return CURRENT.sheet_ratio * max(*self._empty_ma, 0.0) + CURRENT.margin_ma

    def _report_unexplained_rise(self, mean_ma: float) -> Alarm:
        message = (
            f"the servo's current rose to {mean_ma:.0f} mA, from {max(self._empty_ma):.0f} mA with "
            "an empty hand, and the sheet shows no force; run `palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, message=message)

    def _check_sheet(self, estimate: ContactEstimate) -> Alarm | None:
        """Return an alarm if the current shows a larger force than the sheet."""
        if estimate.still_s < READING.quiet_s or not estimate.touches:
            return None
        if self._plan.current is None:
            return self._check_uncalibrated(estimate)
        shown_n = self._shown_n(estimate.now)
        bound_n = CURRENT.sheet_ratio * shown_n
        least_n = self._least_n(self._still, deviations=CURRENT.single_sd)
        if not self._is_checked:
            self._is_checked = True
            least_n = max(least_n, self._least_n(self._moving, deviations=CURRENT.single_sd))
            repeated_n = self._least_n(self._moving, deviations=CURRENT.repeated_sd)
            self._repeats = self._repeats + 1 if repeated_n > bound_n else 0
            if self._repeats > 1:
                least_n = max(least_n, repeated_n)
        return self._report_unseen(least_n, shown_n) if least_n > bound_n else None

    def _check_closing(self, time_s: float, closure: float) -> Alarm | None:
        """Return an alarm if the current of a closing hand showed more than the sheet does now."""
        if len(self._moving) < READING.fewest_frames or self._plan.current is None:
            return None
        least_n = 0.0
        bound_n = self._least_n(self._moving, deviations=CURRENT.single_sd)
        self._pulls.append((time_s, closure, bound_n))
        answered_s = time_s - READING.quiet_s
        if len(self._shown) == READING.fewest_frames:
            while self._pulls and self._pulls[0][0] <= answered_s:
                _, began, bound_n = self._pulls.popleft()
                # A hand that has opened since then may hold with less force.
                least_n = bound_n if began <= closure + self._plan.resolution else 0.0
        if not least_n > 0.0:
            return None
        shown_n = max(self._shown_n(touch) for touch in self._shown)
        is_unseen = least_n > CURRENT.sheet_ratio * shown_n
        return self._report_unseen(least_n, shown_n) if is_unseen else None

    def _shown_n(self, touch: Touch) -> float:
        """Return the upper bound of the force that the sheet shows, N."""
        return read_force(touch, Gain(), self._plan).high

    def _report_unseen(self, least_n: float, shown_n: float) -> Alarm:
        message = (
            f"the servo's current shows a grip of at least {least_n:.1f} N, and the sheet at most "
            f"{shown_n:.1f} N; check that the object lies on the sheet, and run `palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, message=message)

    def _check_uncalibrated(self, estimate: ContactEstimate) -> Alarm | None:
        touching = estimate.now.strongest_percent <= self._plan.hint_percent
        if self._is_checked or touching or not self._moving:
            return None
        self._is_checked = True
        mean_ma = float(np.mean([current_ma for current_ma, _ in self._moving]))
        if len(self._empty_ma) < READING.fewest_frames:
            self._empty_ma.append(mean_ma)
            return None
        return (
            None if mean_ma <= self._empty_hand_limit_ma else self._report_unexplained_rise(mean_ma)
        )
