"""Controller of a grasp: runs one step of the present phase after each observation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from palpate.grasp.answers import count_contact_steps
from palpate.grasp.approach import approach
from palpate.grasp.config import GUARDS, READING, SQUEEZE
from palpate.grasp.estimator import Observation
from palpate.grasp.monitors import GRIP_MONITORS, CeilingMonitor, Monitor
from palpate.grasp.paper_method import close_extra, close_until_contact, predict_exponentially
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety import Alarm, Reaction, reaction
from palpate.grasp.safety_filter import filter_command, stop_here
from palpate.grasp.settle import gentle_goal, goal_n, settle
from palpate.grasp.state import GraspState
from palpate.grasp.step_size import close_by, record_step, squeeze_step
from palpate.grasp.tighten import tighten
from palpate.gripper.interface import GripperCommand

#: Handler of a phase: updates the state after a frame, and may request a command.
Handler: TypeAlias = Callable[[GraspState, Plan], GripperCommand | None]


class GraspController:
    """Deterministic controller of a grasp, without clock or devices.

    `plan`: task and limits.
    `state`: initial state; a new one by default.
    """

    def __init__(self, plan: Plan, state: GraspState | None = None) -> None:
        self.plan, self.state = plan, state or GraspState()
        self._ceiling: Monitor = CeilingMonitor(plan)
        self._grip: list[Monitor] = [kind(plan) for kind in GRIP_MONITORS]

    def step(self, observation: Observation) -> GripperCommand | None:
        """Process one observation; return the command to send, if any.

        `filter_command` limits every closing command.
        """
        self.state.estimate.update(observation, plan=self.plan)
        self.state.record_finger_events()
        requested = self._select_command(observation)
        command = filter_command(requested, self.state.estimate, self.plan)
        if command is not None:
            self.state.estimate.record_command(command, plan=self.plan)
        return command

    def _select_command(self, observation: Observation) -> GripperCommand | None:
        """Return the command that a monitor requires, or else that of the phase's handler."""
        state, plan = self.state, self.plan
        if state.phase not in (Phase.RELEASE, Phase.DONE):
            estimate, watched_n = state.estimate, state.estimate.confirmed_force_n
            if watched_n > plan.safety.force_ceiling_n:
                estimate.set_force(watched_n, max(watched_n, estimate.force_high_n))
            alarm = self._ceiling.check(observation, state)
            if alarm is None and is_closing_too_far(state, plan):
                return stop_here(estimate, plan)
            found = (monitor.check(observation, state) for monitor in self._grip)
            alarm = alarm or next((one for one in found if one is not None), None)
            if alarm is not None:
                return self.stop(alarm)
        handlers = HANDLERS if plan.paper is None else PAPER_HANDLERS
        return handlers[state.phase](state, plan)

    def stop(self, alarm: Alarm) -> GripperCommand | None:
        """End the grasp because of an alarm; `safety.reaction` selects the movement."""
        state, outcome = self.state, Outcome(alarm.danger.outcome)
        if alarm.message:
            state.add_fault(alarm.message)
        drive = self.plan.gripper.drive
        if reaction(alarm.danger, phase=state.phase, drive=drive) is Reaction.OPEN:
            return state.release(self.plan, outcome)
        state.result = replace(state.result, outcome=outcome)
        state.enter(Phase.DONE, event=outcome.value)
        return None

    def release(self) -> GripperCommand:
        """End the grasp on request: `held` if the force has been measured."""
        answered = self.state.result.force_n is not None
        return self.state.release(self.plan, Outcome.HELD if answered else Outcome.STOPPED)


def is_closing_too_far(state: GraspState, plan: Plan) -> bool:
    """Return whether the force will exceed its limit before the closing hand can stop."""
    estimate = state.estimate
    sent, is_moving = estimate.sent, estimate.still_since_s is None
    moving = is_moving and sent is not None and estimate.closure < sent
    closing = state.activity in (Phase.SQUEEZE, Activity.FORECAST)
    if not moving or plan.target_force_n is None or not closing:
        return False
    late_s = READING.lag_s + estimate.period_s + plan.safety.latency_s
    ahead_n = estimate.confirmed_force_n + late_s * estimate.rise_n_per_s
    return ahead_n > GUARDS.max_force_ratio * goal_n(plan)


def squeeze(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Close further until the force is near the target, or sufficient for the measurement."""
    estimate = state.estimate
    if estimate.still_s < plan.dwell_s:
        return None
    record_step(estimate, plan)
    # A gentle squeeze is not corrected afterwards, and may exceed its force to measure the
    # stiffness.
    has_target, reason = plan.target_force_n is not None, None
    if has_target:
        goal = SQUEEZE.near_fraction * goal_n(plan)
    else:
        goal, reason = gentle_goal(estimate, plan)
    measures = not has_target and reason != "gave_way"
    few = measures and count_contact_steps(estimate, plan) < plan.fewest_steps
    if estimate.force_n < goal or few:
        command = close_by(estimate, squeeze_step(estimate, plan, goal_n=goal), plan)
        if command is not None:
            return command
    state.enter(Phase.SETTLE, event=reason)
    return None


def hold(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Hold for the plan's `hold_s`, tightening at a slip, then release."""
    command = tighten(state, plan)
    if command is not None or state.tightening.is_unread or state.phase_time_s < plan.hold_s:
        return command
    return state.release(plan, Outcome.HELD)


def finish_release(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait until the hand is open."""
    # Some grippers never report a position closer to open than half a step.
    opened = state.estimate.closure <= plan.step / 2
    if opened or state.phase_time_s > plan.longest_opening_s:
        state.enter(Phase.DONE)
    return None


HANDLERS: dict[Phase, Handler] = {
    Phase.APPROACH: approach,
    Phase.SQUEEZE: squeeze,
    Phase.SETTLE: settle,
    Phase.HOLD: hold,
    Phase.RELEASE: finish_release,
    Phase.DONE: lambda state, plan: None,
}
#: Handlers for the paper's method (`plan.paper`); the other phases are as above.
PAPER_HANDLERS: dict[Phase, Handler] = {
    **HANDLERS,
    Phase.APPROACH: close_until_contact,
    Phase.SQUEEZE: close_extra,
    Phase.SETTLE: predict_exponentially,
}
