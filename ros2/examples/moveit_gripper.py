"""Drive palpate's hand like MoveIt's controller manager, without MoveIt.

    python ros2/examples/moveit_gripper.py 0.0      # close until the object
    python ros2/examples/moveit_gripper.py 0.074    # open

The script reads `moveit_controllers.yaml` in its folder and sends the goal that MoveIt 2's
`ParallelGripperCommandControllerHandle` creates from a trajectory: the last position of the joint
and `max_effort`. As in MoveIt, an aborted action has failed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rclpy
import yaml
from action_msgs.msg import GoalStatus
from control_msgs.action import ParallelGripperCommand
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState

CONTROLLERS = Path(__file__).with_name("moveit_controllers.yaml")


def main() -> int:
    """Send one position and print the result; return 0 if MoveIt would continue."""
    manager = yaml.safe_load(CONTROLLERS.read_text())["moveit_simple_controller_manager"]
    name = manager["controller_names"][0]
    controller = manager[name]
    command = JointState(
        name=controller["joints"],
        position=[float(sys.argv[1])],
        effort=[controller["max_effort"]],
    )
    goal = ParallelGripperCommand.Goal(command=command)

    rclpy.init()
    node = rclpy.create_node("moveit_gripper")
    client = ActionClient(node, ParallelGripperCommand, f"/{name}/{controller['action_ns']}")
    if not client.wait_for_server(timeout_sec=60.0):
        print(f"no action server at /{name}/{controller['action_ns']}", file=sys.stderr)
        return 3
    sent = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, sent)
    if not sent.result().accepted:
        print("the goal was rejected", file=sys.stderr)
        return 1
    ended = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    status, result = ended.result().status, ended.result().result
    print(
        f"opening {result.state.position[0]:.4f} m, effort {result.state.effort[0]:.2f} N, "
        f"stalled {result.stalled}, reached {result.reached_goal}"
    )
    node.destroy_node()
    rclpy.shutdown()
    return 0 if status == GoalStatus.STATUS_SUCCEEDED else 1


if __name__ == "__main__":
    sys.exit(main())
