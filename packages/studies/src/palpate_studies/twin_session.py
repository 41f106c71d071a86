"""Experiments with one simulated sensor: rest values, grasps to a width, holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.gripper.interface import GripperCommand
from palpate.holds import Hold
from palpate.sensor.array import ArrayLayout
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import (
    PixelSignals,
    SampleReader,
    pixel_resistance_ohm,
    relative_change_percent,
)
from palpate.signal.relative import largest_change, mean_change, total_excess
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.velostat import Environment, Sheet
from palpate.twin.world import World

#: The settled value is the mean over this time before the end of a hold.
SETTLED_MEAN_S = 0.5
#: Initial gap, closing speed, still time before closing, and pause after opening.
GAP_MM, SPEED_MM_PER_S, STILL_S, PAUSE_S = 6.0, 40.0, 2.0, 20.0
HOLD_S = 20.0
#: Seed of the objects.
_OBJECT_SEED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Readings of sensor and load cell at one time; arrays of shape (rows, cols).

    Attributes
    ----------
    pixels : PixelSignals
        Signals relative to rest just before the grasp.
    force_n : float
        Force of the load cell.
    """

    pixels: PixelSignals
    force_n: float

    @property
    def ohm(self) -> FloatArray:
        """Resistance of each pixel."""
        return self.pixels.resistance_ohm

    @property
    def change_percent(self) -> FloatArray:
        """Relative change of each pixel."""
        return self.pixels.change_percent

    @property
    def mean_percent(self) -> float:
        """Mean relative change, as in the paper."""
        return float(mean_change(self.change_percent))

    @property
    def largest_percent(self) -> float:
        """Change of the pixel with the largest fall."""
        return float(largest_change(self.change_percent))

    @property
    def excess(self) -> float:
        """Excess conductance summed over pixels."""
        return float(total_excess(self.pixels.excess))


class Session:
    """A sensor and gripper of one seed, used only through their devices.

    Parameters
    ----------
    sensor : int
        Seed of the sensor and the gripper.
    level : {"lab", "field"}
        Scatter of the twin.
    trial : int
        Seed of the changes from session to session.
    layout : ArrayLayout, optional
        Layout of the pixels; the paper's by default.
    environment : Environment, optional
        Climate and earlier use.
    replace_sheet : callable, optional
        As in `World`.
    """

    def __init__(
        self,
        sensor: int,
        *,
        level: str,
        trial: int = 0,
        layout: ArrayLayout | None = None,
        environment: Environment | None = None,
        replace_sheet: Callable[[Sheet], Sheet] | None = None,
    ) -> None:
        self.world = World(
            None,
            seed=1_000_003 * (trial + 1) + sensor,
            sheet_seed=sensor,
            level=level,
            layout=layout,
            environment=environment,
            replace_sheet=replace_sheet,
        )
        self.gripper, self.cell = TwinGripper(self.world), TwinLoadCell(self.world)

    def place(self, obj: TwinObject, *, fixture: bool = False) -> None:
        """Open the fingers and place a new object between them."""
        self.gripper.release()
        self.world.clock.sleep_s(STILL_S)
        self.world.place(obj, fixture=fixture)

    def mean_ohm(self) -> FloatArray:
        """Read for half a second; return the mean resistances, shape (rows, cols)."""
        return np.asarray(self.read(SETTLED_MEAN_S).mean(axis=0))

    def read(self, duration_s: float) -> FloatArray:
        """Read frames; return resistances, shape (frames, rows, cols).

        A saturated pixel has the smallest resistance of the converter's range, as in a grasp and in
        a calibration.
        """
        ohm = read_ohm(self.world, until_s=self.world.clock.now_s() + duration_s)
        return np.maximum(ohm, self.world.layout.divider.least_ohm)

    def close_to(self, width_mm: float, *, speed_mm_per_s: float = SPEED_MM_PER_S) -> None:
        """Command the fingers to a width."""
        self.gripper.command(GripperCommand(target=width_mm, rate=speed_mm_per_s))

    def grasp(self, obj_size_mm: float, *, width_mm: float, hold_s: float = HOLD_S) -> Reading:
        """Measure rest values, close to a width, hold, read settled values, open and pause."""
        rest_ohm = self._close_from_rest(obj_size_mm, width_mm=width_mm)
        self.world.clock.sleep_s(hold_s - SETTLED_MEAN_S)
        pixels = SampleReader(self.world.layout, rest_ohm).read_ohm(self.mean_ohm())
        reading = Reading(pixels=pixels, force_n=self.cell.read_n())
        self._open()
        return reading

    def hold(
        self,
        obj_size_mm: float,
        *,
        width_mm: float,
        read_s: float = HOLD_S,
        speed_mm_per_s: float = SPEED_MM_PER_S,
    ) -> FloatArray:
        """Measure rest values, close to a width, read changes, open and pause.

        Returns percent from the start of actuation, shape (times, rows, cols).
        """
        rest_ohm = self._close_from_rest(
            obj_size_mm, width_mm=width_mm, speed_mm_per_s=speed_mm_per_s
        )
        change = relative_change_percent(self.read(read_s), rest_ohm=rest_ohm)
        self._open()
        return change

    def _close_from_rest(
        self, obj_size_mm: float, *, width_mm: float, speed_mm_per_s: float = SPEED_MM_PER_S
    ) -> FloatArray:
        """Measure rest values and start closing to a width; return the rest values."""
        self.close_to(obj_size_mm + GAP_MM)
        self.world.clock.sleep_s(STILL_S)
        rest_ohm = self.mean_ohm()
        self.close_to(width_mm, speed_mm_per_s=speed_mm_per_s)
        return rest_ohm

    def _open(self) -> None:
        self.gripper.release()
        self.world.clock.sleep_s(PAUSE_S)


def read_ohm(world: World, *, until_s: float) -> FloatArray:
    """Read frames until a time; return resistances, shape (frames, rows, cols)."""
    array, counts = TwinArray(world), []
    while world.clock.now_s() < until_s - 1e-9:
        counts.append(array.read(timeout_s=1.0).counts)
    array.close()
    return pixel_resistance_ohm(np.stack(counts), layout=world.layout)


def stack_holds(holds: Sequence[FloatArray]) -> FloatArray:
    """Return holds as one array, truncated to the shortest hold."""
    shortest = min(map(len, holds))
    return np.array([hold[:shortest] for hold in holds])


def grasps(
    session: Session,
    obj: TwinObject,
    *,
    widths_mm: Sequence[float],
    repeats: int,
    fixture: bool = False,
) -> list[list[Reading]]:
    """Grasp one object at each width, `repeats` times: readings by width and repeat."""
    session.place(obj, fixture=fixture)
    return [
        [session.grasp(obj.size_mm, width_mm=width_mm) for _ in range(repeats)]
        for width_mm in widths_mm
    ]


def draw_named(name: str) -> TwinObject:
    """Draw the object of this name, the same for all sensors of a study."""
    return draw_object(np.random.default_rng([_OBJECT_SEED, sum(name.encode())]), name)


#: The four silicone sheets of section 3.2.
MATERIALS = ("ecoflex-10", "dragonskin-10", "dragonskin-20", "dragonskin-30")
#: Five force levels, as closures beyond contact, mm.
CLOSURES_MM = (2.0, 2.5, 3.0, 3.5, 4.0)

#: Durations of the rest before the first hold, and of the reading of each hold, seconds.
_RESTS_S, _HOLDS_S = 1.4, 20.2


def twin_holds(*, repeats: int, family: str | None = None) -> Iterator[Hold]:
    """Yield holds of the mean relative change (percent), time 0 at the start of actuation.

    Each repeat uses another sensor. On each sensor every material is measured in turn: rest values
    from 21 frames, then for each closure a hold of 20 s and a pause of 20 s with the fingers open.
    Frames are read at 15 Hz through the divider and the 10-bit converter.

    Parameters
    ----------
    repeats : int
        Number of sensors.
    family : str, optional
        Relaxation family; drawn for each sensor by default.

    Yields
    ------
    Hold
        `hold_id` is ``sensor/material/closure``.
    """
    for repeat in range(repeats):
        sensor = 1000 + repeat
        for index, material in enumerate(MATERIALS):
            obj = draw_object(np.random.default_rng([1, index]), material)
            world = World(obj, seed=sensor + 1_000_000 * index, sheet_seed=sensor, family=family)
            each = record_holds(world, CLOSURES_MM, touch_mm=obj.size_mm)
            for closure_mm, values in zip(CLOSURES_MM, each, strict=True):
                yield Hold(
                    hold_id=f"{repeat}/{material}/{closure_mm:g}",
                    channel=None,
                    # With a common time grid, predictors share computations between holds.
                    time_s=np.arange(1, len(values) + 1) / world.frame_rate_hz,
                    values=values,
                    unit="percent",
                )


def record_holds(
    world: World, closures_mm: Sequence[float], *, touch_mm: float
) -> Iterator[FloatArray]:
    """Yield the mean relative change of a hold at each closure, percent, shape (n_times,).

    The object remains gripped while a hold is yielded, and is released before the next hold.
    """
    gripper, clock = TwinGripper(world), world.clock
    rest_ohm = rest_baseline(read_ohm(world, until_s=_RESTS_S)).rest_ohm
    for closure_mm in closures_mm:
        gripper.command(GripperCommand(target=touch_mm + GAP_MM, rate=SPEED_MM_PER_S))
        clock.sleep_s(STILL_S)
        gripper.command(GripperCommand(target=touch_mm - closure_mm, rate=SPEED_MM_PER_S))
        ohm = read_ohm(world, until_s=clock.now_s() + _HOLDS_S)
        yield mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
        gripper.release()
        clock.sleep_s(PAUSE_S)
