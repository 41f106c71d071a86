"""A hand with palpate's sensor as a LeRobot robot, with a force limit on closing.

LeRobot discovers this package by its name and the robot by its type::

    lerobot-record --robot.type=palpate --robot.rig=rig.toml --robot.limit_n=4 ...
"""

from lerobot_robot_palpate.config import PalpateHandConfig
from lerobot_robot_palpate.robot import PalpateHand

__all__ = ["PalpateHand", "PalpateHandConfig"]
