"""Monitors of a grasp: each checks for one danger after every frame.

A monitor is a class with `__init__(plan)` and `check`. Add a monitor that needs the estimate to
`GRIP_MONITORS` below; it is skipped on uncertain frames and during the release. Create a monitor
that needs every frame in `run_grasp`. `runner.py` checks the gripper's reports. The monitors of
pixels, servo current and gripper movements have a state, and are in separate modules.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from palpate.grasp.config import GUARDS, READING
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.rest import explain_implausible_rest, explain_noisy_rest
from palpate.grasp.safety import FORCE_CEILING_N, Alarm, Danger
from palpate.grasp.state import GraspState

_HOLDING = (Phase.SQUEEZE, Phase.SETTLE, Phase.HOLD)


class Monitor(Protocol):
    """A check for one danger."""

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return the alarm after a frame, if any; `state` includes that frame."""
        ...


class BoardMonitor:
    """Ends the grasp if the sensor board's pixel limit has tripped."""

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the board's own force ceiling has tripped."""
        if not observation.frame.ceiling_tripped:
            return None
        message = (
            "the board's own ceiling has tripped: a pixel reads more than "
            f"{FORCE_CEILING_N:g} N allow; remove the cause, then open the rig again"
        )
        return Alarm(danger=Danger.FORCE_LIMIT, message=message)


class RestMonitor:
    """Rejects new rest values that are implausible for this sheet, or too noisy for a contact."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._has_rest = plan, False

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the rest values of this attempt are implausible."""
        rest_ohm = state.estimate.rest_ohm
        is_checked, self._has_rest = self._has_rest, rest_ohm is not None
        if rest_ohm is None or is_checked:
            return None
        message = explain_implausible_rest(rest_ohm, plan=self._plan) or explain_noisy_rest(
            state.estimate.rest_force_n, plan=self._plan
        )
        return None if message is None else Alarm(danger=Danger.SENSOR_LOST, message=message)


class CeilingMonitor:
    """Opens the hand if the sheet shows more than the force ceiling."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the grip force exceeds the ceiling."""
        estimate, ceiling_n = state.estimate, self._plan.safety.force_ceiling_n
        if estimate.force_n <= ceiling_n:
            return None
        message = f"the sheet measures {estimate.force_n:.1f} N; the limit is {ceiling_n:g} N"
        return Alarm(danger=Danger.FORCE_LIMIT, message=message)


class SlipMonitor:
    """Opens the hand if the sheet no longer shows the object."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the object has left the hand."""
        estimate = state.estimate
        if state.phase not in _HOLDING or estimate.still_s < READING.quiet_s:
            return None
        if len(estimate.touches) < 2 * READING.fewest_frames:
            return None
        strongest_n = estimate.strongest_n
        if estimate.steps and state.correction.return_closure is None:
            strongest_n = max(strongest_n, estimate.steps[-1].touch.sheet_n)
        if estimate.now.sheet_n >= GUARDS.lost_fraction * strongest_n:
            return None
        return Alarm(danger=Danger.SLIPPED, message="")


class FingersMonitor:
    """Stops the hand if only one finger shows a grip, because a grip loads both."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if one finger alone shows a grip."""
        estimate, plan = state.estimate, self._plan
        gripping = state.phase in _HOLDING or state.activity is Activity.CONFIRM
        if not gripping or estimate.still_s < plan.dwell_s:
            return None
        if len(estimate.touches) < READING.fewest_frames:
            return None
        now = estimate.now
        # Changes are negative under load: the smallest is that of the loaded finger.
        pressed_percent = min(now.finger_percent)
        if now.weakest_percent <= plan.hint_percent:
            return None
        if pressed_percent > GUARDS.one_finger_hints * plan.hint_percent:
            return None
        message = (
            f"finger {int(np.argmin(now.finger_percent))} measures a grip force and the other "
            "finger none; one sheet has failed, or the object is next to it; run `palpate doctor`"
        )
        return Alarm(danger=Danger.SENSOR_LOST, message=message)


class ResponseMonitor:
    """Opens the hand if the reading falls while closing, or rises while opening."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the reading does not follow the movement."""
        if state.phase not in _HOLDING or not (self._is_falling(state) or self._is_rising(state)):
            return None
        message = (
            "the reading falls while the hand closes, or rises while it opens: the object yields, "
            "or the sheet does not show the force; run `palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, message=message)

    def _is_falling(self, state: GraspState) -> bool:
        """Return whether the reading fell in the last closing steps.

        Only steps since the contact of both fingers count, because one finger pushes the object.
        """
        steps, contact_s = state.estimate.steps, state.estimate.contact_s
        gripped = [
            step.touch.sheet_n
            for step in steps
            if contact_s is not None
            and step.touch.time_s >= contact_s
            and step.touch.weakest_percent <= READING.contact_percent
        ]
        if not gripped or steps[-1].touch.strongest_percent > READING.contact_percent:
            return False
        rises = np.diff(gripped)[-GUARDS.fall_steps :]
        falls = bool((rises < -GUARDS.response_fraction * max(gripped)).all())
        return falls and rises.size == GUARDS.fall_steps

    def _is_rising(self, state: GraspState) -> bool:
        """Return whether the reading after opening exceeds that of the furthest closing step."""
        estimate = state.estimate
        easing = state.activity is Activity.EASE and estimate.still_s >= self._plan.confirm_s
        if not easing or not estimate.touches:
            return False
        furthest = estimate.steps[-1]
        opened = estimate.closure < furthest.closure
        most = (1.0 + GUARDS.response_fraction) * furthest.touch.sheet_n
        return opened and estimate.now.sheet_n > most


class TimeMonitor:
    """Opens the hand if the grasp takes longer than planned."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the grasp exceeds the plan's longest duration."""
        if state.phase is Phase.HOLD or state.estimate.duration_s <= self._plan.longest_s:
            return None
        message = f"the grasp did not finish within {self._plan.longest_s:g} s"
        return Alarm(danger=Danger.TIMED_OUT, message=message)


#: Monitors that the controller runs before the phase's handler, in this order.
GRIP_MONITORS: tuple[Callable[[Plan], Monitor], ...] = (
    SlipMonitor,
    FingersMonitor,
    ResponseMonitor,
    TimeMonitor,
)
