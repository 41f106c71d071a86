"""The controller of a grasp: after each observation, one step of its present state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from palpate.grasp.answers import count_contact_steps
from palpate.grasp.approach import approach
from palpate.grasp.config import GUARDS, SQUEEZE
from palpate.grasp.estimator import Observation
from palpate.grasp.monitors import GRIP_MONITORS, CeilingMonitor, Monitor
from palpate.grasp.paper_method import close_extra, close_until_contact, predict_exponentially
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety import Alarm, Reaction, reaction
from palpate.grasp.safety_filter import filter_command, stop_here
from palpate.grasp.settle import gentle_goal, goal_n, settle
from palpate.grasp.state import GraspState
from palpate.grasp.step_size import close_by, read_step, squeeze_step
from palpate.gripper.interface import GripperCommand

#: What a state does after a frame: it changes the state, and may wish for a command.
Handler: TypeAlias = Callable[[GraspState, Plan], GripperCommand | None]


class GraspController:
    """Decides, frame by frame; it has no clock, no devices and no chance.

    `plan`: what is to be done, and within which bounds.
    `state`: where to begin.
    """

    def __init__(self, plan: Plan, state: GraspState | None = None) -> None:
        self.plan, self.state = plan, state or GraspState()
        self._ceiling: Monitor = CeilingMonitor(plan)
        self._grip: list[Monitor] = [kind(plan) for kind in GRIP_MONITORS]

    def step(self, observation: Observation) -> GripperCommand | None:
        """Take in one observation and decide; return the command to send, if any.

        It never closes further than `safety.largest_step` allows: what a state wishes is cut to
        that by the safety filter, and only there.
        """
        self.state.estimate.update(observation, plan=self.plan)
        self.state.record_finger_events()
        wish = self._select_command(observation)
        command = filter_command(wish, self.state.estimate, self.plan)
        if command is not None:
            self.state.estimate.record_command(command, plan=self.plan)
        return command

    def _select_command(self, observation: Observation) -> GripperCommand | None:
        """Return the wish of the monitors first, then that of the state."""
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
        """End the grasp because of an alarm, as `safety.reaction` decides for its state."""
        state, outcome = self.state, Outcome(alarm.danger.outcome)
        if alarm.words:
            state.add_fault(alarm.words)
        drive = self.plan.gripper.drive
        if reaction(alarm.danger, phase=state.phase, drive=drive) is Reaction.OPEN:
            return state.release(self.plan, outcome)
        state.result = replace(state.result, outcome=outcome)
        state.enter(Phase.DONE, note=outcome.value)
        return None

    def release(self) -> GripperCommand:
        """End the grasp on request: `held` if there is an answer."""
        answered = self.state.result.force_n is not None
        return self.state.release(self.plan, Outcome.HELD if answered else Outcome.STOPPED)


def is_closing_too_far(state: GraspState, plan: Plan) -> bool:
    """Return whether a closing hand exceeds the force intended for its last command."""
    estimate = state.estimate
    moving = estimate.still_since_s is None and estimate.closure < estimate.sent
    closing = state.phase is Phase.SQUEEZE or state.activity == Phase.SETTLE
    if not moving or plan.target_force_n is None or not closing:
        return False
    late_s = GUARDS.sheet_lag_s + estimate.period_s + plan.safety.latency_s
    ahead_n = estimate.confirmed_force_n + late_s * estimate.rise_n_per_s
    return ahead_n > GUARDS.max_force_ratio * goal_n(plan)


def squeeze(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Close further until the force is near the target, or enough to measure."""
    estimate = state.estimate
    if estimate.still_s < plan.dwell_s:
        return None
    read_step(estimate, plan)
    # A gentle squeeze is not corrected afterwards, and may exceed its force to measure the
    # stiffness.
    aimed, why = plan.target_force_n is not None, None
    if aimed:
        goal = SQUEEZE.near_fraction * goal_n(plan)
    else:
        goal, why = gentle_goal(estimate, plan)
    met = estimate.fast_contact
    borne = met is not None and estimate.closure < met[0]
    measures = not aimed and (why != "gave_way" or borne)
    few = measures and count_contact_steps(estimate, plan) < plan.fewest_steps
    if estimate.force_n < goal or few:
        wish = close_by(estimate, squeeze_step(estimate, plan, goal_n=goal), plan)
        if wish is not None:
            return wish
    state.enter(Phase.SETTLE, note=why)
    return None


def hold(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Keep holding for the plan's `hold_s`."""
    return None if state.elapsed_s < plan.hold_s else state.release(plan, Outcome.HELD)


def finish_release(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait until the hand is open."""
    # Half a step: closer than that some grippers never report themselves.
    opened = state.estimate.closure <= plan.step / 2
    if opened or state.elapsed_s > GUARDS.max_opening_s:
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
#: The states of the paper's method (`plan.paper`): the other ones are as above.
PAPER_HANDLERS: dict[Phase, Handler] = {
    **HANDLERS,
    Phase.APPROACH: close_until_contact,
    Phase.SQUEEZE: close_extra,
    Phase.SETTLE: predict_exponentially,
}
