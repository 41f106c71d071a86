"""Dead weights: invalid loads and unsettled readings are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.calibrate.dead_weights import check_loads, has_unloading, measure_loads, read_loads
from palpate.clock import ManualClock
from palpate.errors import CalibrationError, InputError
from palpate.gripper.interface import GripperCommand
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World


def write_file(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load_n\n1\n5\n", "2 loads, 2 of them different"),
        ("load_n\n2\n2\n2\n2\n2\n", "1 of them different"),
        ("load_n\n4\n5\n6\n", "2 times the smallest"),
        ("load_g\n100\n200\n", "no column load_n"),
        ("load_n\n100\n200\n500\n1000\n", "in grams"),
        ("load_n\n1\n2\nheavy\n4\n", "line 4: load_n is 'heavy'"),
        ("load_n\n1\n2\n-3\n4\n", "0 or more"),
        ("load_n\n1\n2\n", "at least 3"),
        ("", "the file is empty"),
    ],
)
def test_read_loads_invalid_loads_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_loads(write_file(tmp_path / "loads.csv", text))


def test_read_loads_preserves_order(tmp_path: Path) -> None:
    path = write_file(tmp_path / "loads.csv", "load_n\n1\n5\n10\n5\n1\n")
    assert read_loads(path) == [1, 5, 10, 5, 1]
    assert has_unloading([1, 5, 10, 5, 1])
    assert not has_unloading([1, 5, 10])


class Bench:
    """A user who closes the twin until the scale shows the load."""

    def __init__(self) -> None:
        obj = draw_object(np.random.default_rng(1), "ecoflex-10")
        self.world = World(obj, seed=4)
        self.cell = TwinLoadCell(self.world)
        self.gripper = TwinGripper(self.world)
        self.width_mm = obj.size_mm + 1
        self.gripper.command(GripperCommand(target=self.width_mm, rate=40.0))
        self.world.clock.sleep_s(3.0)
        self.array = TwinArray(self.world)

    def place(self, load_n: float) -> None:
        while abs(self.cell.read_n() - load_n) > 0.3:
            self.width_mm += 0.05 if self.cell.read_n() > load_n else -0.05
            self.gripper.command(GripperCommand(target=self.width_mm, rate=20.0))
            self.world.clock.sleep_s(0.05)


def test_measure_loads_reads_settled_values() -> None:
    bench = Bench()
    found = measure_loads(
        bench.array, loads_n=[1.0, 3.0, 6.0, 9.0, 3.0], place=bench.place, clock=bench.world.clock
    )
    assert found.refused_n == ()
    assert found.pairs.force_n == (1.0, 3.0, 6.0, 9.0, 3.0)
    assert found.pairs.excess[3] > found.pairs.excess[2] > found.pairs.excess[1]


@pytest.mark.slow
def test_measure_loads_unsettled_loads_are_refused() -> None:
    bench = Bench()

    def place(load_n: float) -> None:
        bench.place(load_n)
        # The user continues to press: the fingers creep in for the whole step.
        bench.width_mm -= 5.0
        bench.gripper.command(GripperCommand(target=bench.width_mm, rate=0.1))

    with pytest.raises(CalibrationError, match="loads settled, at least 3"):
        measure_loads(
            bench.array, loads_n=[2.0, 2.5, 3.0, 3.5], place=place, clock=bench.world.clock
        )


def test_check_loads_suggests_conversion_from_grams() -> None:
    with pytest.raises(InputError, match="grams, multiply"):
        check_loads([50, 100, 200, 500], where="--loads")


class SaturatingArray:
    """A readout whose pixels follow the load up to saturation."""

    layout = RIGID_LAYOUT

    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.load_n, self.sent = clock, 0.0, 0

    def read(self, *, timeout_s: float) -> Frame:
        self.clock.sleep_s(0.25)
        self.sent += 1
        count = min(300 + round(120 * self.load_n), 1023)
        flicker = self.sent % 2
        counts = np.full((self.layout.rows, self.layout.cols), min(count + flicker, 1023))
        return Frame(time_s=self.clock.now_s(), sequence=self.sent, counts=counts, oversampling=1)

    def close(self) -> None:
        """Do nothing."""

    def place(self, load_n: float) -> None:
        self.load_n = load_n


def test_measure_loads_saturated_pixel_is_refused() -> None:
    clock = ManualClock()
    array = SaturatingArray(clock)
    fine = measure_loads(array, loads_n=[1.0, 2.0, 3.0, 4.0], place=array.place, clock=clock)
    assert len(fine.pairs.force_n) == 4
    array.place(0.0)
    with pytest.raises(CalibrationError, match="saturated at 9 N; use a smaller reference"):
        measure_loads(array, loads_n=[1.0, 2.0, 4.0, 9.0], place=array.place, clock=clock)
