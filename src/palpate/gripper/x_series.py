"""Control table of DYNAMIXEL X-series servos: the registers used by a gripper.

Source: ROBOTIS e-Manual, control tables of XL430-W250, XM430-W350 and XL330-M288 (Protocol 2.0).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from math import pi

from palpate.gripper.packets import Register

MODEL_NUMBER = Register(0, 2)
DRIVE_MODE = Register(10, 1)
OPERATING_MODE = Register(11, 1)
PWM_LIMIT = Register(36, 2)
CURRENT_LIMIT = Register(38, 2)
TORQUE_ENABLE = Register(64, 1)
HARDWARE_ERROR = Register(70, 1)
BUS_WATCHDOG = Register(98, 1, signed=True)
GOAL_PWM = Register(100, 2, signed=True)
GOAL_CURRENT = Register(102, 2, signed=True)
PROFILE_ACCELERATION = Register(108, 4)
PROFILE_VELOCITY = Register(112, 4)
GOAL_POSITION = Register(116, 4, signed=True)
MOVING = Register(122, 1)
MOVING_STATUS = Register(123, 1)
PRESENT_CURRENT = Register(126, 2, signed=True)
PRESENT_POSITION = Register(132, 4, signed=True)

#: Address range of all registers of a state, read in one packet.
STATE = 122, 147

RAD_PER_TICK = 2 * pi / 4096
#: Middle of the travel, where the horn's angle is 0.
CENTRE_TICK = 2048
RAD_PER_S_PER_VELOCITY = 0.229 * 2 * pi / 60
WATCHDOG_STEP_S, MAX_WATCHDOG_STEPS = 0.02, 127
#: Bits of `DRIVE_MODE`: positions increase clockwise; `PROFILE_VELOCITY` is the duration of a
#: movement in milliseconds instead of its speed.
REVERSE, TIME_BASED = 0x01, 0x04
#: Goal PWM for the full supply voltage.
FULL_PWM = 885
#: Bit of `MOVING_STATUS`: the motion profile of the last goal is in progress.
PROFILE_ONGOING = 0x02


class Mode(IntEnum):
    """Values of `OPERATING_MODE` with position control."""

    POSITION = 3
    CURRENT_BASED_POSITION = 5


class HardwareError(IntFlag):
    """Bits of `HARDWARE_ERROR`; any error switches the torque off until a reboot."""

    INPUT_VOLTAGE = 0x01
    OVERHEATING = 0x04
    ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20


class PacketError(IntEnum):
    """Low 7 bits of a status packet's error byte."""

    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A servo model."""

    #: Printed model name.
    name: str
    #: Unit of the current registers; None without current measurement, where only the PWM can be
    #: limited.
    ma_per_unit: float | None


#: Model of each model number.
MODELS = {
    1060: Model(name="XL430-W250", ma_per_unit=None),
    1090: Model(name="2XL430-W250", ma_per_unit=None),
    1020: Model(name="XM430-W350", ma_per_unit=2.69),
    1030: Model(name="XM430-W210", ma_per_unit=2.69),
    1120: Model(name="XM540-W270", ma_per_unit=2.69),
    1130: Model(name="XM540-W150", ma_per_unit=2.69),
    1190: Model(name="XL330-M077", ma_per_unit=1.0),
    1200: Model(name="XL330-M288", ma_per_unit=1.0),
}
