"""`palpate live --foxglove` on the twin, with a client of the WebSocket protocol."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from benchmarks.dashboard import run_board_process
from jsonschema import Draft202012Validator
from packages.foxglove.tests.foxglove_client import FoxgloveClient, Received, foxglove_client

from palpate.recording.channels import SCHEMAS, decode
from palpate.sensor.array import RIGID_LAYOUT
from palpate.signal.relative import CONTACT_PERCENT

pytestmark = pytest.mark.slow

COMMAND = (sys.executable, "-c", "from palpate.cli import main; main()", "live")


@contextmanager
def live(rig: str, *options: str) -> Iterator[str]:
    """Run `palpate live --foxglove` on a free port; yield the printed URL."""
    command = [*COMMAND, "--rig", rig, "--foxglove", "127.0.0.1:0", *options]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield _address(process.stderr)
        finally:
            process.kill()


def _address(stream: IO[str] | None) -> str:
    line = stream.readline()
    found = re.search(r"ws://\S+:\d+", line)
    assert found is not None, line
    return found[0]


def receive_until_contact(client: FoxgloveClient) -> list[Received]:
    """Return all messages until one second after the first contact."""
    received: list[Received] = []
    frames_left = None
    for message in client.messages():
        if message.topic == "/frames" and frames_left is not None:
            frames_left -= 1
            if frames_left < 0:
                return received
        received.append(message)
        if message.topic == "/events" and message.content["name"] == "contact":
            frames_left = 15
    raise AssertionError("no contact")


Session = tuple[FoxgloveClient, dict[str, list[Received]]]


@pytest.fixture(scope="module")
def session() -> Session:
    """A client, and the messages that it received, by topic."""
    with live("sim-rigid", "--force") as address:
        # A client that disconnects immediately does not affect others.
        with foxglove_client(address) as first:
            first.subscribe()
        with foxglove_client(address) as client:
            client.subscribe()
            received = defaultdict[str, list[Received]](list)
            for message in receive_until_contact(client):
                received[message.topic].append(message)
    return client, received


def test_foxglove_messages_conform_to_the_schemas_of_a_recording(session: Session) -> None:
    channels = session[0].channels
    for topic, schema in SCHEMAS.items():
        assert channels[topic]["schemaName"] == schema["title"]
        assert channels[topic]["encoding"] == "json"
        assert json.loads(channels[topic]["schema"]) == schema
    assert channels["/heat_map"]["schemaName"] == "foxglove.RawImage"
    described = {
        topic for topic, channel in channels.items() if channel["schemaEncoding"] == "jsonschema"
    }
    for topic in described:
        validator = Draft202012Validator(json.loads(channels[topic]["schema"]))
        for message in session[1][topic]:
            validator.validate(message.content)
    checked = {topic for topic in described if session[1][topic]}
    assert checked == {"/frames", "/gripper", "/events", "/change", "/force", "/link"}


def test_foxglove_stream_contains_every_frame_with_all_its_messages(session: Session) -> None:
    messages = session[1]["/frames"]
    frames = [
        decode("/frames", json.dumps(message.content).encode(), layout=RIGID_LAYOUT)
        for message in messages
    ]
    assert len(frames) > 30
    assert set(np.diff([frame.sequence for frame in frames])) == {1}
    times = [message.log_time_ns for message in messages][1:]
    for topic in ("/gripper", "/change", "/heat_map", "/force"):
        # The client may have connected during the first frame.
        found = [message.log_time_ns for message in session[1][topic]]
        assert found[-len(times) :] == times, topic


def test_foxglove_force_and_contact_event_belong_to_their_frames(session: Session) -> None:
    forces = [message.content for message in session[1]["/force"]]
    assert all(0 <= one["low_n"] <= one["force_n"] <= one["high_n"] for one in forces)
    assert forces[-1]["force_n"] > 2 * forces[0]["force_n"]
    changes = {message.log_time_ns: message.content for message in session[1]["/change"]}
    for event in session[1]["/events"]:
        if event.content["name"] == "contact":
            rows = {"finger 0": (0, 1), "finger 1": (2, 3)}[event.content["text"]]
            change = changes[event.log_time_ns]
            lowest = min(change[f"r{row}c{col}_percent"] for row in rows for col in (0, 1))
            assert lowest <= CONTACT_PERCENT
    assert min(one["mean_percent"] for one in list(changes.values())[:30]) > CONTACT_PERCENT


def test_foxglove_labels_simulated_data_in_server_name_and_link(session: Session) -> None:
    assert session[0].server["name"] == "palpate sim-rigid (SIMULATED)"
    links = [message.content for message in session[1]["/link"]]
    assert len(links) > 2
    assert all(one["simulated"] and one["source"] == "sim-rigid" for one in links)
    assert links[-1]["rate_hz"] == pytest.approx(250.0, abs=0.5)
    assert (links[-1]["lost"], links[-1]["corrupt"]) == (0, 0)


def test_foxglove_silent_and_returning_board_create_events(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    with run_board_process(100.0) as (port, board):
        rig.write_text(
            '[array]\nopen = "palpate.sensor.board_array:open_board"\n'
            f'port = "{port}"\nrate_hz = 100.0\n'
        )
        with live(str(rig)) as address, foxglove_client(address) as client:
            client.subscribe()
            messages = client.messages()
            # Changes are available after one second, when the rest values are known.
            first = next(message for message in messages if message.topic == "/change")
            assert abs(time.time_ns() - first.log_time_ns) < 1e9
            os.kill(board, signal.SIGSTOP)
            silent = next(message for message in messages if message.topic == "/events")
            os.kill(board, signal.SIGCONT)
            back = next(message for message in messages if message.topic == "/events")
            link = next(message for message in messages if message.topic == "/link")
    assert (silent.content["name"], back.content["name"]) == ("silent", "back")
    # The event "back" has the time of its frame, which this board sends late.
    assert first.log_time_ns < min(silent.log_time_ns, back.log_time_ns)
    assert link.content["simulated"] is False
    assert "SIMULATED" not in client.server["name"]
