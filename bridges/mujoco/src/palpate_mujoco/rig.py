"""The rig `mujoco`: a WidowX-like hand in MuJoCo, an object of the twin, and their calibration."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.rig import Rig
from palpate.rig.simulated import ANOTHER_SESSION, calibrated_on
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate_mujoco.world import MujocoWorld


def open_mujoco(*, object_name: str | None, seed: int, level: str = "paper") -> Rig:
    """Open the hand with an object between its fingers.

    The object and the sheet are those that the rig `sim-rigid` draws for the same seed.

    Raises
    ------
    InputError
        If there is no such object.
    """
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; there are: {', '.join(OBJECTS)}")
    obj = draw_object(np.random.default_rng([seed, 10]), object_name)
    world = MujocoWorld(obj, seed=seed, level=level)
    bench = MujocoWorld(None, seed=seed + ANOTHER_SESSION, sheet_seed=seed, level=level)
    return Rig(
        name="mujoco",
        array=TwinArray(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=calibrated_on(
            bench, seed=seed, apart_from=obj.name, sensor_id=f"mujoco-{seed}"
        ),
        origin="twin",
        subject=obj.name,
        truth=lambda: world.truth().as_json(),
    )
