"""The Python and C++ codecs on the same bytes, the latter through the host build."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.fixtures import skip

from palpate.sensor import wire_messages as wm
from palpate.sensor.wire import Decoder, encode_command
from palpate_studies.board_bytes import encode_message

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
VECTORS = json.loads((Path(__file__).parent / "wire" / "vectors.json").read_text())


class Core:
    """The firmware's portable core on a board without hardware."""

    def __init__(self, library: ctypes.CDLL, *, baud: int = 1_000_000, seed: int = 0) -> None:
        self._library = library
        library.host_new.restype = ctypes.c_void_p
        library.host_take.restype = ctypes.c_size_t
        self._host = ctypes.c_void_p(library.host_new(baud))
        library.host_begin(self._host, 1, seed)
        self.decoder = Decoder()
        self.take()

    def take(self) -> bytes:
        buffer = ctypes.create_string_buffer(8192)
        size = self._library.host_take(self._host, buffer)
        return buffer.raw[:size]

    def give(self, data: bytes) -> bytes:
        self._library.host_bytes(self._host, data, ctypes.c_size_t(len(data)))
        return self.take()

    def ask(self, command: wm.Command, *, tag: int = 1) -> wm.BoardMessage:
        (answer,) = self.decoder.feed(self.give(encode_command(command, tag=tag)))
        return answer

    def result(self, command: wm.Command) -> wm.Result:
        answer = self.ask(command)
        assert isinstance(answer, wm.Ack)
        return answer.result

    def scan(self, counts: Any, *, sequence: int, time_us: int = 0, pressure: int = 0) -> bytes:
        pixels = np.ascontiguousarray(counts, dtype=np.uint16)
        pointer = pixels.ctypes.data_as(ctypes.POINTER(ctypes.c_uint16))
        self._library.host_scan(self._host, sequence, ctypes.c_uint32(time_us), pointer, pressure)
        return self.take()

    def move_servo(self, target_us: int, *, open_us: int = 2000, rate: int = 1000) -> wm.Result:
        """Arm the board, set a travel and move the servo."""
        self.result(wm.SetCeiling(counts=900))
        self.result(wm.SetServoTravel(open_us=open_us, closed_us=1000))
        return self.result(wm.SetServo(target_us=target_us, rate_us_per_s=rate))

    def load(self, index: int, *, raw: int, sample: int) -> None:
        self._library.host_set_load(self._host, index, raw, sample, 0)

    def at_ms(self, time_ms: int) -> None:
        self._library.host_set_time(self._host, ctypes.c_uint32(time_ms * 1000))

    @property
    def pressure_pa(self) -> int:
        return int(self._library.host_pressure_pa(self._host))

    @property
    def servo_us(self) -> int:
        return int(self._library.host_servo_us(self._host))

    @property
    def safe(self) -> bool:
        return bool(self._library.host_safe(self._host) & 1)

    def close(self) -> None:
        self._library.host_free(self._host)


@pytest.fixture(scope="module")
def built_library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    if shutil.which("g++") is None or shutil.which("make") is None:
        skip("g++ and make are needed to build the firmware's core for this host")
    build = tmp_path_factory.mktemp("core")
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), "host", f"BUILD={build}"], check=True)
    return ctypes.CDLL(str(build / "libpalpate_core.so"))


@pytest.fixture
def core(built_library: ctypes.CDLL) -> Iterator[Core]:
    core = Core(built_library)
    yield core
    core.close()


def _frame(fields: dict[str, Any]) -> wm.FrameMessage:
    given = dict(fields)
    given["counts"] = np.array(fields["counts"], dtype=np.uint16)
    given["load_cells"] = tuple(wm.CellSample(raw=r, sample=s) for r, s in fields["load_cells"])
    return wm.FrameMessage(**given)


@pytest.mark.parametrize("vector", VECTORS["commands"], ids=lambda v: v["name"])
def test_python_encodes_command_vectors(vector: dict[str, Any]) -> None:
    command = getattr(wm, vector["name"])(**vector["fields"])
    assert encode_command(command, tag=vector["tag"]).hex() == vector["bytes"]


@pytest.mark.parametrize("vector", VECTORS["commands"], ids=lambda v: v["name"])
def test_firmware_acknowledges_command_vectors(vector: dict[str, Any], core: Core) -> None:
    (answer,) = core.decoder.feed(core.give(bytes.fromhex(vector["bytes"])))
    assert answer.tag == vector["tag"]
    if isinstance(answer, wm.Ack):
        # Nothing has armed the board, as a servo needs.
        refused = vector["name"] == "SetServo"
        assert answer.result == (wm.Result.TRIPPED if refused else wm.Result.OK)


@pytest.mark.parametrize("vector", VECTORS["identities"])
def test_python_identity_vectors_roundtrip(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["bytes"])
    given = vector["fields"] | {"version": tuple(vector["fields"]["version"])}
    identity = wm.BoardIdentity(**given)
    assert encode_message(identity) == data
    assert Decoder().feed(data) == [identity]


@pytest.mark.parametrize("vector", VECTORS["frames"])
def test_python_frame_vectors_roundtrip(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["bytes"])
    assert encode_message(_frame(vector["fields"])) == data
    (frame,) = Decoder().feed(data)
    assert isinstance(frame, wm.FrameMessage)
    assert frame.counts.tolist() == vector["fields"]["counts"]
    assert [[c.raw, c.sample] for c in frame.load_cells] == vector["fields"]["load_cells"]
    assert (frame.sequence, frame.time_us) == (
        vector["fields"]["sequence"],
        vector["fields"]["time_us"],
    )


@pytest.mark.parametrize("vector", [v for v in VECTORS["frames"] if not v["fields"]["status"]])
def test_firmware_encodes_frame_vectors(vector: dict[str, Any], built_library: ctypes.CDLL) -> None:
    wanted = _frame(vector["fields"])
    core = Core(built_library, seed=(wanted.stream - 1) % 256)
    rows, cols = wanted.counts.shape
    contents = wm.Contents.PIXELS
    if wanted.load_cells:
        contents |= wm.Contents.LOAD_CELLS
        for index, cell in enumerate(wanted.load_cells):
            core.load(index, raw=cell.raw, sample=cell.sample)
    pressure = 0
    if wanted.pressure_kpa is not None:
        contents |= wm.Contents.PRESSURE
        core.result(wm.SetPressure(target_kpa=wanted.pressure_set_kpa or 0.0, slew_kpa_per_s=500.0))
        core.at_ms(100)
        pressure = round(wanted.pressure_kpa / 50 * 1023)
    if wanted.servo_us is not None:
        contents |= wm.Contents.SERVO
        core.move_servo(wanted.servo_us, open_us=wanted.servo_us)
    core.result(wm.SetRate(rate_hz=0.2))
    core.result(wm.SetLayout(rows=rows, cols=cols))
    core.result(wm.SetOversampling(conversions=wanted.oversampling))
    assert core.result(wm.Start(contents=contents)) == wm.Result.OK
    if wanted.sequence:
        # The core reports the gap before the frame; the one after the next is free of it.
        core.scan(wanted.counts, sequence=wanted.sequence - 1)
    sent = core.scan(
        wanted.counts, sequence=wanted.sequence, time_us=wanted.time_us, pressure=pressure
    )
    core.close()
    if wanted.pressure_kpa:
        # A 10-bit read-back can't give every pascal.
        (frame,) = Decoder().feed(sent)
        assert isinstance(frame, wm.FrameMessage)
        assert frame.pressure_kpa == pytest.approx(wanted.pressure_kpa, abs=0.05)
        assert frame.pressure_set_kpa == wanted.pressure_set_kpa
        assert frame.counts.tolist() == wanted.counts.tolist()
    else:
        assert sent.hex() == vector["bytes"]


@pytest.mark.parametrize(
    "command",
    [
        wm.SetLayout(rows=17, cols=1),
        wm.SetLayout(rows=1, cols=0),
        wm.SetLayout(rows=1, cols=1, settle_us=4),
        wm.SetRate(rate_hz=0.0),
        wm.SetOversampling(conversions=65),
        wm.SetPressure(target_kpa=50.001, slew_kpa_per_s=1.0),
        wm.SetPressure(target_kpa=5.0, slew_kpa_per_s=0.0),
        wm.SetCeiling(counts=1024),
        wm.SetServoTravel(open_us=499, closed_us=1000),
        wm.SetServoTravel(open_us=1000, closed_us=2501),
        wm.SetServoTravel(open_us=1000, closed_us=1000),
    ],
)
def test_firmware_refuses_arguments_out_of_range(core: Core, command: wm.Command) -> None:
    assert core.result(command) == wm.Result.BAD_ARGUMENT


def test_firmware_refuses_a_servo_that_is_not_armed_and_settings_while_streaming(
    core: Core,
) -> None:
    assert core.result(wm.SetServo(target_us=1000, rate_us_per_s=1)) == wm.Result.TRIPPED
    core.result(wm.Start())
    assert core.result(wm.SetRate(rate_hz=10.0)) == wm.Result.STREAMING
    core.result(wm.Stop())
    assert core.result(wm.SetRate(rate_hz=10.0)) == wm.Result.OK


def test_firmware_pressure_ramps_and_vents_without_heartbeat(core: Core) -> None:
    core.at_ms(1000)
    core.result(wm.SetPressure(target_kpa=20.0, slew_kpa_per_s=100.0))
    core.at_ms(1100)
    assert core.pressure_pa == pytest.approx(10_000, abs=200)
    core.at_ms(1300)
    assert core.pressure_pa == 20_000
    core.at_ms(1400)
    core.result(wm.Ping())
    core.at_ms(1850)
    assert core.pressure_pa == 20_000
    core.at_ms(1950)
    assert core.pressure_pa == 0
    core.result(wm.Ping())
    core.at_ms(2000)
    assert core.pressure_pa == 0, "stays vented until the next pressure command"


def test_firmware_pixel_ceiling_vents_until_rearmed(core: Core) -> None:
    assert not core.safe, "nobody has armed it"
    core.result(wm.SetCeiling(counts=900))
    core.result(wm.SetPressure(target_kpa=20.0, slew_kpa_per_s=500.0))
    core.at_ms(100)
    core.result(wm.Start())
    quiet = np.full((4, 2), 899)
    core.scan(quiet, sequence=0)
    assert core.safe
    assert core.pressure_pa == 20_000
    pressed = quiet.copy()
    pressed[2, 1] = 900
    (frame,) = core.decoder.feed(core.scan(pressed, sequence=1))
    assert isinstance(frame, wm.FrameMessage)
    assert frame.status & wm.BoardStatus.CEILING_TRIPPED
    assert (core.safe, core.pressure_pa) == (False, 0)
    again = wm.SetPressure(target_kpa=1.0, slew_kpa_per_s=1.0)
    assert core.result(again) == wm.Result.TRIPPED
    core.result(wm.SetCeiling(counts=900))
    assert core.safe
    assert core.result(again) == wm.Result.OK


def test_firmware_refuses_servo_moves_beyond_or_without_travel_and_a_change_of_it(
    core: Core,
) -> None:
    core.result(wm.SetCeiling(counts=900))
    assert core.result(wm.SetServo(target_us=1500, rate_us_per_s=1000)) == wm.Result.BAD_ARGUMENT
    core.at_ms(1)
    assert core.servo_us == 0
    assert core.move_servo(1500) == wm.Result.OK
    for pulse_us in (999, 2001, 500, 2500):
        again = wm.SetServo(target_us=pulse_us, rate_us_per_s=1000)
        assert core.result(again) == wm.Result.BAD_ARGUMENT
    changed = wm.SetServoTravel(open_us=2000, closed_us=900)
    assert core.result(changed) == wm.Result.BAD_ARGUMENT
    assert core.result(wm.SetServoTravel(open_us=2000, closed_us=1000)) == wm.Result.OK
    core.at_ms(2)
    assert core.servo_us == 1999, "still on its way to the first target"


def test_firmware_ignores_and_counts_damaged_commands(core: Core) -> None:
    core.result(wm.Start())
    good = encode_command(wm.Stop(), tag=3)
    for at in range(len(good) - 1):
        damaged = bytearray(good)
        damaged[at] ^= 0x40
        assert core.give(bytes(damaged)) == b""
        core.give(b"\0")
    (frame,) = core.decoder.feed(core.scan(np.zeros((4, 2)), sequence=0))
    assert isinstance(frame, wm.FrameMessage)
    assert frame.status & wm.BoardStatus.COMMAND_DAMAGED
