"""The memory table of Feetech STS servos, as far as a gripper needs it, as data.

Source: Feetech, "SMS/STS series memory table" (STS3215). Little-endian; signed values are a
magnitude with a sign bit.
"""

from __future__ import annotations

from enum import IntFlag
from math import pi

from palpate.gripper.x_series import Register

MODEL_NUMBER = Register(3, 2)
OPERATING_MODE = Register(33, 1)
TORQUE_ENABLE = Register(40, 1)
ACCELERATION = Register(41, 1)
GOAL_POSITION = Register(42, 2)
GOAL_VELOCITY = Register(46, 2)
TORQUE_LIMIT = Register(48, 2)
PRESENT_POSITION = Register(56, 2)
PRESENT_VOLTAGE = Register(62, 1)
PRESENT_TEMPERATURE = Register(63, 1)
MOVING = Register(66, 1)
PRESENT_CURRENT = Register(69, 2)

#: What a state needs lies in one run, so it is read in one packet.
STATE_BEGIN, STATE_END = 56, 71
#: Sign bits of what is measured.
POSITION_SIGN, CURRENT_SIGN = 15, 15

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


def decode_signed(value: int, *, sign_bit: int) -> int:
    """Return a magnitude with a sign bit as a number.

    >>> decode_signed(0x8005, sign_bit=15), decode_signed(5, sign_bit=15)
    (-5, 5)
    """
    magnitude = value & ~(1 << sign_bit)
    return -magnitude if value >> sign_bit & 1 else magnitude
