"""The bench of a calibration on the twin: its devices, and what its user has at hand."""

from __future__ import annotations

from palpate.grasp.calibrating import Bench
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.world import World

#: What the load cell is faced with in turn: flat and round, soft and stiff.
FACES = (
    "ball-44lbs",
    "dragonskin-20",
    "ball-66lbs",
    "springs-8",
    "ball-33lbs",
    "dragonskin-10",
    "springs-4",
    "ecoflex-10",
)


def twin_bench(world: World, *, start: float) -> Bench:
    """Return the devices of a world; `start` as in `Bench`.

    Examples
    --------
    >>> twin_bench(World(None, seed=1), start=51.0).cell.read_n() < 0.1
    True
    """
    array = TwinArray(world)
    return Bench(
        array=array,
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=start,
        # Frames that nobody looks at need not be worked out.
        skip_until=array.skip_until,
    )
