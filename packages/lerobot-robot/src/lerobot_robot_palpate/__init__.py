"""Robots of LeRobot with palpate's sensor: a hand with a force limit, and an SO-101 that feels.

LeRobot discovers this package by its name and the robots by their types::

    lerobot-record --robot.type=palpate --robot.rig=rig.toml --robot.limit_n=4 ...
    lerobot-record --robot.type=palpate_so101 --robot.port=/dev/ttyACM0 --robot.rig=sensor.toml ...
"""

from lerobot_robot_palpate.config import PalpateHandConfig
from lerobot_robot_palpate.robot import PalpateHand
from lerobot_robot_palpate.so101 import PalpateSO101, PalpateSO101Config

__all__ = ["PalpateHand", "PalpateHandConfig", "PalpateSO101", "PalpateSO101Config"]
