"""Dead weights: invalid loads and unsettled readings are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.calibrate.dead_weights import LoadMeasurement, has_unloading, measure_loads, read_loads
from palpate.clock import ManualClock
from palpate.errors import CalibrationError, InputError
from palpate.force.force_law import ForceLaw
from palpate.force.of_calibration import fit_sheet_law, is_made_by_weights, settled_pairs
from palpate.force.sheet_states import compute_states
from palpate.gripper.interface import GripperCommand
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load_n\n1\n5\n", r"not 2 \(1, 5 N\)"),
        ("load_n\n4\n5\n6\n", "2 times the smallest, 4 N"),
        ("load_g\n100\n200\n", "no column load_n"),
        ("load_n\n50\n100\n200\n500\n", "in grams, multiply"),
        ("load_n\n0\n0\n", "not 0"),
        ("load_n\n1\n2\nheavy\n4\n", "line 4: load_n is 'heavy'"),
        ("load_n\n1\n2\n-3\n4\n", "0 or more"),
        ("", "the file is empty"),
    ],
)
def test_read_loads_invalid_loads_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "loads.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_loads(tmp_path / "loads.csv")


def test_read_loads_preserves_order(tmp_path: Path) -> None:
    (tmp_path / "loads.csv").write_text("load_n\n1\n5\n10\n5\n1\n")
    assert read_loads(tmp_path / "loads.csv") == [1, 5, 10, 5, 1]
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
        bench.array, loads_n=[2.0, 3.0, 6.0, 9.0, 3.0], place=bench.place, clock=bench.world.clock
    )
    assert found.refused_n == ()
    settled = settled_pairs(found.pairs)
    assert settled.force_n == (2.0, 3.0, 6.0, 9.0, 3.0)
    assert settled.excess[3] > settled.excess[2] > settled.excess[1]


@pytest.mark.slow
def test_measure_loads_unsettled_loads_are_refused() -> None:
    bench = Bench()

    def place(load_n: float) -> None:
        bench.place(load_n)
        # The user continues to press: the fingers creep in for the whole step.
        bench.width_mm -= 5.0
        bench.gripper.command(GripperCommand(target=bench.width_mm, rate=0.1))

    with pytest.raises(CalibrationError, match="at least 3 different weights are needed, not 0"):
        measure_loads(
            bench.array, loads_n=[2.0, 2.5, 3.0, 3.5], place=place, clock=bench.world.clock
        )


class SaturatingArray:
    """A readout whose pixels follow the load up to saturation."""

    layout = RIGID_LAYOUT

    def __init__(self, on_it: dict[int, float] | None = None) -> None:
        """Lay the weights on, except for those in `on_it`."""
        self.clock, self.load_n, self.sent = ManualClock(), 0.0, 0
        self.on_it, self.placed, self.bad_frames = on_it or {}, 0, dict[int, int]()
        self.told = list[str]()

    def count(self) -> int:
        return min(300 + round(120 * self.load_n) + self.sent % 2, 1023)

    def read(self, *, timeout_s: float) -> Frame:
        self.clock.sleep_s(0.25)
        self.sent += 1
        counts = np.full((self.layout.rows, self.layout.cols), self.count())
        counts[0, 0] = self.bad_frames.get(self.sent, counts[0, 0])
        return Frame(time_s=self.clock.now_s(), sequence=self.sent, counts=counts, oversampling=1)

    def close(self) -> None:
        """Do nothing."""

    def place(self, load_n: float) -> None:
        self.load_n = self.on_it.get(self.placed, load_n)
        self.placed += 1

    def measure(self, *loads_n: float) -> LoadMeasurement:
        tell = self.told.append
        return measure_loads(self, loads_n=loads_n, place=self.place, clock=self.clock, tell=tell)


class Sheet(SaturatingArray):
    """A readout of a sheet whose excess is proportional to what really lies on it."""

    def count(self) -> int:
        ohm = 11_000.0 / (1.0 + 0.5 * self.load_n)
        return round(1024 * 4700.0 / (4700.0 + ohm))


def test_measure_loads_saturated_pixel_is_refused() -> None:
    assert len(SaturatingArray().measure(1.0, 2.0, 3.0, 4.0).pairs.force_n) == 4
    with pytest.raises(CalibrationError, match="saturated at 9 N; use a smaller reference"):
        SaturatingArray().measure(1.0, 2.0, 4.0, 9.0)


@pytest.mark.parametrize(
    ("loads_n", "on_it", "refused_n", "reason"),
    [
        # Nothing on the pad; the weight beside it; the weight of before still on it.
        ([1.5, 2.0, 4.0, 9.0], {0: 0.0}, (1.5,), "reading at rest"),
        ([2.0, 4.0, 9.0, 6.0], {3: 0.0}, (6.0,), "reading at rest"),
        ([2.0, 4.0, 9.0, 6.0], {1: 2.0}, (4.0,), "reading of 2 N just before"),
        ([9.0, 4.0, 2.0, 1.0], {}, (), ""),
    ],
)
def test_measure_loads_reading_without_its_weight_is_left_out(
    loads_n: list[float], on_it: dict[int, float], refused_n: tuple[float, ...], reason: str
) -> None:
    array = Sheet(on_it)
    found, told = array.measure(*loads_n), array.told
    assert found.refused_n == refused_n
    assert len(found.pairs.force_n) == len(loads_n) - len(refused_n)
    assert len(told) == len(refused_n)
    assert all(reason in one for one in told)


def test_measure_loads_unequal_readings_of_one_weight_are_reported() -> None:
    array = Sheet({3: 6.0})
    found = array.measure(2.0, 4.0, 9.0, 2.0)
    (told,) = array.told
    assert found.refused_n == ()
    assert told.startswith("2 N read 7.98 before and 23.9 now")
    law = ForceLaw.fit(found.pairs.excess, force_n=found.pairs.force_n)
    for excess in found.pairs.excess[::3]:
        assert law.force(excess).low <= 2.0 <= law.force(excess).high


def test_measure_loads_same_weight_three_times_is_not_enough() -> None:
    with pytest.raises(CalibrationError, match=r"not 1 \(4 N\)"):
        Sheet().measure(4.0, 4.0, 4.0)


class UpsideDown(SaturatingArray):
    """A board that reads the voltage over the other part of the divider."""

    def count(self) -> int:
        return 800 - round(30 * self.load_n) + self.sent % 2


def test_measure_loads_names_the_leg_of_the_divider_if_weights_raise_the_resistance() -> None:
    array = UpsideDown()
    with pytest.raises(CalibrationError):
        array.measure(1.5, 4.0, 9.0)
    assert all("taxel_leg" in told for told in array.told)
    assert len(array.told) == 3


class NoisySheet(Sheet):
    """A sheet with noise of 4 % on which a light weight has no effect."""

    def read(self, *, timeout_s: float) -> Frame:
        frame = super().read(timeout_s=timeout_s)
        noise = 1.0 + 0.04 * np.random.default_rng(self.sent).standard_normal(frame.counts.shape)
        # A part of the noise is slow: the level drifts while the weight is placed.
        level = 1.0 + 0.04 * (self.placed > 0)
        return replace(frame, counts=np.rint(frame.counts * noise * level).astype(int))


def test_measure_loads_reading_within_the_noise_at_rest_is_left_out() -> None:
    array = NoisySheet({0: 0.0})
    assert array.measure(0.2, 2.0, 4.0, 9.0).refused_n == (0.2,)
    assert "reading at rest" in array.told[0]


class RecordedSheet(Sheet):
    """A creeping sheet whose frames queue up while the user places a weight and presses Enter."""

    def __init__(self, *, lost_s: tuple[float, float] = (0.0, 0.0), hand: float = 1.0) -> None:
        """Lose the frames between these times before and after each placement."""
        super().__init__()
        self.laid_s, self.lost_s, self.hand = -np.inf, lost_s, hand
        self.queue: list[Frame] = []

    def count(self) -> int:
        since_s = self.clock.now_s() - self.laid_s
        if since_s < 0 or not np.isfinite(since_s):
            return round(1024 * 4700.0 / (4700.0 + 11_000.0))
        by_hand = self.hand if since_s < 4.0 else 1.0
        ohm = 11_000.0 / (1.0 + by_hand * excess_of(self.load_n, since_s=since_s))
        return round(1024 * 4700.0 / (4700.0 + ohm))

    def read(self, *, timeout_s: float) -> Frame:
        return self.queue.pop(0) if self.queue else super().read(timeout_s=timeout_s)

    def place(self, load_n: float) -> None:
        """Remove the last weight, lay the next one 8 s later, and press Enter after 6 s more."""
        self.load_n, self.laid_s = load_n, self.clock.now_s() + 8.0
        until_s, frames = self.laid_s + 6.0, list[Frame]()
        while self.clock.now_s() < until_s:
            frames.append(super().read(timeout_s=1.0))
        before_s, after_s = self.lost_s
        self.queue = [one for one in frames if not -before_s < one.time_s - self.laid_s < after_s]


def excess_of(load_n: float, *, since_s: float) -> float:
    """Return the excess of a pixel whose creep is twice that of the prior."""
    return float((1.0 + 0.5 * load_n) ** (1.0 - 0.5 * np.exp(-since_s / 3.0)) - 1.0)


def test_recorded_placement_gives_an_early_reading_that_teaches_the_creep() -> None:
    sheet = RecordedSheet()
    pairs = sheet.measure(1.5, 4.0, 9.0).pairs
    assert pairs.run == (0, 0, 1, 1, 2, 2)
    assert pairs.since_move_s == (2.0, 20.0) * 3
    assert is_made_by_weights(pairs)
    early = excess_of(9.0, since_s=1.75)
    assert pairs.pixel_excess[4][0] == pytest.approx(early, rel=0.03)
    time_s = np.r_[0.0, np.arange(0.1, 20.0, 0.1)]
    one = np.array([0.0, *(excess_of(6.0, since_s=at) for at in time_s[1:])])
    states = compute_states(time_s, np.repeat(one[:, None], 8, axis=1))
    settled = settled_pairs(pairs)
    soon, late = (
        fit_sheet_law(each, layout=RIGID_LAYOUT).force_n(states) for each in (pairs, settled)
    )
    at = [4, 10, 30]  # 0.4, 1 and 3 s
    error, without = (np.abs(found[0][at] / 6.0 - 1.0) for found in (soon, late))
    assert (error < 0.6 * without).all()
    assert ((soon[1][at] < 6.0) & (soon[2][at] > 6.0)).all()
    # The settled law stays.
    assert [found[-1] for found in soon] == pytest.approx([found[-1] for found in late], rel=0.01)


@pytest.mark.parametrize(
    "sheet",
    [RecordedSheet(lost_s=(9.0, 0.5)), RecordedSheet(lost_s=(1.0, 0.3)), RecordedSheet(hand=3.0)],
    ids=["full queue", "a pause", "a hand"],
)
def test_placement_that_is_not_recorded_whole_or_pressed_by_hand_has_no_early_reading(
    sheet: RecordedSheet,
) -> None:
    assert sheet.measure(1.5, 4.0, 9.0).pairs.since_move_s == (20.0,) * 3
