"""Memory table of Feetech STS servos: the registers used by a gripper.

Source: Feetech, "SMS/STS series memory table" (STS3215). Values are little-endian; signed values
use sign-magnitude encoding.
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

#: Address range of all registers of a state, read in one packet.
STATE = 56, 71

TICKS = 4096
RAD_PER_TICK = 2 * pi / TICKS
#: The units are one tick per second (velocity), 6.5 mA (current) and 0.1 % (torque limit).
MA_PER_UNIT, FULL_TORQUE = 6.5, 1000
#: Operating mode with position control.
POSITION_MODE = 0
#: Printed model name of each model number.
MODELS = {777: "STS3215"}


class State(IntFlag):
    """Protection states of the servo, as bits in every reply."""

    VOLTAGE = 0x01
    ENCODER = 0x02
    OVERHEATING = 0x04
    OVERCURRENT = 0x08
    OVERLOAD = 0x20
