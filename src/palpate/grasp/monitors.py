"""Monitors of a grasp: each checks for one danger after every frame.

A monitor is a class with `__init__(plan)` and `check`. Add a monitor that needs the estimate to
`GRIP_MONITORS` below; it is skipped on uncertain frames and during the release. Create a monitor
that needs every frame in `run_grasp`. `runner.py` checks the gripper's reports. The monitors of
pixels, servo current and gripper movements have a state, and are in separate modules.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np

from palpate.grasp.config import APPROACH, GUARDS, READING
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.response_monitor import (
    FreeMovement,
    ResponseMonitor,
    is_gripping,
    loads_of,
)
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
    """Stops the hand if only one finger shows a grip, because a grip loads both.

    Law, in each of three successive frames, with the loads of the two fingers, L = ln(rest
    resistance / resistance), and the load that the movement may hide, H (`FreeMovement`): the
    larger L exceeds two hints of contact, the smaller one is below one hint, and
    (smaller L + H) / (larger L + H) < 0.3.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._free = plan, FreeMovement(plan)
        self._loads = deque[list[float]](maxlen=READING.fewest_frames)

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if one finger alone shows a grip."""
        touch = state.estimate.last
        if touch is None:
            return None
        self._free.observe(touch, state)
        self._loads.append(loads_of(touch))
        weaker, stronger = max(map(min, self._loads)), min(map(max, self._loads))
        hint, hidden = -math.log1p(self._plan.hint_percent / 100.0), self._free.hidden(state)
        is_alone = weaker < hint and stronger > GUARDS.one_finger_hints * hint
        is_alone &= weaker + hidden < APPROACH.one_finger_fraction * (stronger + hidden)
        if not (is_alone and is_gripping(state) and len(self._loads) == READING.fewest_frames):
            return None
        loads = self._loads[-1]
        message = (
            f"finger {int(np.argmax(loads))} measures a grip force and the other finger none; one "
            "sheet has failed, or the object is next to it; run `palpate doctor`"
        )
        return Alarm(danger=Danger.SENSOR_LOST, message=message)


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
