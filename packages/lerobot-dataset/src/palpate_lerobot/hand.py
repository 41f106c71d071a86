"""A calibrated gripper for a learned policy, with force observations and a force limit.

Observations and actions have the names of the data sets of `palpate export --lerobot`, so that a
policy trained on recorded grasps can control the hand.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.force.of_calibration import force_now
from palpate.grasp.config import READING
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.safety import FORCE_CEILING_N, largest_step
from palpate.gripper.interface import Gripper, GripperCommand, GripperState
from palpate.measurement import Measurement
from palpate.object.damage_file import DamageFile
from palpate.sensor.array import Frame, PressureArray
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import SampleReader
from palpate_lerobot.episode import action_names, state_names

#: Timeout of a frame, seconds.
_FRAME_S = 2.0
#: Duration of the spike after a movement, which may hide a contact, seconds.
_HIDDEN_S = 0.15
#: An unknown stiffness.
_UNKNOWN_STIFFNESS = Measurement(value=1e3, low=1e-6, high=1e9, unit="n_per_mm", level=0.9)


def read_learned_limit_n(path: Path, *, kind: str = "") -> float:
    """Return the force limit for objects of a kind, at most the ceiling, N.

    The limit holds for an object of unknown stiffness.

    Raises
    ------
    CalibrationError, InputError
        If the file can't be read, or does not contain the kind.
    """
    file = DamageFile.load(path)
    known = file.check_kind(kind, where=str(path)) if kind else ""
    return min(file.model.bound_n(_UNKNOWN_STIFFNESS, kind=known), FORCE_CEILING_N)


class PolicyHand:
    """A hand with its sensor: observations in newtons, and closing below a force limit.

    A policy's action is limited so that upper force + upper stiffness x travel stays below the
    limit for any object (`palpate.grasp.safety.largest_step`). Unlike in a grasp, the travel of a
    hand that stops late at its target is not subtracted. The sheet lags during pressing, so
    after contact the force is the last reading at standstill; to press further, a policy must wait
    for the next reading. If the force exceeds the limit, the hand opens. Opening is never limited.

    Parameters
    ----------
    array, gripper
        The devices, with the fingers open.
    calibration : Calibration
        Calibration of this sensor on this gripper.
    limit_n : float
        Force limit of the object; `read_learned_limit_n` reads it from a damage file.

    Raises
    ------
    InputError
        If the limit is not positive, or above the force ceiling.
    CalibrationError
        If the calibration has no force, or the sheet is not at rest.
    DeviceError
        If the sensor sends no frames.

    Examples
    --------
    >>> from palpate.rig import open_rig
    >>> rig = open_rig("sim-rigid", object_name="strawberry", seed=1)
    >>> hand = PolicyHand(rig.array, rig.gripper, calibration=rig.calibration, limit_n=2.0)
    >>> seen = hand.observe()
    >>> seen["width_mm"], seen["force_low_n"] <= seen["force_n"] <= seen["force_high_n"]
    (74.0, True)
    >>> sent = hand.send({"width_mm": 5.0, "rate_mm_per_s": 20.0})
    >>> 73.0 < sent["width_mm"] < 74.0
    True
    """

    def __init__(
        self,
        array: PressureArray,
        gripper: Gripper,
        *,
        calibration: Calibration,
        limit_n: float = FORCE_CEILING_N,
    ) -> None:
        if not 0 < limit_n <= FORCE_CEILING_N:
            raise InputError(f"limit_n {limit_n:g}: must be above 0 and at most {FORCE_CEILING_N}")
        self._array, self._gripper, self._limit_n = array, gripper, limit_n
        self._plan: Plan = plan_grasp(calibration, gripper=gripper)
        self._force = force_now(calibration)
        self.state_names = state_names(array.layout, gripper.limits.drive)
        self.action_names = action_names(gripper.limits.drive)
        self._reader = SampleReader(array.layout, self._measure_rest())
        self._closure, self._moved_s = 0.0, -math.inf
        self._contact_n, self._known_n, self._known_closure = 0.0, math.inf, 0.0
        #: Times and closures since the last reading that shows a contact.
        self._path: deque[tuple[float, float]] = deque()
        self._sent: GripperCommand | None = None
        self.observe()

    def observe(self) -> dict[str, float]:
        """Read the newest frame, waiting if necessary; return the observation.

        Raises
        ------
        DeviceError
            If the sensor or the gripper is lost; the hand is then stopped.
        """
        try:
            frame, state = self._read_newest(), self._gripper.state()
        except DeviceError:
            self._gripper.stop()
            raise
        sample = self._reader.read(frame)
        force = self._force.step(
            sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
        )
        change = sample.change_percent
        position = self._gripper.limits.drive_reading(state)
        touched = bool(np.nanmin(change) <= self._plan.hint_percent)
        self._record_state(frame.time_s, state, force, touched=touched)
        values = [position, force.middle, force.low, force.high, *change.ravel().tolist()]
        return dict(zip(self.state_names, values, strict=True))

    def send(self, action: Mapping[str, float]) -> dict[str, float]:
        """Move towards the policy's target within the force limit; return the command sent.

        Parameters
        ----------
        action : mapping
            Target and speed, with the keys `action_names`.

        Raises
        ------
        InputError
            If a number is missing or not finite.
        DeviceError
            If the gripper is lost.
        """
        wanted = [action.get(name, np.nan) for name in self.action_names]
        if not np.isfinite(wanted).all():
            names = ", ".join(self.action_names)
            raise InputError(f"an action needs finite values of {names}; got {action}")
        safe = self._limit_command(GripperCommand(target=wanted[0], rate=wanted[1]))
        if safe != self._sent:
            self._sent = safe = self._gripper.command(safe)
            self._moved_s = self._path[-1][0]
        return dict(zip(self.action_names, (safe.target, safe.rate), strict=True))

    def stop(self) -> None:
        """Stop the fingers where they are."""
        self._gripper.stop()

    def close(self) -> None:
        """Stop the fingers, and close the devices."""
        try:
            self._gripper.stop()
        finally:
            self._array.close()
            self._gripper.close()

    def _record_state(
        self, time_s: float, state: GripperState, force: Measurement, *, touched: bool
    ) -> None:
        """Record the closure, and the upper force if this reading determines it."""
        closure, self._closure = self._closure, self._gripper.limits.closure(state)
        self._contact_n = force.middle
        if state.moving or abs(self._closure - closure) > self._plan.resolution:
            self._moved_s = time_s
        self._path.append((time_s, self._closure))
        if time_s - self._moved_s >= self._plan.dwell_s:
            self._known_n, self._known_closure = force.high, self._closure
        elif not touched:
            while len(self._path) > 1 and time_s - self._path[1][0] >= _HIDDEN_S:
                self._path.popleft()
            self._known_n, self._known_closure = force.high, min(c for _, c in self._path)

    def _limit_command(self, wanted: GripperCommand) -> GripperCommand:
        """Limit a command to the safe range after the last reading."""
        limits, plan = self._gripper.limits, self._plan
        if self._contact_n > self._limit_n:
            return GripperCommand(target=limits.target(0.0), rate=limits.fastest)
        furthest = self._known_closure + largest_step(
            force_high_n=self._known_n,
            steepest_n=plan.steepest_n,
            damage_low_n=self._limit_n,
            limits=plan.safety,
        )
        closure = abs(wanted.target - limits.target(0.0))
        if closure <= furthest:
            return wanted
        if furthest - self._closure >= plan.smallest_step:
            return GripperCommand(target=limits.target(furthest), rate=wanted.rate)
        # Too small for a movement, which would delay the next reading.
        return self._sent or GripperCommand(target=limits.target(self._closure), rate=wanted.rate)

    def _read_newest(self) -> Frame:
        """Return the newest frame; queued frames are outdated if a policy is slow."""
        frame = self._array.read(timeout_s=_FRAME_S)
        while True:
            try:
                frame = self._array.read(timeout_s=0.0)
            except DeviceTimeoutError:
                return frame

    def _measure_rest(self) -> np.ndarray:
        """Measure the rest of the open hand, like a grasp."""
        plan, frames = self._plan, [self._array.read(timeout_s=_FRAME_S)]
        while (
            len(frames) < READING.rest_frames or frames[-1].time_s - frames[0].time_s < plan.rest_s
        ):
            frames.append(self._array.read(timeout_s=_FRAME_S))
        reader = SampleReader(self._array.layout)
        ohm = np.array([reader.read(frame).resistance_ohm for frame in frames])
        return rest_baseline(ohm, known_ohm=plan.rest_ohm).rest_ohm
