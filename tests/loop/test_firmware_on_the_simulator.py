"""The firmware image of the boards, run on the AVR simulator."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.firmware_link import run_link

from palpate.errors import DeviceNotFoundError
from palpate.sensor import wire_messages as wm
from palpate.sensor.wire import Decoder, encode_command
from palpate.twin import firmware
from palpate.twin.firmware import FirmwareBoard

ROOT = Path(__file__).resolve().parents[2]


pytestmark = pytest.mark.usefixtures("firmware_built")


class Desk:
    """A board and a decoder on a serial line."""

    def __init__(self, kind: str = "mega2560") -> None:
        self.board = FirmwareBoard(kind)
        self.decoder = Decoder()
        self.run(0.05)

    def run(self, duration_s: float) -> list[wm.BoardMessage]:
        self.board.run_until(self.board.now_s() + duration_s)
        return self.decoder.feed(self.board.read_bytes())

    def ask(self, *commands: wm.Command) -> list[Any]:
        answers: list[Any] = []
        for command in commands:
            self.board.write_bytes(encode_command(command, tag=1))
            answers += [m for m in self.run(0.005) if not isinstance(m, wm.FrameMessage)]
        return answers

    def result(self, *commands: wm.Command) -> wm.Result:
        """Return the board's result of the last of some commands."""
        return [m for m in self.ask(*commands) if isinstance(m, wm.Ack)][-1].result

    def frames(self, duration_s: float) -> list[wm.FrameMessage]:
        return [m for m in self.run(duration_s) if isinstance(m, wm.FrameMessage)]


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    yield desk
    desk.board.close()


#: A Nano has the same controller as an Uno.
@pytest.fixture(params=["mega2560", "uno"])
def any_desk(request: pytest.FixtureRequest) -> Iterator[Desk]:
    desk = Desk(request.param)
    yield desk
    desk.board.close()


LINK = ("board", "rate_hz", "rows", "cols", "oversampling", "baud", "seconds")


@pytest.mark.parametrize(
    "link",
    [
        ("mega2560", 500.0, 4, 2, 1, 1_000_000, 2.0),
        ("mega2560", 250.0, 4, 2, 3, 115_200, 1.0),
        ("mega2560", 15.0, 4, 2, 1, 9600, 2.0),
        ("mega2560", 25.0, 16, 16, 1, 1_000_000, 1.0),
        ("uno", 300.0, 4, 4, 1, 250_000, 1.0),
        ("nano", 15.0, 1, 4, 64, 1_000_000, 1.0),
    ],
)
def test_firmware_sends_every_frame_with_correct_counts(link: tuple[Any, ...]) -> None:
    options = dict(zip(LINK, link, strict=True))
    result, rate_hz = run_link(**options), options["rate_hz"]
    assert result["frames"] >= rate_hz * options["seconds"]
    wrong = ("frames_lost", "corrupt", "frames_wrong", "conversions_misrouted")
    assert [result[name] for name in wrong] == [0, 0, 0, 0]
    assert result["period_us"]["mean"] == pytest.approx(1e6 / rate_hz, abs=1.0)
    assert result["period_us"]["sd"] < 10


@pytest.mark.parametrize(("rows", "cols", "oversampling"), [(4, 2, 16), (1, 1, 1)])
def test_firmware_sustains_the_highest_rate_that_it_reports(
    any_desk: Desk, rows: int, cols: int, oversampling: int
) -> None:
    *_, refusal = any_desk.ask(
        wm.SetLayout(rows=rows, cols=cols),
        wm.SetOversampling(conversions=oversampling),
        wm.SetRate(rate_hz=1e5),
    )
    assert refusal.result == wm.Result.TOO_FAST
    any_desk.ask(wm.SetRate(rate_hz=refusal.highest_rate_hz), wm.Start())
    frames = any_desk.frames(0.9)
    assert len(frames) >= 0.9 * refusal.highest_rate_hz - 2
    assert any_desk.decoder.counters.lost == 0


@pytest.mark.parametrize(
    ("kind", "name", "features", "side"),
    [
        ("mega2560", "Arduino Mega 2560", 7, 16),
        ("uno", "Arduino Uno", 5, 4),
        ("nano", "Arduino Nano", 5, 4),
    ],
)
def test_firmware_identity_contains_name_size_and_features_of_the_board(
    kind: str, name: str, features: int, side: int
) -> None:
    desk = Desk(kind)
    (identity,) = desk.ask(wm.Identify())
    assert (identity.board, identity.baud, identity.full_scale) == (name, 1_000_000, 1024)
    assert (identity.max_rows, identity.max_cols, identity.features) == (side, side, features)
    for contents in wm.Contents:
        started = desk.result(wm.Start(contents=contents)) == wm.Result.OK
        assert started == bool(features & contents)
        desk.ask(wm.Stop())
    assert desk.result(wm.SetLayout(rows=side + 1, cols=1)) == wm.Result.BAD_ARGUMENT
    desk.board.close()


def test_firmware_reset_starts_a_new_stream(any_desk: Desk) -> None:
    any_desk.ask(wm.SetRate(rate_hz=250.0), wm.Start())
    before = any_desk.frames(0.1)[-1]
    any_desk.board.reset()
    (identity,) = any_desk.run(0.05)
    assert not identity.streaming
    any_desk.ask(wm.Start())
    after = any_desk.frames(0.1)
    assert after[-1].stream != before.stream
    assert any_desk.decoder.counters.restarts == 1
    assert any_desk.decoder.counters.lost == 0


def test_firmware_pressure_follows_the_slew_rate_and_vents_without_a_heartbeat(desk: Desk) -> None:
    desk.ask(
        wm.SetPressure(target_kpa=40.0, slew_kpa_per_s=200.0),
        wm.Start(contents=wm.Contents.PRESSURE),
    )
    desk.run(0.09)
    assert desk.board.output_kpa == pytest.approx(20.0, abs=1.0)
    last = desk.frames(0.38)[-1]
    assert last.pressure_set_kpa == 40.0
    assert last.pressure_kpa == pytest.approx(40.0, abs=0.3)
    vented = desk.frames(0.1)[-1]
    assert vented.status & wm.BoardStatus.HEARTBEAT_LOST
    assert desk.board.output_kpa == 0


def test_firmware_reads_load_cells_together_with_the_pixels(any_desk: Desk) -> None:
    any_desk.board.set_load(0, -8_388_608)
    any_desk.board.set_load(1, 1_234_567)
    any_desk.ask(wm.SetRate(rate_hz=250.0), wm.Start(contents=wm.Contents.LOAD_CELLS))
    frames = any_desk.frames(0.5)
    assert [cell.raw for cell in frames[-1].load_cells] == [-8_388_608, 1_234_567]
    readings = (frames[-1].load_cells[0].sample - frames[10].load_cells[0].sample) % 256
    assert readings == pytest.approx(80 * 0.46, abs=3)
    assert any_desk.decoder.counters.lost == 0


def test_firmware_reports_an_absent_load_cell_as_silent_even_after_a_clock_overflow(
    any_desk: Desk, request: pytest.FixtureRequest
) -> None:
    elf = ROOT / f"firmware/build/palpate-{request.node.callspec.params['any_desk']}.elf"
    symbols = subprocess.run(["avr-nm", elf], check=True, capture_output=True, text=True).stdout
    (found,) = re.findall(r"(\w+) [bB] \S*overflows", symbols)
    any_desk.board.set_load(0, 5)
    any_desk.ask(wm.Start(contents=wm.Contents.LOAD_CELLS))
    before = any_desk.frames(0.7)[-1]
    assert before.status & wm.BoardStatus.LOAD_CELL_SILENT
    assert before.load_cells[1].raw == wm.NO_READING
    # 71 minutes less some 50 ms, in overflows of 32.768 ms (Mega) or 512 us.
    last = 2**32 // (512 if "uno" in elf.name else 32_768) - 1
    any_desk.board.set_memory(int(found, 16) & 0xFFFF, last - (100 if "uno" in elf.name else 0))
    frames = any_desk.frames(0.3)
    assert frames[-1].time_us % 2**32 < 300_000
    assert all(frame.status & wm.BoardStatus.LOAD_CELL_SILENT for frame in frames)


def press(desk: Desk) -> None:
    """Press a pixel beyond the ceiling."""
    voltages = np.full((4, 2), 1000.0)
    voltages[3, 1] = 4500.0
    desk.board.set_pixels_mv(voltages)


def move_servo(desk: Desk, *, target_us: int, rate: int = 2000) -> list[wm.BoardMessage]:
    """Arm the board, stream, set a travel of 2300 (open) to 700 microseconds, and move."""
    return desk.ask(
        wm.SetCeiling(counts=900),
        wm.SetRate(rate_hz=250.0),
        wm.Start(contents=wm.Contents.SERVO),
        wm.SetServoTravel(open_us=2300, closed_us=700),
        wm.SetServo(target_us=target_us, rate_us_per_s=rate),
    )


def test_firmware_servo_pulses_have_a_period_of_20_ms_and_follow_the_ramp(any_desk: Desk) -> None:
    move_servo(any_desk, target_us=1500)
    frames = any_desk.frames(0.3)
    begin_s, width_us = any_desk.board.read_pulses()
    assert np.diff(begin_s) == pytest.approx(0.020, abs=1e-6)
    assert width_us[0] == pytest.approx(2300, abs=45), "the first pulses hold the fingers open"
    # 2000 us/s over 20 ms; the ramp has steps of 2 us, at the main loop's 1.024 ms.
    assert np.diff(width_us) == pytest.approx(-40.0, abs=4.2)
    assert np.diff(width_us).mean() == pytest.approx(-40.0, abs=0.3)
    assert frames[-1].servo_us == pytest.approx(width_us[-1] - 40, abs=45)
    any_desk.ask(wm.Ping())
    any_desk.run(0.3)
    assert any_desk.board.read_pulses()[1][-1] == pytest.approx(1500, abs=0.5)
    assert any_desk.decoder.counters.lost == 0


def test_firmware_servo_pulses_keep_their_width_under_full_load(any_desk: Desk) -> None:
    """The load consists of frames at the highest rate, load cells and commands."""
    any_desk.board.set_load(0, 5)
    any_desk.board.set_load(1, 7)
    any_desk.ask(wm.SetRate(rate_hz=700.0), wm.SetCeiling(counts=0))
    any_desk.ask(wm.Start(contents=wm.Contents.LOAD_CELLS | wm.Contents.SERVO))
    any_desk.ask(wm.SetServoTravel(open_us=1500, closed_us=700))
    for _ in range(20):
        any_desk.ask(wm.SetServo(target_us=1500, rate_us_per_s=1), wm.Ping())
        any_desk.run(0.05)
    begin_s, width_us = any_desk.board.read_pulses()
    assert len(width_us) > 50
    # simavr simulates a compare match with an error of a few cycles of 62.5 ns.
    assert width_us == pytest.approx(1500, abs=0.5)
    assert np.diff(begin_s) == pytest.approx(0.020, abs=1e-6)


def test_firmware_servo_backs_off_at_the_ceiling_and_is_then_switched_off(any_desk: Desk) -> None:
    desk = any_desk
    move_servo(desk, target_us=1900)
    desk.run(0.4)
    desk.board.read_pulses()
    press(desk)
    pressed_s = desk.board.now_s()
    desk.run(0.3)
    begin_s, width_us = desk.board.read_pulses()
    assert ((width_us > 1899) & (width_us < 2301)).all(), "a started pulse is completed"
    opened = width_us[begin_s > pressed_s + 0.025]
    assert opened == pytest.approx(2300, abs=0.5)
    assert desk.board.safe_line, "the supply must stay on while the hand opens"
    desk.run(0.12)
    assert not desk.board.safe_line
    desk.board.read_pulses()
    desk.run(0.3)
    assert len(desk.board.read_pulses()[0]) == 0
    assert desk.result(wm.SetServo(target_us=1900, rate_us_per_s=1)) == wm.Result.TRIPPED


@pytest.mark.parametrize("how", ["reset", "hang"])
def test_firmware_servo_has_no_supply_and_no_pulses_after_a_reset(any_desk: Desk, how: str) -> None:
    move_servo(any_desk, target_us=1500)
    any_desk.run(0.3)
    getattr(any_desk.board, how)()
    any_desk.run(0.4)
    any_desk.board.read_pulses()
    any_desk.run(0.2)
    assert not any_desk.board.safe_line
    assert len(any_desk.board.read_pulses()[0]) == 0
    assert any_desk.result(wm.SetServo(target_us=1500, rate_us_per_s=1)) == wm.Result.TRIPPED


def test_firmware_board_without_the_simulator_raises_an_error_with_the_package_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(firmware, "BUILD", tmp_path)
    with pytest.raises(DeviceNotFoundError, match="libsimavr-dev") as raised:
        FirmwareBoard()
    assert raised.value.exit_status == 3
    assert "\n" not in str(raised.value)
