"""Configuration of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.cameras import CameraConfig


@CameraConfig.register_subclass("palpate")
@dataclass(kw_only=True)
class PalpateCameraConfig(CameraConfig):
    """A pressure sensor and the size of its image.

    Attributes
    ----------
    rig : str
        A rig file (its gripper is not used), or a simulated rig, whose object is squeezed.
    width, height : int or None
        Size of the image: integer multiples of the sensor's columns and rows. None means 32 per
        pixel of the sensor; LeRobot's robots require both numbers before they connect.
    fps : int or None
        Required by LeRobot's robots; the actual rate is that of the rig.
    """

    rig: str = "rig.toml"
