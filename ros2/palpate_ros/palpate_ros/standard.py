"""The standard gripper actions of control_msgs, as MoveIt's gripper controllers use them.

Position is the opening in metres, effort the grip force in newtons (0 or none: a gentle squeeze). A
wider position opens the hand to it, or fully if an object is held; `reached_goal` is set if the
hand reaches it. A narrower position is a grasp, which ends `stalled` at the object, or is aborted
and opens. A velocity is ignored.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, TypeAlias

from control_msgs.action import GripperCommand, ParallelGripperCommand
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from sensor_msgs.msg import JointState

from palpate.errors import PalpateError
from palpate.grasp.result import Outcome
from palpate.grasp.safety import FORCE_CEILING_N
from palpate_ros.hand import Grasping, Hand, Moving

_Action: TypeAlias = type[GripperCommand] | type[ParallelGripperCommand]

#: Period of the feedback, seconds.
_FEEDBACK_S = 0.1
#: Largest distance from a reached goal, mm (guess).
_TOLERANCE_MM = 0.5


class StandardGripper:
    """Servers of `gripper_cmd` and `parallel_gripper_cmd` for a width drive."""

    def __init__(self, node: Node, hand: Hand, *, joint: str, group: CallbackGroup) -> None:
        self._node, self._hand, self._joint = node, hand, joint
        served = {"gripper_cmd": GripperCommand, "parallel_gripper_cmd": ParallelGripperCommand}
        self._servers = [
            ActionServer(
                node,
                action,
                f"~/{name}",
                partial(self._execute, action),
                goal_callback=partial(self._accept_goal, name),
                cancel_callback=lambda _: CancelResponse.ACCEPT,
                callback_group=group,
            )
            for name, action in served.items()
        ]

    def _accept_goal(self, name: str, goal: Any) -> GoalResponse:
        command = _command(goal)
        if (
            self._hand.limits.drive == "width"
            and list(command.name) in ([], [self._joint])
            and len(command.position) == 1
            and 0 <= command.position[0] < math.inf
            and len(command.effort) <= 1
            and all(0 <= force_n <= FORCE_CEILING_N for force_n in command.effort)
        ):
            return GoalResponse.ACCEPT
        self._node.get_logger().warning(
            f"{name} refused: position {list(command.position)} m, "
            f"effort {list(command.effort)} N, joint {list(command.name)}; give one opening and at "
            f"most {FORCE_CEILING_N:g} N for {self._joint} of a width drive"
        )
        return GoalResponse.REJECT

    def _execute(self, action: _Action, goal: ServerGoalHandle) -> Any:
        command, hand = _command(goal.request), self._hand
        wanted_mm, state = min(1e3 * command.position[0], hand.limits.highest), hand.state
        if state is not None and abs(wanted_mm - state.width_mm) <= _TOLERANCE_MM:
            goal.succeed()
            return action.Result(**self._state(action), reached_goal=True)
        order: Grasping | Moving | None = None
        try:
            if state is not None and wanted_mm > state.width_mm:
                order = hand.open(wanted_mm)
            elif state is not None:
                order = hand.grasp(target_force_n=(command.effort or [0.0])[0] or None)
        except PalpateError as error:
            self._node.get_logger().warning(f"no grasp: {error}")
        if order is None:
            goal.abort()
            return action.Result(**self._state(action))
        stop, ended = (
            (order.job.requests.stop, order.job.known)
            if isinstance(order, Grasping)
            else (order.stop, order.over)
        )
        while not ended.wait(_FEEDBACK_S):
            if goal.is_cancel_requested:
                stop.set()
            goal.publish_feedback(action.Feedback(**self._state(action, order)))
        is_stalled = isinstance(order, Grasping) and order.job.result.outcome is Outcome.HELD
        remaining_mm = math.nan if hand.state is None else wanted_mm - hand.state.width_mm
        is_opening = isinstance(order, Moving)
        has_reached = (remaining_mm if is_opening else -remaining_mm) <= _TOLERANCE_MM
        if goal.is_cancel_requested:
            goal.canceled()
        elif is_stalled or (is_opening and has_reached and not order.refusal):
            goal.succeed()
        else:
            goal.abort()
        return action.Result(
            **self._state(action, order), stalled=is_stalled, reached_goal=has_reached
        )

    def _state(self, action: _Action, order: Grasping | Moving | None = None) -> dict[str, Any]:
        """Return the common fields of result and feedback: opening, m, and force, N."""
        state, force_n = self._hand.state, 0.0
        if isinstance(order, Grasping):
            found, estimate = order.job.result.force_n, order.job.grasp_state.estimate
            answer_n = None if found is None else found.value
            force_n = estimate.force_n if answer_n is None else answer_n
        position_m = math.nan if state is None else state.width_mm / 1e3
        if action is GripperCommand:
            return {"position": position_m, "effort": float(force_n)}
        joint = JointState(name=[self._joint], position=[position_m], effort=[float(force_n)])
        joint.header.stamp = self._node.get_clock().now().to_msg()
        return {"state": joint}


def _command(goal: Any) -> JointState:
    """Return the goal of either action as a command of the joint."""
    if isinstance(goal, ParallelGripperCommand.Goal):
        return goal.command
    command = goal.command
    return JointState(position=[command.position], effort=[command.max_effort])
