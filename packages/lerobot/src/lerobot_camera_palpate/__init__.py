"""palpate's pressure array as a LeRobot camera: an image of the contact.

LeRobot discovers this package by its name. A robot selects the camera by its type::

    --robot.cameras="{touch: {type: palpate, rig: rig.toml, width: 64, height: 128, fps: 15}}"
"""

from lerobot_camera_palpate.camera import PalpateCamera
from lerobot_camera_palpate.config import PalpateCameraConfig

__all__ = ["PalpateCamera", "PalpateCameraConfig"]
