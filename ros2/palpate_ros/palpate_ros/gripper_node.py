"""`ros2 run palpate_ros gripper`: gripper and sensor, with grasp action and stop service."""

from __future__ import annotations

import importlib
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate_msgs.action import Grasp
from palpate_msgs.msg import Measurement
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from palpate import open_rig
from palpate.errors import PalpateError
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.safety import FORCE_CEILING_N
from palpate.rig import Rig
from palpate.rig.job import GraspJob
from palpate.rig.paced_array import PacedArray
from palpate.rig.recorded import recording_info
from palpate.sensor.array import PressureArray
from palpate_ros.hand import Hand
from palpate_ros.messages import build_measurement
from palpate_ros.parameters import HAND, SHARED, declare
from palpate_ros.spinning import run
from palpate_ros.topics import Provenance, SensorTopics

_FEEDBACK_S, _DIAGNOSE_S, _OPENING_S = 0.1, 1.0, 15.0


class GripperNode(Node):
    """The action `grasp`, the standard gripper actions, and the services `stop` and `release`.

    Raises
    ------
    PalpateError
        If the rig can't be opened.
    """

    def __init__(self) -> None:
        super().__init__("palpate_gripper")
        declare(self, SHARED | HAND)
        self._rig = rig = self._open_rig()
        array: PressureArray = rig.array
        if rig.is_simulated:
            array = PacedArray(array, speed=self._value("speed"))
        first = array.read(timeout_s=2.0)
        info = recording_info(rig, seed=self._value("seed"))
        info = replace(info, gripper=rig.gripper.limits)
        if rig.is_simulated:
            # Simulated time starts at 0; other nodes use the current time.
            info = replace(info, clock_zero_unix_ns=time.time_ns() - round(first.time_s * 1e9))
        about = Provenance(
            info=info,
            calibration=rig.calibration,
            oversampling=first.oversampling,
            frame_id=self._value("frame_id"),
            joint=self._value("joint"),
        )
        self.topics = SensorTopics(self, about)
        damage = self._value("damage")
        self.hand = Hand(
            rig,
            array=array,
            hold_s=self._value("hold_s"),
            damage=Path(damage) if damage else None,
            viewer=self.topics.publish,
            on_fault=self._report_fault,
        )
        self._timer = self.create_timer(_DIAGNOSE_S, self.topics.diagnose)
        concurrent = ReentrantCallbackGroup()
        self._server = ActionServer(
            self,
            Grasp,
            "~/grasp",
            self._grasp,
            goal_callback=self._accept_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=concurrent,
        )
        self.create_service(Trigger, "~/stop", self._stop, callback_group=concurrent)
        self.create_service(Trigger, "~/release", self._release, callback_group=concurrent)
        try:
            standard = importlib.import_module("palpate_ros.standard")
        except ModuleNotFoundError:
            self.get_logger().info("control_msgs is not installed: no standard gripper actions")
        else:
            self._standard = standard.StandardGripper(
                self, self.hand, joint=self._value("joint"), group=concurrent
            )

    def shut_down(self) -> None:
        """Make the hand safe and close the rig."""
        self.hand.close()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _open_rig(self) -> Rig:
        return open_rig(
            self._value("rig"), object_name=self._value("object") or None, seed=self._value("seed")
        )

    def _report_fault(self, text: str) -> None:
        self.topics.fail(text)
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    # -- the action -------------------------------------------------------------------------------

    def _accept_goal(self, goal: Grasp.Goal) -> GoalResponse:
        target_n = goal.target_force_n
        if not 0 <= target_n <= FORCE_CEILING_N:
            self.get_logger().warning(
                f"goal refused: target_force_n {target_n:g} is not within 0 to "
                f"{FORCE_CEILING_N:g} N, the force ceiling"
            )
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _grasp(self, goal: ServerGoalHandle) -> Grasp.Result:
        reason = "the hand is busy or holds an object; call the service `release` first"
        try:
            order = self.hand.grasp(
                target_force_n=goal.request.target_force_n or None, kind=goal.request.kind
            )
        except PalpateError as error:
            order, reason = None, str(error)
        if order is None:
            goal.abort()
            return Grasp.Result(outcome="refused", decision_time_s=math.nan, faults=[reason])
        while not order.job.known.wait(_FEEDBACK_S):
            if goal.is_cancel_requested:
                order.job.requests.stop.set()
            goal.publish_feedback(self._feedback(order.job))
        found = self._result(order.job.result)
        if goal.is_cancel_requested:
            goal.canceled()
        elif found.outcome == Outcome.HELD:
            goal.succeed()
        else:
            goal.abort()
        return found

    def _feedback(self, job: GraspJob) -> Grasp.Feedback:
        grasp_state, state = job.grasp_state, self.hand.state
        return Grasp.Feedback(
            phase=grasp_state.activity.value,
            force_n=float(grasp_state.estimate.force_n),
            force_high_n=float(grasp_state.estimate.force_high_n),
            width_mm=math.nan if state is None else state.width_mm,
            pressure_kpa=math.nan if state is None else state.pressure_kpa,
        )

    def _result(self, found: GraspResult) -> Grasp.Result:
        return Grasp.Result(
            outcome=str(found.outcome),
            decision_time_s=math.nan if found.decision_time_s is None else found.decision_time_s,
            measurements=_measurements(found),
            limited=found.is_limited,
            simulated=self._rig.is_simulated,
            faults=list(found.faults),
        )

    # -- services ---------------------------------------------------------------------------------

    def _stop(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self.hand.stop()
        answer.success, answer.message = True, "stopped on request"
        return answer

    def _release(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        order = self.hand.open()
        if order is None:
            answer.success, answer.message = False, "the hand is already moving"
            return answer
        arrived = order.over.wait(_OPENING_S)
        answer.success = arrived and not order.refusal
        answer.message = order.refusal or ("open" if arrived else "not open yet")
        return answer


def _measurements(found: GraspResult) -> list[Measurement]:
    named = {
        "force": found.force_n,
        "size": found.size_mm,
        "stiffness": found.stiffness_n_per_mm,
        "settled_change": found.settled_percent,
    }
    return [build_measurement(Measurement, name, value) for name, value in named.items()]


def main() -> None:
    """Run the node until Ctrl-C; the hand is then stopped or open."""
    run(GripperNode, name="palpate_gripper")


if __name__ == "__main__":
    main()
