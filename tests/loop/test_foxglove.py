"""`palpate live --foxglove` on the twin, with a client of the WebSocket protocol."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from benchmarks.dashboard import run_board_process
from jsonschema import Draft202012Validator
from tests.foxglove_client import FoxgloveClient, Received, foxglove_client

from palpate.recording.channels import SCHEMAS, decode
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.signal.relative import CONTACT_PERCENT

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


@pytest.fixture(scope="module")
def session() -> tuple[FoxgloveClient, list[Received]]:
    with live("sim-rigid", "--force") as address:
        # A client that disconnects immediately does not affect others.
        with foxglove_client(address) as first:
            first.subscribe()
        with foxglove_client(address) as client:
            client.subscribe()
            received = receive_until_contact(client)
    return client, received


Session = tuple[FoxgloveClient, list[Received]]


def messages_of(session: Session, topic: str) -> list[Received]:
    return [message for message in session[1] if message.topic == topic]


def test_foxglove_messages_conform_to_the_schemas_of_a_recording(session: Session) -> None:
    channels = session[0].channels
    for topic, schema in SCHEMAS.items():
        assert channels[topic]["schemaName"] == schema["title"]
        assert channels[topic]["encoding"] == "json"
        assert json.loads(channels[topic]["schema"]) == schema
    assert channels["/heat_map"]["schemaName"] == "foxglove.RawImage"
    validators = {
        topic: Draft202012Validator(json.loads(channel["schema"]))
        for topic, channel in channels.items()
        if channel["schemaEncoding"] == "jsonschema"
    }
    checked = {message.topic for message in session[1] if message.topic in validators}
    for message in session[1]:
        if message.topic in validators:
            validators[message.topic].validate(message.content)
    assert checked == {"/frames", "/gripper", "/events", "/change", "/force", "/link"}


def test_foxglove_stream_contains_every_frame_with_all_its_messages(session: Session) -> None:
    frames = [
        decode("/frames", json.dumps(message.content).encode(), layout=RIGID_LAYOUT)
        for message in messages_of(session, "/frames")
    ]
    assert len(frames) > 30
    numbers = [frame.sequence for frame in frames if isinstance(frame, Frame)]
    assert all(after == before + 1 for before, after in pairwise(numbers))
    times = [message.log_time_ns for message in messages_of(session, "/frames")][1:]
    for topic in ("/gripper", "/change", "/heat_map", "/force"):
        # The client may have connected during the first frame.
        assert [message.log_time_ns for message in messages_of(session, topic)][
            -len(times) :
        ] == times, topic


def test_foxglove_log_time_is_the_unix_time_of_the_frame(session: Session) -> None:
    frames = messages_of(session, "/frames")
    zero_ns = {
        round((message.log_time_ns - 1e9 * message.content["time_s"]) / 1e6) for message in frames
    }
    assert max(zero_ns) - min(zero_ns) <= 1
    (start,) = {int(session[0].server["sessionId"])}  # the server's start, Unix time in ms
    assert 0 < frames[0].log_time_ns / 1e6 - start < 60e3


def test_foxglove_heat_map_contains_the_values_of_the_change_channel(session: Session) -> None:
    for image, change in zip(
        messages_of(session, "/heat_map"), messages_of(session, "/change"), strict=False
    ):
        assert (image.content.height, image.content.width) == (4, 2)
        assert (image.content.encoding, image.content.step) == ("32FC1", 8)
        stamp = image.content.timestamp
        assert stamp.seconds * 10**9 + stamp.nanos == image.log_time_ns
        pixels = np.frombuffer(image.content.data, dtype="<f4")
        numbers = [change.content[f"r{row}c{col}_percent"] for row in range(4) for col in range(2)]
        assert pixels == pytest.approx(numbers, rel=1e-6)
        assert change.content["mean_percent"] == pytest.approx(np.mean(numbers))


def test_foxglove_force_has_an_interval_and_increases_at_contact(session: Session) -> None:
    forces = [message.content for message in messages_of(session, "/force")]
    assert all(0 <= one["low_n"] <= one["force_n"] <= one["high_n"] for one in forces)
    assert forces[-1]["force_n"] > 2 * forces[0]["force_n"]


def test_foxglove_contact_event_has_the_time_of_its_frame(session: Session) -> None:
    changes = {message.log_time_ns: message.content for message in messages_of(session, "/change")}
    contacts = [m for m in messages_of(session, "/events") if m.content["name"] == "contact"]
    for contact in contacts:
        rows = {"finger 0": (0, 1), "finger 1": (2, 3)}[contact.content["text"]]
        change = changes[contact.log_time_ns]
        lowest = min(change[f"r{row}c{col}_percent"] for row in rows for col in (0, 1))
        assert lowest <= CONTACT_PERCENT
    earlier = [m.content["mean_percent"] for m in messages_of(session, "/change")[:30]]
    assert min(earlier) > CONTACT_PERCENT


def test_foxglove_labels_simulated_data_in_server_name_and_link(session: Session) -> None:
    assert session[0].server["name"] == "palpate sim-rigid (SIMULATED)"
    links = [message.content for message in messages_of(session, "/link")]
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
