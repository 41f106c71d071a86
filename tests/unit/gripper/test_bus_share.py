"""A shared servo line: each program gets its own replies, and none blocks the other."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.contract.hands import BAUD, CLOSED_TICK, JAW, make_world

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, InputError
from palpate.gripper import sts_series as sts
from palpate.gripper.bus_share import REPLY_S, SharedBus, share_bus
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import ServoLine
from palpate.twin.sts_bus import ArmServo, StsBus

READS = 150


@pytest.fixture
def servos() -> Iterator[StsBus]:
    """A line with the gripper, servo 6, and servos 1 and 2 of an arm."""
    arm = {1: ArmServo(tick=1111), 2: ArmServo(tick=2222)}
    bus = StsBus(make_world("rigid"), jaw=JAW, closed_tick=CLOSED_TICK, arm=arm)
    yield bus
    bus.close()


@pytest.fixture
def shared(servos: StsBus, tmp_path: Path) -> Iterator[SharedBus]:
    """The line, shared as `hand` and `arm`."""
    with share_bus(servos.name, [tmp_path / "hand", tmp_path / "arm"]) as bus:
        yield bus


def open_line(path: Path, servo_id: int, *, reply_s: float = 0.4) -> ServoLine:
    return ServoLine(str(path), servo_id=servo_id, baud=BAUD, reply_s=reply_s, packets=PROTOCOL_1)


def test_two_programs_at_once_each_get_their_own_replies(
    shared: SharedBus, servos: StsBus, tmp_path: Path
) -> None:
    hand, arm = open_line(tmp_path / "hand", 6), open_line(tmp_path / "arm", 2)
    read: list[int] = []

    def read_arm() -> None:
        read.extend(arm.read(sts.PRESENT_POSITION) for _ in range(READS))

    other = threading.Thread(target=read_arm)
    other.start()
    temperatures = {hand.read(sts.PRESENT_TEMPERATURE) for _ in range(READS)}
    other.join()
    assert temperatures == {servos.value(sts.PRESENT_TEMPERATURE)}
    assert read == [2222] * READS
    hand.close()
    arm.close()


@pytest.mark.slow
def test_missing_servo_delays_the_other_program_by_its_limit_only(
    shared: SharedBus, tmp_path: Path
) -> None:
    missing = open_line(tmp_path / "arm", 5, reply_s=0.5)
    hand = open_line(tmp_path / "hand", 6)
    failed: list[DeviceError] = []

    def ask() -> None:
        try:
            missing.read(sts.PRESENT_POSITION)
        except DeviceTimeoutError as error:
            failed.append(error)

    other = threading.Thread(target=ask)
    other.start()
    longest_s = 0.0
    while other.is_alive():
        start_s = time.monotonic()
        assert hand.read(sts.MODEL_NUMBER) == 777
        longest_s = max(longest_s, time.monotonic() - start_s)
    assert len(failed) == 1
    # The other program is served between the three requests, which last 1.5 s.
    assert longest_s < 1.0 < 3 * 0.5
    hand.close()
    missing.close()


def test_lost_line_is_reported_and_ends_the_replies(
    shared: SharedBus, servos: StsBus, tmp_path: Path
) -> None:
    hand = open_line(tmp_path / "hand", 6, reply_s=REPLY_S)
    assert hand.read(sts.MODEL_NUMBER) == 777
    servos.unplug()
    with pytest.raises(DeviceTimeoutError):
        hand.read(sts.MODEL_NUMBER)
    assert shared.failure is not None
    hand.close()


def test_shared_ports_vanish_at_the_end_and_the_line_is_free(
    servos: StsBus, tmp_path: Path
) -> None:
    # A link of a program that was killed is replaced.
    (tmp_path / "hand").symlink_to(tmp_path / "gone")
    for _ in range(2):
        with share_bus(servos.name, [tmp_path / "hand"]):
            line = open_line(tmp_path / "hand", 6)
            assert line.ping() == 0
            line.close()
        assert list(tmp_path.iterdir()) == []


def test_line_lost_without_a_request_is_noticed(shared: SharedBus, servos: StsBus) -> None:
    servos.unplug()
    end_s = time.monotonic() + 20.0
    while shared.failure is None:
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_names_in_use_are_refused_and_stay(
    shared: SharedBus, servos: StsBus, tmp_path: Path
) -> None:
    other = StsBus(make_world("rigid"), jaw=JAW, closed_tick=CLOSED_TICK)
    with pytest.raises(InputError, match="hand: is in use"):
        SharedBus(other.name, [tmp_path / "hand"])
    other.close()
    line = open_line(tmp_path / "hand", 6)
    assert line.ping() == 0
    line.close()


def test_share_refuses_a_file_as_a_port_and_a_missing_line(servos: StsBus, tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(InputError, match="choose another name"):
        SharedBus(servos.name, [tmp_path / "notes"])
    assert (tmp_path / "notes").read_text() == "mine"
    with pytest.raises(DeviceNotFoundError):
        SharedBus(str(tmp_path / "no-port"), [tmp_path / "hand"])
    with pytest.raises(InputError, match="no folder"):
        SharedBus(servos.name, [tmp_path / "absent" / "hand"])


@pytest.mark.slow
def test_command_ends_with_a_line_and_a_status(servos: StsBus, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "palpate.gripper.bus_share"]
    missing = subprocess.run(command, capture_output=True, text=True, check=False)
    assert missing.returncode == 2
    assert "port" in missing.stderr
    assert "Traceback" not in missing.stderr
    assert subprocess.run([*command, "--help"], capture_output=True, check=False).returncode == 0
    with subprocess.Popen(
        [*command, servos.name, str(tmp_path / "hand")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as shared:
        assert shared.stdout is not None
        shared.stdout.readline()
        servos.unplug()
        errors = shared.communicate(timeout=30.0)[1]
    assert shared.returncode == 3
    assert len(errors.splitlines()) == 1
    assert servos.name in errors
