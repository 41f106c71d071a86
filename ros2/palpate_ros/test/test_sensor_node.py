"""The sensor node over DDS: topics, lifecycle, diagnostics, and conversion of bags."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from palpate_msgs.action import Grasp
from palpate_ros.bag import convert
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import String

from palpate.recording import load_recording
from palpate.recording.exporting import cut_recorded_holds

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_sensor_node_publishes_topics_and_health(client: Any, launch: Any) -> None:
    node = launch("sensor_node", rig="bench", speed=4.0)
    counts = client.subscribe(Image, "/palpate_sensor/counts", qos_profile_sensor_data)
    ohm = client.subscribe(Image, "/palpate_sensor/resistance", qos_profile_sensor_data)
    high = client.subscribe(WrenchStamped, "/palpate_sensor/force_high", qos_profile_sensor_data)
    health = client.subscribe(DiagnosticArray, "/diagnostics", 10)
    client.until(lambda: len(counts) > 30 and ohm and high, "frames")
    assert (counts[0].height, counts[0].width, counts[0].encoding) == (4, 2, "16UC1")
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in counts]
    # Stamps follow the device's clock: the twin scans exactly every 1/15 s.
    assert np.rint(np.diff(stamps) * 15) == pytest.approx(np.diff(stamps) * 15, abs=1e-3)
    assert np.frombuffer(bytes(ohm[0].data), dtype="<f4").min() > 100.0
    assert high[0].wrench.force.z >= 0.0
    checked = client.until(
        lambda: [one.status[0] for one in health if one.status[0].values], "a checked sensor"
    )
    assert checked[0].level == DiagnosticStatus.OK
    assert {one.key for one in checked[0].values} >= {"rate_hz", "lost"}
    assert "Traceback" not in node.end()


def test_lifecycle_stops_and_starts_publishing(client: Any, launch: Any) -> None:
    launch("sensor_node", rig="bench", speed=4.0, autostart="false")
    counts = client.subscribe(Image, "/palpate_sensor/counts", qos_profile_sensor_data)

    def change(transition: int) -> None:
        service = client.node.create_client(ChangeState, "/palpate_sensor/change_state")
        client.find(service.service_is_ready, "lifecycle")
        request = ChangeState.Request(transition=Transition(id=transition))
        assert client.wait(service.call_async(request), "transition").success

    change(Transition.TRANSITION_CONFIGURE)
    assert not counts
    change(Transition.TRANSITION_ACTIVATE)
    client.until(lambda: len(counts) > 5, "frames")
    change(Transition.TRANSITION_DEACTIVATE)
    change(Transition.TRANSITION_CLEANUP)
    seen = len(counts)
    client.until(lambda: client.node.count_publishers("/palpate_sensor/counts") == 0, "cleanup")
    assert len(counts) - seen <= 5


def test_unknown_rig_is_logged_in_one_line(client: Any, launch: Any) -> None:
    node = launch("sensor_node", rig="no-such-rig")
    assert node.process.wait(90) == 3
    stderr = node.end()
    assert "no rig 'no-such-rig'" in stderr
    assert "Traceback" not in stderr


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_bag_converts_to_recording(
    client: Any, launch: Any, tmp_path: Path, storage: StoragePlugin
) -> None:
    """The bag has the format of `ros2 bag record`; its recording can be settled."""
    launch("gripper_node", rig="bench", speed=4.0, hold_s=3.0)
    topics = {
        "/palpate_gripper/counts": (Image, 250),
        "/joint_states": (JointState, 10),
        "/palpate_gripper/info": (String, LATCHED),
    }
    received = {name: client.subscribe(kind, name, qos) for name, (kind, qos) in topics.items()}
    client.until(lambda: len(received["/joint_states"]) > 20, "a second of rest")
    handle = client.goal(Grasp, "/palpate_gripper/grasp", Grasp.Goal(target_force_n=2.0), [])
    assert client.result(handle).result.outcome == "held"
    seen = len(received["/palpate_gripper/counts"])
    client.until(
        lambda: len(received["/palpate_gripper/counts"]) > seen + 30, "two seconds of hold"
    )
    bag, out = tmp_path / "bag", tmp_path / "grasp.mcap"
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(bag, version=9, storage_plugin=storage) as writer:
        for name, messages in received.items():
            kind = topics[name][0]
            package = kind.__module__.partition(".")[0]
            connection = writer.add_connection(
                name, f"{package}/msg/{kind.__name__}", typestore=store
            )
            for number, message in enumerate(messages):
                writer.write(connection, number, serialize_message(message))
    assert convert(bag, out) == len(received["/palpate_gripper/counts"])
    recording = load_recording(out)
    assert recording.info.origin == "twin"
    assert recording.info.gripper is not None
    sent = np.array(
        [np.frombuffer(bytes(m.data), "<u2") for m in received["/palpate_gripper/counts"]]
    )
    assert (recording.counts.reshape(sent.shape) == sent).all()
    assert any(hold.channel == "mean" for hold in cut_recorded_holds(recording))
    holds = tmp_path / "holds.csv"
    for command in (
        ["export", str(out), "--holds", "--out", str(holds)],
        ["settle", str(holds), "--cutoff", "1", "--json"],
    ):
        ended = subprocess.run(
            [sys.executable, "-m", "palpate", *command], check=True, capture_output=True
        )
    rows = json.loads(ended.stdout)["rows"]
    assert all(np.isfinite(row["predicted"]) for row in rows)


def test_folder_without_bag_prints_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "palpate_ros.bag", str(tmp_path), str(tmp_path / "out.mcap")]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 1
    assert "not a readable rosbag2" in ended.stderr
    assert "Traceback" not in ended.stderr
