"""Rigs of the tests as entry points: the twin with one shared calibration."""

from __future__ import annotations

import os

import numpy as np

from palpate.calibration import Calibration
from palpate.gripper.dynamixel import open_gripper
from palpate.rig import Rig
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

#: Seed of the calibration in the file PALPATE_TEST_PAD.
SEED = 5


def open_bench(*, object_name: str | None, seed: int) -> Rig:
    """Open the twin's hand with an object, or empty for `nothing`."""
    subject = object_name or "strawberry"
    obj = None if subject == "nothing" else draw_object(np.random.default_rng(seed), subject)
    world = World(obj, seed=seed, sheet_seed=SEED)
    return _rig(world, gripper=TwinGripper(world), subject=subject)


def open_servo(*, object_name: str | None, seed: int) -> Rig:
    """Open a servo on the port PALPATE_TEST_PORT, empty, with an unrelated simulated sheet.

    The servo is simulated in another process, so that this process can be killed.
    """
    world = World(None, seed=seed, sheet_seed=SEED)
    gripper = open_gripper(port=os.environ["PALPATE_TEST_PORT"], reply_s=1.0)
    return _rig(world, gripper=gripper, subject="nothing")


def _rig(world: World, *, gripper: object, subject: str) -> Rig:
    return Rig(
        name="bench",
        array=TwinArray(world),
        gripper=gripper,
        clock=world.clock,
        calibration=Calibration.load(os.environ["PALPATE_TEST_PAD"]),
        origin="twin",
        subject=subject,
    )
