"""The built-in rigs on the twin: each seed is a new sensor and gripper, calibrated on the twin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from palpate.errors import DeviceError, InputError
from palpate.estimate.force import PowerForceLaw
from palpate.grasp.calibrating import Bench, measure_block, measure_force, measure_rest
from palpate.grasp.planning import DWELL_S, HORIZON_S, pairs_at
from palpate.rig import Rig
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import Calibration
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import OBJECTS, TwinObject, draw_object
from palpate.twin.world import World

#: What the load cell is faced with in turn: flat and round, soft and stiff, as a user has at hand.
_FACES = ("ball-44lbs", "dragonskin-20", "ball-66lbs", "springs-8", "ball-33lbs", "dragonskin-10")
#: Forces to hold at in each placement of the cell: small ones and large ones mixed.
_HOLDS_N = ((0.4, 3.0), (0.8, 6.0), (0.3, 2.0), (1.5, 12.0), (0.6, 4.0), (2.5, 18.0), (0.4, 1.2))
#: No face is larger than this.
_START_MM = 51.0
_BLOCK_MM, _BLOCK_N, _BLOCK_REPEATS = 40.0, 15.0, 3


def open_rigid(
    *,
    object_name: str | None,
    seed: int,
    level: str = "paper",
    name: str = "sim-rigid",
    read_through: Callable[[World], PressureArray] = TwinArray,
) -> Rig:
    """Open rigid fingers on the twin, with an object between them.

    `read_through` makes the array that reads the twin's pixels.

    Raises
    ------
    InputError
        If there is no such object.
    """
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; there are: {', '.join(OBJECTS)}")
    obj = draw_object(np.random.default_rng([seed, 10]), object_name)
    world = World(obj, seed=seed, sheet_seed=seed, level=level)
    return Rig(
        name=name,
        array=read_through(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=calibrated(seed=seed, level=level, apart_from=obj.name),
        simulated=True,
        subject=obj.name,
        truth=partial(_truth, world),
    )


def open_soft(*, object_name: str | None, seed: int) -> Rig:
    """Refuse: the controller closes by width, and soft fingers are driven by pressure."""
    raise DeviceError(
        "rig 'sim-soft' can't grasp yet: its fingers are driven by pressure and the controller "
        "closes by width; use --rig sim-rigid"
    )


def calibrated(*, seed: int, level: str, apart_from: str) -> Calibration:
    """Calibrate the sensor and gripper of a seed in another session than the grasp's.

    The steps are a user's: rest, a load cell with changing faces, a rigid block. Nothing is taken
    from the twin's own values, and the object to be grasped is not among the faces.
    """
    rng = np.random.default_rng([seed, 11])
    faces = [name for name in _FACES if name != apart_from]

    def face(run: int) -> TwinObject:
        return draw_object(rng, faces[run % len(faces)])

    world = World(None, seed=seed + 1_000_003, sheet_seed=seed, level=level)
    bench = Bench(
        array=TwinArray(world),
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start_mm=_START_MM,
    )
    rest = measure_rest(bench)
    force = measure_force(
        bench,
        holds_n=_HOLDS_N,
        reseat=lambda run: world.place(face(run)),
        dwell_s=DWELL_S,
        horizon_s=HORIZON_S,
    )
    world.place(draw_object(rng, "rigid-block"))
    block = measure_block(
        bench, block_mm=_BLOCK_MM, up_to_n=_BLOCK_N, repeats=_BLOCK_REPEATS, dwell_s=DWELL_S
    )
    excess, force_n = pairs_at(force, since_move_s=HORIZON_S)
    return Calibration(
        sensor_id=f"twin-{seed}",
        origin="simulated",
        layout=world.layout,
        rest=rest,
        force=force,
        block=block,
        force_law=PowerForceLaw.fit(excess, force_n=force_n).as_dict(),
    )


def _truth(world: World) -> Mapping[str, object]:
    return world.truth().as_json()
