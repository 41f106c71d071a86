"""The rigs `mujoco` and `mujoco-so101`: a MuJoCo gripper, a simulated object, a calibration."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import InputError
from palpate.rig import Rig
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate.twin.rig import CALIBRATION_SEED_OFFSET, calibrate_world
from palpate_mujoco.hand import SO101, WIDOWX
from palpate_mujoco.world import MujocoWorld

_HANDS = {"mujoco": WIDOWX, "mujoco-so101": SO101}


def open_mujoco(*, object_name: str | None, seed: int, level: str = "lab") -> Rig:
    """Open a hand like the WidowX 250's with an object between its fingers.

    Object and sheet are the same as in the rig `sim-rigid` with the same seed.

    Raises
    ------
    InputError
        If the object is unknown.
    """
    return _open_rig("mujoco", object_name=object_name, seed=seed, level=level)


def open_so101(*, object_name: str | None, seed: int, level: str = "lab") -> Rig:
    """Open a hand like the SO-101's, otherwise like `open_mujoco`.

    Raises
    ------
    InputError
        If the object is unknown.
    """
    return _open_rig("mujoco-so101", object_name=object_name, seed=seed, level=level)


def _open_rig(name: str, *, object_name: str | None, seed: int, level: str) -> Rig:
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; available: {', '.join(OBJECTS)}")
    obj = draw_object(np.random.default_rng([seed, 10]), object_name)
    world = MujocoWorld(obj, seed=seed, level=level, hand=_HANDS[name])
    return Rig(
        name=name,
        array=TwinArray(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=_calibrate(name, seed, level, obj.name),
        origin="twin",
        subject=obj.name,
        truth=lambda: world.truth().to_dict(),
    )


# A calibration takes longer than a grasp, and a process often opens the same rig again.
@lru_cache(maxsize=64)
def _calibrate(name: str, seed: int, level: str, apart_from: str) -> Calibration:
    bench = MujocoWorld(
        None,
        seed=seed + CALIBRATION_SEED_OFFSET,
        sheet_seed=seed,
        level=level,
        hand=_HANDS[name],
    )
    return calibrate_world(bench, seed=seed, apart_from=apart_from, sensor_id=f"{name}-{seed}")
