"""What the devices can be doing, what can be pressed, and which order begins which activity."""

from __future__ import annotations

from enum import StrEnum

from palpate.dashboard.orders import (
    CalibrateForce,
    CalibrateRest,
    Examine,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    Play,
    Record,
)


class Activity(StrEnum):
    """What the devices are doing."""

    IDLE = "no rig"
    OPENING = "opening the rig"
    WATCHING = "watching"
    GRASPING = "grasping"
    RELEASING = "opening the hand"
    RESTING = "calibrating rest"
    WEIGHING = "calibrating force"
    EXAMINING = "examining"
    REPLAYING = "replaying"
    GONE = "gone"


class Action(StrEnum):
    """What can be pressed, apart from stop."""

    OPEN = "open a rig"
    GRASP = "grasp"
    RELEASE = "release"
    CALIBRATE = "calibrate"
    EXAMINE = "examine"
    PLAY = "replay"
    RECORD = "record"
    CONFIRM = "confirm"
    SPEED = "change the speed"
    STEER = "move the replay"
    FILES = "rename or delete"


ACTIVITIES: dict[type[Order], Activity] = {
    OpenRig: Activity.OPENING,
    GraspOrder: Activity.GRASPING,
    OpenHand: Activity.RELEASING,
    CalibrateRest: Activity.RESTING,
    CalibrateForce: Activity.WEIGHING,
    Examine: Activity.EXAMINING,
    Play: Activity.REPLAYING,
}
ACTIONS: dict[type[Order], Action] = {
    OpenRig: Action.OPEN,
    GraspOrder: Action.GRASP,
    OpenHand: Action.RELEASE,
    CalibrateRest: Action.CALIBRATE,
    CalibrateForce: Action.CALIBRATE,
    Examine: Action.EXAMINE,
    Play: Action.PLAY,
    Record: Action.RECORD,
}
