"""palpate in MuJoCo: the pressure sensor on pads of any model, and a hand that grasps with it."""

from palpate_mujoco.pads import Pad, TouchGrid
from palpate_mujoco.sensor import PadSensor
from palpate_mujoco.world import MujocoWorld

__all__ = ["MujocoWorld", "Pad", "PadSensor", "TouchGrid"]
