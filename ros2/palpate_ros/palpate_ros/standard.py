"""The standard action `control_msgs/action/GripperCommand`, as MoveIt's gripper controllers use it.

Position is the opening in metres, max_effort the grip force in newtons (0: a gentle squeeze). Wider
than now opens; narrower is a grasp, which ends at the object with `stalled`, or finds nothing.
"""

from __future__ import annotations

from control_msgs.action import GripperCommand
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from palpate.grasp.result import Outcome
from palpate.grasp.safety import FORCE_CEILING_N
from palpate_ros.hand import Grasping, Hand, Moving

_FEEDBACK_S, _WIDER_MM = 0.1, 0.5


class StandardGripper:
    """Serves `gripper_cmd` for a hand that is driven by width."""

    def __init__(self, node: Node, hand: Hand, *, group: CallbackGroup) -> None:
        self._node, self._hand = node, hand
        self._server = ActionServer(
            node,
            GripperCommand,
            "~/gripper_cmd",
            self._obey,
            goal_callback=self._accepts,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def _accepts(self, goal: GripperCommand.Goal) -> GoalResponse:
        within = goal.command.position >= 0 and 0 <= goal.command.max_effort <= FORCE_CEILING_N
        if not within or self._hand.limits.drive != "width":
            self._node.get_logger().warning(
                f"gripper_cmd refused: position {goal.command.position:g} m (an opening), "
                f"max_effort {goal.command.max_effort:g} N (0 to {FORCE_CEILING_N:g})"
            )
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _obey(self, goal: ServerGoalHandle) -> GripperCommand.Result:
        asked = goal.request.command
        state = self._hand.state
        wider = state is not None and 1e3 * asked.position > state.width_mm - _WIDER_MM
        if wider:
            opening = self._hand.open(1e3 * asked.position)
            if opening is not None:
                return self._followed(goal, opening)
        else:
            grasping = self._hand.grasp(target_force_n=asked.max_effort or None)
            if grasping is not None:
                return self._grasped(goal, grasping)
        goal.abort()
        return self._result()

    def _followed(self, goal: ServerGoalHandle, order: Moving) -> GripperCommand.Result:
        while not order.over.wait(_FEEDBACK_S):
            if goal.is_cancel_requested:
                order.stop.set()
        if goal.is_cancel_requested:
            goal.canceled()
        elif order.refusal:
            goal.abort()
        else:
            goal.succeed()
        return self._result(reached=not order.refusal)

    def _grasped(self, goal: ServerGoalHandle, order: Grasping) -> GripperCommand.Result:
        while not order.known.wait(_FEEDBACK_S):
            if goal.is_cancel_requested:
                order.requests.stop.set()
            goal.publish_feedback(
                GripperCommand.Feedback(**self._now(force_n=order.belief.force_n))
            )
        found = order.result
        held = found is not None and (not order.over.is_set() or found.outcome is Outcome.HELD)
        if goal.is_cancel_requested:
            goal.canceled()
        elif held:
            goal.succeed()
        else:
            goal.abort()
        force = None if found is None else found.force_n
        value = None if force is None else force.value
        return self._result(force_n=value or 0.0, stalled=held)

    def _result(self, **found: float | bool) -> GripperCommand.Result:
        flags = {
            "reached_goal": bool(found.get("reached")),
            "stalled": bool(found.get("stalled")),
        }
        return GripperCommand.Result(**self._now(force_n=float(found.get("force_n", 0.0))), **flags)

    def _now(self, *, force_n: float) -> dict[str, float]:
        state = self._hand.state
        width_mm = float("nan") if state is None else state.width_mm
        return {"position": width_mm / 1e3, "effort": float(force_n)}
