"""The line to a servo: late and missing replies, and the claim of the port."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
import tty
from contextlib import suppress

import pytest
from tests.contract.hands import BAUD, Servo
from tests.pty_port import open_elsewhere

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper import sts_series as sts
from palpate.gripper import x_series as x
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import RefusedError, ServoLine


def test_protocol_1_packets_equal_the_examples_in_the_manual() -> None:
    # Ping of servo 1, and read of its position; the SDK adds header and checksum.
    assert PROTOCOL_1.build_request(1, 1, b"") == [0, 0, 1, 2, 1, 0]
    encode = PROTOCOL_1.encode_word
    requested = encode(sts.PRESENT_POSITION.address) + encode(sts.PRESENT_POSITION.size)
    assert PROTOCOL_1.build_request(1, 2, requested) == [0, 0, 1, 4, 2, 0x38, 2, 0]
    assert PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 4, 0, 0x18, 0x05, 0xDD], servo_id=1, size=2)
    assert not PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 4, 0, 0x18, 0x05, 0xDD], servo_id=2, size=2)
    assert not PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 2, 0, 0xFC], servo_id=1, size=2)


@pytest.mark.parametrize("cut_at", [1, 8, 12])
def test_servo_line_truncated_reply_raises_a_timeout(dynamixel: Servo, cut_at: int) -> None:
    line, dynamixel.bus.cut_at = dynamixel.connect(reply_s=0.1), cut_at
    with pytest.raises(DeviceTimeoutError, match=r"late or incomplete .* reply_s in the rig file"):
        line.read(x.MODEL_NUMBER)
    line.close()


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [0.09, 0.2])
def test_servo_line_does_not_use_a_late_reply_for_the_next_request(
    dynamixel: Servo, late_s: float
) -> None:
    """With a reply limit of 50 ms, an answer is correct or missing."""
    gripper, bus = dynamixel.open(reply_s=0.05), dynamixel.bus
    dynamixel.move(50.0, rate=5.0)
    dynamixel.world.clock.sleep_s(1.0)
    position_mm = dynamixel.width_mm
    for late_now_s in (late_s, 0.0):
        bus.late_s, answered, silent = late_now_s, 0, 0
        requests = 10 * [(x.CURRENT_LIMIT, 1193), (x.MODEL_NUMBER, 1020), (x.GOAL_PWM, 885)]
        for register, value in requests[: 6 if late_now_s else None]:
            try:
                assert gripper._line.read(register) == value
                assert gripper.state().width_mm == pytest.approx(position_mm, abs=0.1)
                answered += 1
            except DeviceTimeoutError:
                silent += 1
        assert silent if late_now_s else answered


def test_servo_line_write_to_locked_memory_is_refused(dynamixel: Servo) -> None:
    line = dynamixel.connect()
    line.write(x.TORQUE_ENABLE, 1)
    with pytest.raises(RefusedError, match="refused: access") as refused:
        line.write(x.OPERATING_MODE, x.Mode.POSITION)
    assert refused.value.code == x.PacketError.ACCESS
    line.close()


def test_servo_line_reply_16_ms_late_needs_no_second_try(dynamixel: Servo) -> None:
    line, dynamixel.bus.late_s = ServoLine(dynamixel.bus.name, servo_id=9, baud=BAUD), 0.016
    for _ in range(10):
        line.read(x.MODEL_NUMBER)
    assert dynamixel.bus.packets == 10
    line.close()


@pytest.mark.parametrize("pause_s", [0.06, 0.2])
def test_servo_line_uses_a_reply_that_arrived_while_the_process_did_not_run(
    dynamixel: Servo, pause_s: float
) -> None:
    line, dynamixel.bus.late_s = dynamixel.connect(reply_s=0.05), 0.02
    read, pauses = line._port.readPort, [pause_s]

    def read_slowly(size: int) -> bytes:
        data = bytes(read(size))
        if not data and pauses:
            time.sleep(pauses.pop())
        return data

    line._port.readPort = read_slowly
    assert line.read(x.MODEL_NUMBER) == 1020
    assert not pauses
    assert dynamixel.bus.packets == 1
    line.close()


def test_servo_line_on_the_port_of_a_device_that_never_pauses_times_out() -> None:
    """The SDK itself reads such a port for ever."""
    device, port = os.openpty()
    tty.setraw(port)
    os.set_blocking(device, False)
    is_open = threading.Event()
    is_open.set()

    def send() -> None:
        while is_open.is_set():
            with suppress(BlockingIOError):
                os.write(device, 64 * b"\x55")
            time.sleep(0.0005)

    sender = threading.Thread(target=send)
    sender.start()
    line = ServoLine(os.ttyname(port), servo_id=9, baud=BAUD, reply_s=0.02)
    begin_s = time.monotonic()
    with pytest.raises(DeviceError):
        line.read(x.MODEL_NUMBER)
    took_s = time.monotonic() - begin_s
    is_open.clear()
    sender.join()
    line.close()
    os.close(device)
    os.close(port)
    assert took_s < 1.0


def test_servo_line_claims_its_port_until_it_is_closed(dynamixel: Servo) -> None:
    os.chmod(dynamixel.bus.name, 0o666)
    line, status = dynamixel.connect(), []
    with pytest.raises(DeviceError, match=r"is in use by another program; `fuser -v"):
        dynamixel.connect()
    for _ in range(2):
        status.append(open_elsewhere(dynamixel.bus.name))
        line.close()
    assert status == [errno.EBUSY, 0]


def test_servo_line_works_after_another_was_refused(dynamixel: Servo) -> None:
    line = dynamixel.connect()
    with pytest.raises(DeviceError):
        dynamixel.connect()
    assert line.read(x.MODEL_NUMBER) == 1020
    line.close()
    dynamixel.connect().close()


@pytest.mark.slow
def test_servo_drivers_import_where_there_is_no_termios() -> None:
    program = (
        "import sys, types\n"
        "sys.modules.update(termios=None, fcntl=None, serial=types.ModuleType('serial'))\n"
        "import palpate.gripper.dynamixel, palpate.gripper.feetech\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
