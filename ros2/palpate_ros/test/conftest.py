"""Nodes in their own processes, connected over DDS to a client in the test."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node

from palpate.twin.rig import calibrate_twin

#: Timeout: a busy machine starts and discovers a node slowly.
PATIENCE_S = 90.0
#: Pause after discovery: a server that has not discovered the client loses its answer.
FOUND_S = 1.0
_ENTRY_POINTS = "[palpate.rigs]\nbench = bench_rigs:open_bench\nservo = bench_rigs:open_servo\n"


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the environment of the processes: their own domain, and the test rigs."""
    folder = tmp_path_factory.mktemp("rigs")
    calibrate_twin(seed=5, level="lab", apart_from="strawberry").save(folder / "pad.json")
    found = folder / "palpate_bench-0.dist-info"
    found.mkdir()
    (found / "METADATA").write_text("Metadata-Version: 2.1\nName: palpate-bench\nVersion: 0\n")
    (found / "entry_points.txt").write_text(_ENTRY_POINTS)
    here = str(Path(__file__).parent)
    added = {
        "ROS_DOMAIN_ID": str(random.Random(os.getpid()).randrange(1, 100)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PALPATE_TEST_PAD": str(folder / "pad.json"),
        "PYTHONPATH": os.pathsep.join([str(folder), here, os.environ.get("PYTHONPATH", "")]),
    }
    os.environ.update(added)
    return {**os.environ}


class Client:
    """A client node of the test."""

    def __init__(self) -> None:
        self.node = Node("test_client")

    def until(self, ready: Callable[[], Any], what: str) -> Any:
        """Spin until a value is true, and return it."""
        until_s = time.monotonic() + PATIENCE_S
        while not (found := ready()):
            assert time.monotonic() < until_s, f"{what}: not within {PATIENCE_S:g} s"
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return found

    def find(self, is_ready: Callable[[], bool], name: str) -> None:
        """Spin until a server is ready and has had time to discover this client."""
        self.until(is_ready, name)
        found_s = time.monotonic()
        self.until(lambda: time.monotonic() > found_s + FOUND_S, name)

    def wait(self, future: Any, what: str) -> Any:
        """Spin until a future is done, and return its result."""
        self.until(future.done, what)
        return future.result()

    def call(self, kind: Any, name: str) -> Any:
        """Call a service without arguments."""
        client = self.node.create_client(kind, name)
        self.find(client.service_is_ready, name)
        return self.wait(client.call_async(kind.Request()), name)

    def goal(self, kind: Any, name: str, goal: Any, feedback: list[Any]) -> Any:
        """Send a goal; return its accepted handle."""
        client = ActionClient(self.node, kind, name)
        self.find(client.server_is_ready, name)
        sent = client.send_goal_async(goal, feedback_callback=lambda m: feedback.append(m.feedback))
        handle = self.wait(sent, "goal response")
        assert handle.accepted
        return handle

    def result(self, handle: Any) -> Any:
        """Wait for the end of a goal; return status and result."""
        return self.wait(handle.get_result_async(), "result")

    def subscribe(self, kind: Any, topic: str, qos: Any) -> list[Any]:
        """Subscribe to a topic; return the list of received messages."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages


@pytest.fixture
def client(environment: dict[str, str]) -> Iterator[Client]:
    rclpy.init()
    found = Client()
    yield found
    found.node.destroy_node()
    rclpy.shutdown()


class Launched:
    """A node's process."""

    def __init__(self, module: str, environment: dict[str, str], **parameters: object) -> None:
        given = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
        self.stderr = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"palpate_ros.{module}", "--ros-args", *given],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self, number: int = signal.SIGINT) -> str:
        """Send a signal; return the standard error of the process."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        self.stderr += self.process.communicate(timeout=PATIENCE_S)[1]
        return self.stderr


@pytest.fixture
def launch(environment: dict[str, str]) -> Iterator[Callable[..., Launched]]:
    launched: list[Launched] = []

    def start(module: str, **parameters: object) -> Launched:
        launched.append(Launched(module, {**os.environ}, **parameters))
        return launched[-1]

    yield start
    for one in launched:
        if one.process.stderr is not None and not one.process.stderr.closed:
            one.end(signal.SIGKILL)
