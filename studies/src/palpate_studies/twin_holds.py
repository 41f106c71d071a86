"""Holds made on the twin, by the steps that the paper took on its sensor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.gripper.interface import GripperCommand
from palpate.holds import Hold
from palpate.signal.relative import mean_change, relative_change_percent, rest_baseline
from palpate.twin.devices import TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World
from palpate_studies.twin_session import GAP_MM, PAUSE_S, SPEED_MM_PER_S, STILL_S, read_ohm

#: The four silicone sheets of section 3.2.
MATERIALS = ("ecoflex-10", "dragonskin-10", "dragonskin-20", "dragonskin-30")
#: Five force levels: by how much the fingers close beyond contact, mm.
CLOSURES_MM = (2.0, 2.5, 3.0, 3.5, 4.0)

#: Seconds of rest before the first hold, and read of each hold.
REST_S, HOLD_S = 1.4, 20.2


def twin_holds(
    *,
    repeats: int,
    family: str | None = None,
    level: str = "lab",
    materials: Sequence[str] = MATERIALS,
    closures_mm: Sequence[float] = CLOSURES_MM,
    seed: int = 1,
) -> Iterator[Hold]:
    """Yield holds of the mean relative change (percent), time 0 at the start of actuation.

    Each repeat is made on a sensor of its own, so that no single sheet decides. On each sensor
    every material is taken in turn: rest values from 20 frames, then for each closure a hold of
    20 s and a pause of 20 s with the fingers open. Frames come at 15 Hz through the divider and
    the 10-bit converter.

    Parameters
    ----------
    repeats : int
        Sensors.
    family : str, optional
        Relaxation family; drawn for each sensor by default.
    level : {"lab", "field"}
        Scatter of the twin.
    materials : sequence of str
        Names in `palpate.twin.objects.OBJECTS`.
    closures_mm : sequence of float
        Closures beyond contact.
    seed : int
        Seed of everything.

    Yields
    ------
    Hold
        `hold_id` is ``sensor/material/closure``.
    """
    for repeat in range(repeats):
        sensor = 1000 * seed + repeat
        for index, material in enumerate(materials):
            obj = draw_object(np.random.default_rng([seed, index]), material)
            world = World(
                obj, seed=sensor + 1_000_000 * index, sheet_seed=sensor, level=level, family=family
            )
            for closure_mm, values in zip(
                closures_mm, hold_each(world, closures_mm, touch_mm=obj.size_mm), strict=True
            ):
                yield Hold(
                    hold_id=f"{repeat}/{material}/{closure_mm:g}",
                    channel=None,
                    # One raster for all, so that predictors can share work between holds.
                    time_s=np.arange(1, len(values) + 1) / world.frame_rate_hz,
                    values=values,
                    unit="percent",
                )


def hold_each(
    world: World, closures_mm: Sequence[float], *, touch_mm: float
) -> Iterator[FloatArray]:
    """Yield the mean relative change of a hold at each closure, percent, shape (n_times,).

    The object is held while a hold is yielded, and released before the next.
    """
    gripper, clock = TwinGripper(world), world.clock
    rest_ohm = rest_baseline(read_ohm(world, until_s=REST_S)).rest_ohm
    for closure_mm in closures_mm:
        gripper.command(GripperCommand(target=touch_mm + GAP_MM, rate=SPEED_MM_PER_S))
        clock.sleep_s(STILL_S)
        gripper.command(GripperCommand(target=touch_mm - closure_mm, rate=SPEED_MM_PER_S))
        ohm = read_ohm(world, until_s=clock.now_s() + HOLD_S)
        yield mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
        gripper.release()
        clock.sleep_s(PAUSE_S)
