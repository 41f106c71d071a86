"""Load cells as reference forces, through the real firmware on simulated HX711 amplifiers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from palpate.clock import ManualClock
from palpate.errors import DeviceError
from palpate.rig.board_cell import BoardLoadCell
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")


class Rig:
    """The simulated board, its array and a clock."""

    def __init__(self) -> None:
        self.clock = ManualClock(50.0)
        world = World(None, seed=3, clock=self.clock, layout=RIGID_LAYOUT)
        self.board = FirmwareBoard(seed=1)
        self.array = SerialArray(
            FirmwareStream(world, board=self.board),
            clock=self.clock,
            layout=RIGID_LAYOUT,
            contents=Contents.LOAD_CELLS,
        )


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig()
    yield rig
    rig.array.close()


def test_two_load_cells_measure_forces_above_their_zeros(rig: Rig) -> None:
    cell = BoardLoadCell(rig.array, clock=rig.clock, newtons_per_count=(1e-5, -2e-5))
    rig.board.set_load(0, 40_000)
    rig.board.set_load(1, -9_000)
    rig.clock.sleep_s(0.1)
    cell.tare()
    assert cell.read_n() == pytest.approx(0.0)
    rig.board.set_load(0, 640_000)
    rig.board.set_load(1, -209_000)
    rig.clock.sleep_s(0.05)
    assert cell.read_n() == pytest.approx(5.0)


def test_absent_load_cell_amplifier_is_named_and_can_be_omitted(rig: Rig) -> None:
    rig.board.set_load(0, 40_000)
    rig.clock.sleep_s(0.1)
    both = BoardLoadCell(rig.array, clock=rig.clock, newtons_per_count=(1e-5, 1e-5))
    with pytest.raises(DeviceError, match="load cell 1 sends no reading"):
        both.tare()
    BoardLoadCell(rig.array, clock=rig.clock, newtons_per_count=(1e-5,)).tare()
