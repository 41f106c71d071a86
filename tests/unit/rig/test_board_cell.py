"""Load cells on a board as reference force, over a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.sensor.test_serial_array import Bench, PtyBoard

from palpate.errors import DeviceError, InputError
from palpate.gripper.interface import GripperCommand
from palpate.rig.bench import open_bench
from palpate.rig.board_cell import BoardLoadCell, measure_mean_counts
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import NO_READING, CellSample, Contents, FrameMessage
from palpate.twin.devices import TwinGripper
from palpate.twin.world import World


class WeighingBoard(PtyBoard):
    """A board with two amplifiers whose cells are read at `reading_hz`."""

    def __init__(self) -> None:
        super().__init__()
        self.raw = [0, 0]
        self.weighed: Callable[[], list[int]] = lambda: self.raw
        self.reading_hz = [80.0, 80.0]
        self.read_until_us: int | None = None
        self.sends_load_cells = True

    def frame(self) -> FrameMessage:
        message = super().frame()
        if not self.sends_load_cells:
            return message
        now_us = message.time_us if self.read_until_us is None else self.read_until_us
        return replace(
            message,
            load_cells=tuple(
                CellSample(raw=raw, sample=int(now_us * 1e-6 * hz) % 256)
                for raw, hz in zip(self.weighed(), self.reading_hz, strict=True)
            ),
        )


class Desk:
    """A board, its array, and the clock of both."""

    def __init__(self) -> None:
        self.clock, self.board = Bench(), WeighingBoard()
        self.board.booted_s = self.clock.now_s()
        self.clock.boards.append(self.board)
        self.array = self.open_array()

    def open_array(self) -> SerialArray:
        return SerialArray(
            self.clock.open(self.board.port),
            clock=self.clock,
            layout=RIGID_LAYOUT,
            contents=Contents.LOAD_CELLS,
        )

    def cell(self, *newtons_per_count: float) -> BoardLoadCell:
        return BoardLoadCell(self.array, clock=self.clock, newtons_per_count=newtons_per_count)


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    yield desk
    desk.array.close()
    for stream in desk.clock.streams:
        stream.close()
    desk.board.unplug()


def test_board_cell_force_is_mean_of_two_tared_cells_and_current_after_a_pause(desk: Desk) -> None:
    cell = desk.cell(1e-5, -2e-5)
    desk.board.raw = [40_000, -9_000]
    cell.tare()
    assert cell.read_n() == 0
    # Meanwhile the buffer of the port fills with unloaded frames; later frames are lost.
    desk.clock.sleep_s(30.0)
    desk.board.raw = [40_000 + 600_000, -9_000 - 200_000]
    desk.clock.sleep_s(0.02)
    assert cell.read_n() == pytest.approx((6.0 + 4.0) / 2)


def test_board_cell_works_with_one_cell_connected(desk: Desk) -> None:
    cell = desk.cell(1e-5)
    desk.board.raw = [500, NO_READING]
    cell.tare()
    desk.board.raw = [200_500, NO_READING]
    desk.clock.sleep_s(0.02)
    assert cell.read_n() == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("is_tared", "name", "value", "message"),
    [
        (False, "raw", [0, NO_READING], "load cell 1 sends no reading"),
        (False, "reading_hz", [80.0, 0.0], "load cell 1 is stuck"),
        (False, "reading_hz", [10.0, 80.0], "load cell 0 sends (9|10) readings per second.*RATE"),
        (True, "raw", [0, 2**23 - 1], "load cell 1 is at the end of its range"),
        (True, "silent", True, "no frame with load cells"),
    ],
)
def test_board_cell_that_fails_at_its_tare_or_reading_is_refused(
    desk: Desk, is_tared: bool, name: str, value: object, message: str
) -> None:
    cell = desk.cell(1e-5, 1e-5)
    if is_tared:
        cell.tare()
    setattr(desk.board, name, value)
    desk.clock.sleep_s(1.0 if is_tared else 0.0)
    with pytest.raises(DeviceError, match=message):
        (cell.read_n if is_tared else cell.tare)()


def read_repeatedly(cell: BoardLoadCell, desk: Desk, *, pause_s: float) -> None:
    for _ in range(60):
        desk.clock.sleep_s(pause_s)
        cell.read_n()


@pytest.mark.parametrize("pause_s", [0.02, 20.0])
def test_board_cell_stuck_during_reading_is_refused(desk: Desk, pause_s: float) -> None:
    cell = desk.cell(1e-5, 1e-5)
    cell.tare()
    desk.board.read_until_us = desk.board.device_us(desk.clock.now_s())
    with pytest.raises(DeviceError, match=r"load cell \d is stuck"):
        read_repeatedly(cell, desk, pause_s=pause_s)


def test_frames_without_load_cells_error_names_rig_file_setting(desk: Desk) -> None:
    desk.board.sends_load_cells = False
    with pytest.raises(InputError, match="load_cells = true"):
        measure_mean_counts(desk.array, cells=(0,), clock=desk.clock)


def test_open_bench_opens_gripper_before_and_after_error(desk: Desk) -> None:
    world = World(None, seed=1, clock=desk.clock)
    gripper = TwinGripper(world)
    gripper.command(GripperCommand(target=30.0, rate=60.0))
    desk.clock.sleep_s(2.0)
    desk.board.raw = [40_000, -9_000]
    closed_mm = gripper.state().width_mm

    def close_and_fail() -> None:
        with open_bench(
            desk.array, gripper=gripper, clock=desk.clock, newtons_per_count=(1e-5, 1e-5)
        ) as (bench, _):
            widths.append(gripper.state().width_mm)
            assert bench.start == gripper.limits.highest
            assert bench.cell.read_n() == 0
            gripper.command(GripperCommand(target=30.0, rate=60.0))
            desk.clock.sleep_s(0.5)
            raise DeviceError("load cell 0 is stuck")

    widths = list[float]()
    with pytest.raises(DeviceError, match="stuck"):
        close_and_fail()
    widths.append(gripper.state().width_mm)
    assert closed_mm < 35
    assert np.array(widths) == pytest.approx(gripper.limits.highest, abs=1.0)
