"""palpate in MuJoCo: the sensor on the pads of any model, and simulated grippers."""

from palpate_mujoco.pads import Pad, TouchGrid
from palpate_mujoco.sensor import PadSensor
from palpate_mujoco.world import MujocoWorld

__all__ = ["MujocoWorld", "Pad", "PadSensor", "TouchGrid"]
