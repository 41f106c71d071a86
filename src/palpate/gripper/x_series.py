"""Control table of DYNAMIXEL X-series servos: the registers used by a gripper.

Source: ROBOTIS e-Manual, control tables of XL430-W250, XM430-W350 and XL330-M288 (Protocol 2.0).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from math import pi

from palpate.gripper.packets import Register

MODEL_NUMBER = Register(0, 2, name="Model_Number")
DRIVE_MODE = Register(10, 1, name="Drive_Mode")
OPERATING_MODE = Register(11, 1, name="Operating_Mode")
HOMING_OFFSET = Register(20, 4, signed=True, name="Homing_Offset")
MAX_VOLTAGE_LIMIT = Register(32, 2, name="Max_Voltage_Limit")
MIN_VOLTAGE_LIMIT = Register(34, 2, name="Min_Voltage_Limit")
PWM_LIMIT = Register(36, 2, name="PWM_Limit")
CURRENT_LIMIT = Register(38, 2, name="Current_Limit")
VELOCITY_LIMIT = Register(44, 4, name="Velocity_Limit")
MAX_POSITION_LIMIT = Register(48, 4, name="Max_Position_Limit")
MIN_POSITION_LIMIT = Register(52, 4, name="Min_Position_Limit")
SHUTDOWN = Register(63, 1, name="Shutdown")
TORQUE_ENABLE = Register(64, 1, name="Torque_Enable")
STATUS_RETURN_LEVEL = Register(68, 1, name="Status_Return_Level")
HARDWARE_ERROR = Register(70, 1, name="Hardware_Error_Status")
BUS_WATCHDOG = Register(98, 1, signed=True, name="Bus_Watchdog")
GOAL_PWM = Register(100, 2, signed=True, name="Goal_PWM")
GOAL_CURRENT = Register(102, 2, signed=True, name="Goal_Current")
PROFILE_ACCELERATION = Register(108, 4, name="Profile_Acceleration")
PROFILE_VELOCITY = Register(112, 4, name="Profile_Velocity")
GOAL_POSITION = Register(116, 4, signed=True, name="Goal_Position")
MOVING = Register(122, 1, name="Moving")
MOVING_STATUS = Register(123, 1, name="Moving_Status")
PRESENT_CURRENT = Register(126, 2, signed=True, name="Present_Current")
PRESENT_POSITION = Register(132, 4, signed=True, name="Present_Position")
PRESENT_VOLTAGE = Register(144, 2, name="Present_Input_Voltage")
PRESENT_TEMPERATURE = Register(146, 1, name="Present_Temperature")

#: Address range of the stored settings and the torque, read in one packet.
SETTINGS = 10, 65
#: Address range of all registers of a state, read in one packet.
STATE = 116, 147

#: Positions of one turn.
TICKS = 4096
RAD_PER_TICK = 2 * pi / TICKS
#: Middle of the travel, where the horn's angle is 0.
CENTRE_TICK = 2048
RAD_PER_S_PER_VELOCITY = 0.229 * 2 * pi / 60
WATCHDOG_STEP_S, MAX_WATCHDOG_STEPS = 0.02, 127
#: Bits of `DRIVE_MODE`: positions increase clockwise; `PROFILE_VELOCITY` is the duration of a
#: movement in milliseconds instead of its speed.
REVERSE, TIME_BASED = 0x01, 0x04
#: Value of `STATUS_RETURN_LEVEL` at which the servo acknowledges all requests.
ALL_REPLIES = 2
#: Goal PWM for the full supply voltage.
FULL_PWM = 885
#: Bit of `MOVING_STATUS`: the motion profile of the last goal is in progress.
PROFILE_ONGOING = 0x02


class Mode(IntEnum):
    """Values of `OPERATING_MODE` with position control."""

    POSITION = 3
    CURRENT_BASED_POSITION = 5


class HardwareError(IntFlag):
    """Bits of `HARDWARE_ERROR`; those that are set in `SHUTDOWN` too switch the torque off.

    Only a reboot clears them. By default an input voltage out of range leaves the torque on.
    """

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
