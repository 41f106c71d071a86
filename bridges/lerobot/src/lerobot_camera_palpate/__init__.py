"""palpate's pressure pixels as a camera of LeRobot: an image of what the fingers feel.

LeRobot finds this package by its name. A robot takes the camera by its type::

    --robot.cameras="{touch: {type: palpate, rig: rig.toml, width: 64, height: 128, fps: 15}}"
"""

from lerobot_camera_palpate.camera import PalpateCamera
from lerobot_camera_palpate.config import PalpateCameraConfig

__all__ = ["PalpateCamera", "PalpateCameraConfig"]
