"""The gripper node over DDS: goal, cancel, stop, release, and killed processes."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand, ParallelGripperCommand
from palpate_msgs.action import Grasp
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tests.contract.servo_bus import ServoBus

from palpate.clock import ManualClock
from palpate.twin.world import World

GRASP, STANDARD = "/palpate_gripper/grasp", "/palpate_gripper/gripper_cmd"
PARALLEL = "/palpate_gripper/parallel_gripper_cmd"
EXAMPLE = Path(__file__).parents[2] / "examples/moveit_gripper.py"
#: Timeout of a grasp on a busy machine.
PATIENCE_S = 120.0
STOP, RELEASE = "/palpate_gripper/stop", "/palpate_gripper/release"


def width_mm(messages: list[JointState]) -> float:
    return 1e3 * messages[-1].position[0] if messages else math.nan


@pytest.fixture
def joints(client: Any) -> list[JointState]:
    return client.subscribe(JointState, "/joint_states", 10)


def test_goal_returns_result_and_release_opens(
    client: Any, launch: Any, joints: list[JointState]
) -> None:
    node, feedback = launch("gripper_node", rig="bench", speed=4.0, object="strawberry"), []
    handle = client.goal(Grasp, GRASP, Grasp.Goal(target_force_n=2.0), feedback)
    found = client.result(handle)
    assert found.status == GoalStatus.STATUS_SUCCEEDED
    assert found.result.outcome == "held"
    assert found.result.simulated
    measured = {one.name: one for one in found.result.measurements}
    assert set(measured) == {"force", "size", "stiffness", "settled_change"}
    assert measured["force"].low <= measured["force"].value <= measured["force"].high
    assert measured["force"].value == pytest.approx(2.0, rel=0.3)
    assert measured["size"].unit == "mm"
    assert {"approach", "squeeze", "settle"} <= {one.phase for one in feedback}
    # The hold continues, and a second goal is refused.
    again = client.result(client.goal(Grasp, GRASP, Grasp.Goal(), []))
    assert (again.status, again.result.outcome) == (GoalStatus.STATUS_ABORTED, "refused")
    assert width_mm(joints) < 60.0
    assert client.call(Trigger, RELEASE).success
    client.until(lambda: width_mm(joints) > 73.0, "open hand")
    assert "Traceback" not in node.end()


def test_cancel_stops_hand_until_released(
    client: Any, launch: Any, joints: list[JointState]
) -> None:
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry")
    feedback: list[Any] = []
    handle = client.goal(Grasp, GRASP, Grasp.Goal(), feedback)
    client.until(lambda: any(one.phase == "squeeze" for one in feedback), "squeeze")
    client.wait(handle.cancel_goal_async(), "cancel")
    found = client.result(handle)
    assert (found.status, found.result.outcome) == (GoalStatus.STATUS_CANCELED, "stopped")
    seen = len(joints)
    client.until(lambda: len(joints) > seen + 15, "a second without motion")
    widths = [1e3 * one.position[0] for one in joints[seen + 1 :]]
    assert max(widths) - min(widths) <= 0.1
    refused = client.result(client.goal(Grasp, GRASP, Grasp.Goal(), []))
    assert "release" in refused.result.faults[0]
    assert client.call(Trigger, RELEASE).success


def test_stop_service_ends_goal(client: Any, launch: Any) -> None:
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry")
    feedback: list[Any] = []
    handle = client.goal(Grasp, GRASP, Grasp.Goal(), feedback)
    client.until(lambda: feedback, "feedback")
    assert client.call(Trigger, STOP).success
    found = client.result(handle)
    assert (found.status, found.result.outcome) == (GoalStatus.STATUS_ABORTED, "stopped")


def parallel(position_m: float, *, joint: str = "palpate_gripper", **numbers: float) -> Any:
    command = JointState(name=[joint], position=[position_m])
    for part, number in numbers.items():
        setattr(command, part, [number])
    return ParallelGripperCommand.Goal(command=command)


def standard(position_m: float, effort: float = 0.0) -> Any:
    goal = GripperCommand.Goal()
    goal.command.position, goal.command.max_effort = position_m, effort
    return goal


def opening(message: Any) -> tuple[float, float]:
    """Return position, m, and force, N, of a result or feedback of either action."""
    if hasattr(message, "state"):
        assert list(message.state.name) == ["palpate_gripper"]
        return message.state.position[0], message.state.effort[0]
    return message.position, message.effort


@pytest.mark.parametrize(
    ("action", "name", "goal"),
    [(GripperCommand, STANDARD, standard), (ParallelGripperCommand, PARALLEL, parallel)],
)
def test_standard_actions_close_until_stalled_and_open_to_the_goal(
    client: Any, launch: Any, joints: list[JointState], action: Any, name: str, goal: Any
) -> None:
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry")
    client.until(lambda: width_mm(joints) > 73.0, "open hand")
    feedback: list[Any] = []
    found = client.result(client.goal(action, name, goal(0.0, effort=2.0), feedback))
    assert found.status == GoalStatus.STATUS_SUCCEEDED
    assert (found.result.stalled, found.result.reached_goal) == (True, False)
    position_m, force_n = opening(found.result)
    assert force_n == pytest.approx(2.0, rel=0.3)
    assert position_m == pytest.approx(width_mm(joints) / 1e3, abs=1e-3)
    assert opening(feedback[0])[0] > position_m + 0.01
    # The same opening again causes no motion and keeps the object.
    found = client.result(client.goal(action, name, goal(position_m), []))
    assert (found.status, found.result.reached_goal) == (GoalStatus.STATUS_SUCCEEDED, True)
    assert width_mm(joints) == pytest.approx(1e3 * position_m, abs=1.0)
    found = client.result(client.goal(action, name, goal(0.074), []))
    assert found.status == GoalStatus.STATUS_SUCCEEDED
    assert (found.result.stalled, found.result.reached_goal) == (False, True)
    assert opening(found.result)[0] > 0.073


def test_parallel_command_without_object_is_aborted(client: Any, launch: Any) -> None:
    launch("gripper_node", rig="bench", speed=4.0, object="nothing")
    handle = client.goal(ParallelGripperCommand, PARALLEL, parallel(0.0), [])
    found = client.result(handle)
    assert found.status == GoalStatus.STATUS_ABORTED
    assert (found.result.stalled, found.result.reached_goal) == (False, False)


def test_cancelled_parallel_command_stops_until_opened(
    client: Any, launch: Any, joints: list[JointState]
) -> None:
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry")
    feedback: list[Any] = []
    handle = client.goal(ParallelGripperCommand, PARALLEL, parallel(0.0), feedback)
    client.until(lambda: feedback and opening(feedback[-1])[0] < 0.05, "closing")
    client.wait(handle.cancel_goal_async(), "cancel")
    found = client.result(handle)
    assert (found.status, found.result.stalled) == (GoalStatus.STATUS_CANCELED, False)
    seen = len(joints)
    client.until(lambda: len(joints) > seen + 15, "a second without motion")
    widths = [1e3 * one.position[0] for one in joints[seen + 1 :]]
    assert max(widths) - min(widths) <= 0.1
    again = client.result(client.goal(ParallelGripperCommand, PARALLEL, parallel(0.0), []))
    assert again.status == GoalStatus.STATUS_ABORTED
    opened = client.goal(ParallelGripperCommand, PARALLEL, parallel(0.074), [])
    assert client.result(opened).result.reached_goal


def test_invalid_goals_are_rejected(client: Any, launch: Any) -> None:
    launch("gripper_node", rig="bench", speed=4.0)
    for action, name, goal in (
        (Grasp, GRASP, Grasp.Goal(target_force_n=50.0)),
        (GripperCommand, STANDARD, standard(0.0, effort=50.0)),
        (ParallelGripperCommand, PARALLEL, parallel(0.0, effort=50.0)),
        (ParallelGripperCommand, PARALLEL, parallel(-0.01)),
        (ParallelGripperCommand, PARALLEL, parallel(math.nan)),
        (ParallelGripperCommand, PARALLEL, parallel(0.0, joint="elbow")),
        (ParallelGripperCommand, PARALLEL, ParallelGripperCommand.Goal()),
    ):
        with pytest.raises(AssertionError, match="accepted"):
            client.goal(action, name, goal, [])


def test_moveit_goals_close_on_object_and_open(launch: Any) -> None:
    """`ros2/examples/moveit_gripper.py` sends the goals of MoveIt's controller manager."""
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry")
    for position, expected in (("0.0", "stalled True"), ("0.074", "reached True")):
        done = subprocess.run(
            [sys.executable, str(EXAMPLE), position],
            env={**os.environ},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        assert done.returncode == 0, done.stderr
        assert expected in done.stdout


@pytest.mark.parametrize(
    ("action", "name"),
    [
        ("from palpate_msgs.action import Grasp as Action", GRASP),
        ("from control_msgs.action import ParallelGripperCommand as Action", PARALLEL),
    ],
    ids=["grasp", "parallel"],
)
def test_killed_client_leaves_time_limited_grasp(
    client: Any, launch: Any, joints: list[JointState], action: str, name: str
) -> None:
    """Without a request the object is held for `hold_s`, then released."""
    launch("gripper_node", rig="bench", speed=4.0, object="strawberry", hold_s=20.0)
    program = (
        "import rclpy; from rclpy.node import Node; from rclpy.action import ActionClient;"
        f"{action}; rclpy.init(); n = Node('doomed'); goal = Action.Goal();"
        "hasattr(goal, 'command') and goal.command.position.append(0.0);"
        f"c = ActionClient(n, Action, '{name}'); c.wait_for_server();"
        # An answer is lost if the server has not discovered the client yet, so goals are repeated.
        "send = lambda: c.send_goal_async(goal);"
        "wait = lambda f: rclpy.spin_until_future_complete(n, f, timeout_sec=5.0) or f.done();"
        "any(wait(send()) for _ in range(6));"
        "print('sent', flush=True); rclpy.spin(n)"
    )
    doomed = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert doomed.stdout is not None
    assert doomed.stdout.readline() == "sent\n"
    doomed.kill()
    doomed.wait()
    doomed.stdout.close()
    client.until(lambda: width_mm(joints) < 40.0, "closing continues")
    client.until(lambda: width_mm(joints) > 73.0, "released")


@contextmanager
def servo_at_work() -> Iterator[tuple[ServoBus, World]]:
    """Yield a servo whose world advances in real time on a thread."""
    world = World(None, seed=1, clock=ManualClock(time.monotonic()))
    bus = ServoBus(world)
    ending = threading.Event()

    def pump() -> None:
        while not ending.wait(0.01):
            world.clock.sleep_s(max(time.monotonic() - world.clock.now_s(), 0.0))
            with bus.lock:
                world.drive_value(world.clock.now_s())

    thread = threading.Thread(target=pump)
    thread.start()
    try:
        yield bus, world
    finally:
        ending.set()
        thread.join()
        bus.close()


def test_killed_node_stops_the_servo(client: Any, launch: Any, monkeypatch: Any) -> None:
    """The bus watchdog of the servo outlives the process."""
    with servo_at_work() as (bus, world):
        monkeypatch.setitem(os.environ, "PALPATE_TEST_PORT", bus.name)
        node = launch("gripper_node", rig="servo")
        client.goal(GripperCommand, STANDARD, standard(0.0), [])

        def width() -> float:
            with bus.lock:
                return world.drive_value(world.clock.now_s())

        client.until(lambda: width() < 72.0, "closing")
        node.end(signal.SIGKILL)
        # Watchdog of 0.5 s, and the delay of the machine.
        time.sleep(1.5)
        stopped = width()
        time.sleep(1.0)
        assert width() == pytest.approx(stopped, abs=1e-6)
        assert 30.0 < stopped < 72.0
