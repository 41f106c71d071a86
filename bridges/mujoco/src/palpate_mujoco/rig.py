"""The rigs `mujoco` and `mujoco-so101`: a MuJoCo gripper, a simulated object, a calibration."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.rig import Rig
from palpate.rig.simulated import CALIBRATION_SEED_OFFSET, calibrate_world
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate_mujoco.hand import SO101, WIDOWX, Hand
from palpate_mujoco.world import MujocoWorld


def open_mujoco(*, object_name: str | None, seed: int, level: str = "lab") -> Rig:
    """Open a hand like the WidowX 250's with an object between its fingers.

    Object and sheet are the same as in the rig `sim-rigid` with the same seed.

    Raises
    ------
    InputError
        If the object is unknown.
    """
    return _open_rig("mujoco", WIDOWX, object_name=object_name, seed=seed, level=level)


def open_so101(*, object_name: str | None, seed: int, level: str = "lab") -> Rig:
    """Open a hand like the SO-101's, otherwise like `open_mujoco`.

    Raises
    ------
    InputError
        If the object is unknown.
    """
    return _open_rig("mujoco-so101", SO101, object_name=object_name, seed=seed, level=level)


def _open_rig(name: str, hand: Hand, *, object_name: str | None, seed: int, level: str) -> Rig:
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; available: {', '.join(OBJECTS)}")
    obj = draw_object(np.random.default_rng([seed, 10]), object_name)
    world = MujocoWorld(obj, seed=seed, level=level, hand=hand)
    bench = MujocoWorld(
        None, seed=seed + CALIBRATION_SEED_OFFSET, sheet_seed=seed, level=level, hand=hand
    )
    return Rig(
        name=name,
        array=TwinArray(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=calibrate_world(
            bench, seed=seed, apart_from=obj.name, sensor_id=f"{name}-{seed}"
        ),
        origin="twin",
        subject=obj.name,
        truth=lambda: world.truth().to_dict(),
    )
