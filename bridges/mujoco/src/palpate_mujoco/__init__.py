"""palpate in MuJoCo: the sensor on pads of any model, and a gripper that grasps."""

from palpate_mujoco.pads import Pad, TouchGrid
from palpate_mujoco.sensor import PadSensor
from palpate_mujoco.world import MujocoWorld

__all__ = ["MujocoWorld", "Pad", "PadSensor", "TouchGrid"]
