"""What the sensor costs a MuJoCo simulation: steps per second with and without it.

    python benchmarks/mujoco_cost.py

The WidowX-like hand holds a thing, in steps of 1 ms. Without the sensor MuJoCo alone runs; with it
frames are read 15 times a second, and contacts taken in once a frame, or as often as the rig does.
Both take turns and are timed by the processor's time, because other programs share the machine.
Ends with status 1 where the sensor takes more than 30 % longer at once a frame. Needs
`pip install -e bridges/mujoco`.
"""

from __future__ import annotations

import argparse
import copy
import sys
import time
from collections.abc import Callable
from statistics import median

import mujoco
import numpy as np

from palpate.twin.devices import TwinArray
from palpate.twin.objects import draw_object
from palpate_mujoco import MujocoWorld, PadSensor
from palpate_mujoco.hand import WIDOWX
from palpate_mujoco.world import EVERY_S

MOST = 0.30


def holding(name: str) -> MujocoWorld:
    """Return a world whose hand holds an object."""
    obj = draw_object(np.random.default_rng(1), name)
    world = MujocoWorld(obj, seed=1)
    world.drive(obj.size_mm - 2.0, rate=20.0)
    world.clock.sleep_s(4.0)
    world.force_n(world.now_s())
    return world


def timed(work: Callable[[], None]) -> float:
    """Return the processor's seconds that some work takes."""
    before_s = time.process_time()
    work()
    return time.process_time() - before_s


def measured(name: str, *, every_s: float, seconds: float, rounds: int) -> float:
    """Print a row, and return by what share the sensor makes the simulation slower."""
    world = holding(name)
    model, bare = world.model, copy.copy(world.data)
    sensor = PadSensor(model, copy.copy(world.data), pads=WIDOWX.pads, seed=1, every_s=every_s)
    array = TwinArray(sensor)
    steps = round(every_s / model.opt.timestep)

    def without() -> None:
        for _ in range(round(seconds / every_s)):
            mujoco.mj_step(model, bare, steps)

    def with_sensor() -> None:
        until_s = sensor.clock.now_s() + seconds
        while sensor.clock.now_s() < until_s:
            array.read(timeout_s=1.0)

    pairs = [(timed(without), timed(with_sensor)) for _ in range(rounds)]
    slower = median(after / before for before, after in pairs) - 1.0
    rates = [seconds / model.opt.timestep / median(column) for column in zip(*pairs, strict=True)]
    frame_s = median(after - before for before, after in pairs) / (seconds * sensor.frame_rate_hz)
    print(
        f"{name:10} {world.data.ncon} contacts, taken in every {1e3 * every_s:3.0f} ms: "
        f"{rates[0]:8,.0f} steps/s without, {rates[1]:8,.0f} with: {100 * slower:+.0f} %, "
        f"{1e6 * frame_s:.0f} µs a frame"
    )
    return slower


def main() -> None:
    """Measure a hold with few contacts and one with many."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, of each run")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    slower = {
        (name, every_s): measured(
            name, every_s=every_s, seconds=options.seconds, rounds=options.rounds
        )
        for every_s in (1 / 15, EVERY_S)
        for name in ("ball-44lbs", "springs-4")
    }
    sys.exit(any(share > MOST for (_, every_s), share in slower.items() if every_s > EVERY_S))


if __name__ == "__main__":
    main()
