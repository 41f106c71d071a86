"""What a user states of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.cameras import CameraConfig


@CameraConfig.register_subclass("palpate")
@dataclass(kw_only=True)
class PalpateCameraConfig(CameraConfig):
    """A pressure sensor, and the size of its image.

    Attributes
    ----------
    rig : str
        A rig file (its gripper is left alone), or a simulated rig, whose object is squeezed.
    width, height : int or None
        Size of the image: whole multiples of the sensor's columns and rows. None takes 32 for each
        pixel of the sensor; LeRobot's robots need the numbers before they connect.
    fps : int or None
        LeRobot's robots need a number; the rig's own rate is the camera's.
    """

    rig: str = "rig.toml"
