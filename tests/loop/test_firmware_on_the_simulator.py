"""The image that goes on the board, run on the AVR simulator."""

from __future__ import annotations

import importlib.util
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from palpate.clock import ManualClock
from palpate.errors import DeviceNotFoundError
from palpate.sensor import wire_messages as wm
from palpate.sensor.wire import Decoder, encode_command
from palpate.twin import firmware
from palpate.twin.firmware import FirmwareBoard, open_firmware_array
from palpate.twin.world import World

ROOT = Path(__file__).resolve().parents[2]


pytestmark = pytest.mark.usefixtures("firmware_built")


class Desk:
    """A board and a decoder on one line."""

    def __init__(self) -> None:
        self.board = FirmwareBoard()
        self.decoder = Decoder()
        self.run(0.05)

    def run(self, duration_s: float) -> list[wm.BoardMessage]:
        self.board.run_until(self.board.now_s() + duration_s)
        return self.decoder.feed(self.board.read_bytes())

    def ask(self, *commands: wm.Command) -> list[wm.BoardMessage]:
        answers: list[wm.BoardMessage] = []
        for command in commands:
            self.board.write_bytes(encode_command(command, tag=1))
            answers += [m for m in self.run(0.005) if not isinstance(m, wm.FrameMessage)]
        return answers

    def frames(self, duration_s: float) -> list[wm.FrameMessage]:
        return [m for m in self.run(duration_s) if isinstance(m, wm.FrameMessage)]


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    yield desk
    desk.board.close()


@pytest.fixture(scope="module")
def run_link() -> Callable[..., dict[str, object]]:
    spec = importlib.util.spec_from_file_location("link", ROOT / "benchmarks/firmware_link.py")
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    function: Callable[..., dict[str, object]] = module.run_link
    return function


@pytest.mark.parametrize(
    ("rate_hz", "rows", "cols", "oversampling", "baud", "seconds"),
    [
        (500.0, 4, 2, 1, 1_000_000, 2.0),
        (300.0, 6, 2, 1, 1_000_000, 2.0),
        (250.0, 4, 2, 3, 1_000_000, 2.0),
        (400.0, 4, 2, 1, 250_000, 1.0),
        (250.0, 4, 2, 1, 115_200, 1.0),
        (15.0, 4, 2, 1, 9600, 2.0),
        (25.0, 16, 16, 1, 1_000_000, 1.0),
    ],
)
def test_no_frame_is_lost_and_every_count_is_right(
    run_link: Callable[..., dict[str, object]],
    rate_hz: float,
    rows: int,
    cols: int,
    oversampling: int,
    baud: int,
    seconds: float,
) -> None:
    result = run_link(
        seconds=seconds,
        rate_hz=rate_hz,
        rows=rows,
        cols=cols,
        oversampling=oversampling,
        baud=baud,
    )
    assert result["frames"] >= rate_hz * seconds  # type: ignore[operator]
    wrong = ("frames_lost", "corrupt", "frames_wrong", "conversions_misrouted")
    assert [result[name] for name in wrong] == [0, 0, 0, 0]
    period = result["period_us"]
    assert isinstance(period, dict)
    assert period["mean"] == pytest.approx(1e6 / rate_hz, abs=1.0)
    assert period["sd"] < 10


@pytest.mark.parametrize(("rows", "cols", "oversampling"), [(4, 2, 1), (4, 2, 16), (1, 1, 1)])
def test_the_highest_rate_it_names_is_kept(
    desk: Desk, rows: int, cols: int, oversampling: int
) -> None:
    *_, refusal = desk.ask(
        wm.SetLayout(rows=rows, cols=cols),
        wm.SetOversampling(conversions=oversampling),
        wm.SetRate(rate_hz=1e5),
    )
    assert isinstance(refusal, wm.Ack)
    assert refusal.result == wm.Result.TOO_FAST
    desk.ask(wm.SetRate(rate_hz=refusal.highest_rate_hz), wm.Start())
    frames = desk.frames(0.9)
    assert len(frames) >= 0.9 * refusal.highest_rate_hz - 2
    assert desk.decoder.counters.lost == 0


def test_it_says_who_it_is(desk: Desk) -> None:
    (identity,) = desk.ask(wm.Identify())
    assert isinstance(identity, wm.BoardIdentity)
    assert (identity.board, identity.baud) == ("Arduino Mega 2560", 1_000_000)
    assert (identity.max_rows, identity.max_cols, identity.max_oversampling) == (16, 16, 64)


def test_reset_begins_another_stream(desk: Desk) -> None:
    desk.ask(wm.SetRate(rate_hz=250.0), wm.Start())
    before = desk.frames(0.1)[-1]
    desk.board.reset()
    (identity,) = desk.run(0.05)
    assert isinstance(identity, wm.BoardIdentity)
    assert not identity.streaming
    desk.ask(wm.Start())
    after = desk.frames(0.1)
    assert after[-1].stream != before.stream
    assert desk.decoder.counters.restarts == 1
    assert desk.decoder.counters.lost == 0


def test_the_watchdog_ends_a_hang_and_vents(desk: Desk) -> None:
    desk.ask(wm.SetPressure(target_kpa=30.0, slew_kpa_per_s=500.0), wm.Start())
    desk.run(0.1)
    assert desk.board.output_kpa == pytest.approx(30.0, abs=0.1)
    desk.board.hang()
    messages = desk.run(0.4)
    identity = next(m for m in messages if isinstance(m, wm.BoardIdentity))
    assert identity.reset_cause & wm.ResetCause.WATCHDOG
    assert desk.board.output_kpa == 0
    desk.ask(wm.Start())
    assert desk.frames(0.1)[-1].status & wm.BoardStatus.WATCHDOG_RESET


def test_pressure_follows_slew_and_heartbeat(desk: Desk) -> None:
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


def test_load_cells_are_read_beside_the_pixels(desk: Desk) -> None:
    desk.board.set_load(0, -8_388_608)
    desk.board.set_load(1, 1_234_567)
    desk.ask(wm.SetRate(rate_hz=250.0), wm.Start(contents=wm.Contents.LOAD_CELLS))
    frames = desk.frames(0.5)
    assert [cell.raw for cell in frames[-1].load_cells] == [-8_388_608, 1_234_567]
    readings = (frames[-1].load_cells[0].sample - frames[10].load_cells[0].sample) % 256
    assert readings == pytest.approx(80 * 0.46, abs=3)
    assert desk.decoder.counters.lost == 0


def test_an_absent_load_cell_is_said_to_be_silent(desk: Desk) -> None:
    desk.board.set_load(0, 5)
    desk.ask(wm.Start(contents=wm.Contents.LOAD_CELLS))
    last = desk.frames(0.7)[-1]
    assert last.status & wm.BoardStatus.LOAD_CELL_SILENT
    assert last.load_cells[1].raw == wm.NO_READING


def test_an_absent_load_cell_stays_silent_when_the_clock_wraps(desk: Desk) -> None:
    elf = ROOT / "firmware/build/palpate-mega2560.elf"
    symbols = subprocess.run(["avr-nm", elf], check=True, capture_output=True, text=True).stdout
    (found,) = re.findall(r"(\w+) b \S*overflows", symbols)
    desk.board.set_load(0, 5)
    desk.ask(wm.Start(contents=wm.Contents.LOAD_CELLS))
    desk.frames(0.7)
    # 71 minutes less 33 ms, in overflows of 32.768 ms.
    desk.board.set_memory(int(found, 16) & 0xFFFF, 0x1FFFF)
    frames = desk.frames(0.3)
    assert frames[-1].time_us % 2**32 < 300_000
    assert all(frame.status & wm.BoardStatus.LOAD_CELL_SILENT for frame in frames)


def test_the_ceiling_acts_without_the_host(desk: Desk) -> None:
    desk.ask(wm.SetCeiling(counts=900), wm.SetPressure(target_kpa=30.0, slew_kpa_per_s=500.0))
    desk.ask(wm.SetRate(rate_hz=250.0), wm.Start())
    desk.run(0.1)
    assert desk.board.safe_line
    voltages = np.full((4, 2), 1000.0)
    voltages[3, 1] = 4500.0
    desk.board.set_pixels_mv(voltages)
    desk.run(0.010)
    assert (desk.board.safe_line, desk.board.output_kpa) == (False, 0.0)


def test_the_serial_array_reads_the_twin_through_it() -> None:
    world = World(None, seed=2, clock=ManualClock(5.0), frame_rate_hz=100.0)
    array = open_firmware_array(world, noise_mv=0.0, rate_hz=100.0)
    frames = [array.read(timeout_s=1.0) for _ in range(40)]
    array.close()
    direct = np.mean([world.scan(world.clock.now_s()) for _ in range(40)], axis=0)
    through = np.mean([frame.counts for frame in frames], axis=0)
    assert np.allclose(through, direct, atol=1.0 + 0.01 * direct)
    periods = np.diff([frame.time_s for frame in frames])
    assert np.allclose(periods, 0.01, atol=0.002)
    assert array.counters.lost == 0


def test_without_the_simulator_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(firmware, "BUILD", tmp_path)
    with pytest.raises(DeviceNotFoundError, match="libsimavr-dev") as raised:
        FirmwareBoard()
    assert raised.value.exit_status == 3
    assert "\n" not in str(raised.value)
