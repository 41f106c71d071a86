"""The memory table of Feetech STS servos as data, limited to a gripper's needs.

Source: Feetech, "SMS/STS series memory table" (STS3215). Little-endian; signed values are a
magnitude with a sign bit.
"""

from __future__ import annotations

from enum import IntFlag
from math import pi

from palpate.gripper.packets import Register

MODEL_NUMBER = Register(3, 2)
OPERATING_MODE = Register(33, 1)
TORQUE_ENABLE = Register(40, 1)
ACCELERATION = Register(41, 1)
GOAL_POSITION = Register(42, 2, sign_bit=15)
GOAL_VELOCITY = Register(46, 2)
TORQUE_LIMIT = Register(48, 2)
PRESENT_POSITION = Register(56, 2, sign_bit=15)
MOVING = Register(66, 1)
PRESENT_CURRENT = Register(69, 2, sign_bit=15)

#: What a state needs lies in one run, so it is read in one packet.
STATE = 56, 71

TICKS = 4096
RAD_PER_TICK = 2 * pi / TICKS
#: One unit of velocity is one tick a second, of current 6.5 mA, of the torque limit 0.1 %.
MA_PER_UNIT, FULL_TORQUE = 6.5, 1000
#: Operating mode that follows a position.
POSITION_MODE = 0
#: Model number -> as printed on it.
MODELS = {777: "STS3215"}


class State(IntFlag):
    """Bits of every reply: what the servo protects itself against."""

    VOLTAGE = 0x01
    ENCODER = 0x02
    OVERHEATING = 0x04
    OVERCURRENT = 0x08
    OVERLOAD = 0x20
