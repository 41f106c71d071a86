"""Memory table of Feetech STS servos: the registers used by a gripper.

Source: Feetech, "SMS/STS series memory table" (STS3215). Values are little-endian; signed values
use sign-magnitude encoding.
"""

from __future__ import annotations

from enum import IntFlag
from math import pi

from palpate.gripper.packets import Register

MODEL_NUMBER = Register(3, 2, name="Model_Number")
RESPONSE_LEVEL = Register(8, 1, name="Response_Status_Level")
MIN_POSITION_LIMIT = Register(9, 2, name="Min_Position_Limit")
MAX_POSITION_LIMIT = Register(11, 2, name="Max_Position_Limit")
MAX_VOLTAGE_LIMIT = Register(14, 1, name="Max_Voltage_Limit")
MIN_VOLTAGE_LIMIT = Register(15, 1, name="Min_Voltage_Limit")
MAX_TORQUE_LIMIT = Register(16, 2, name="Max_Torque_Limit")
PHASE = Register(18, 1, name="Phase")
HOMING_OFFSET = Register(31, 2, sign_bit=11, name="Homing_Offset")
OPERATING_MODE = Register(33, 1, name="Operating_Mode")
TORQUE_ENABLE = Register(40, 1, name="Torque_Enable")
ACCELERATION = Register(41, 1, name="Acceleration")
GOAL_POSITION = Register(42, 2, sign_bit=15, name="Goal_Position")
GOAL_TIME = Register(44, 2, name="Goal_Time")
GOAL_VELOCITY = Register(46, 2, name="Goal_Velocity")
TORQUE_LIMIT = Register(48, 2, name="Torque_Limit")
PRESENT_POSITION = Register(56, 2, sign_bit=15, name="Present_Position")
PRESENT_VOLTAGE = Register(62, 1, name="Present_Voltage")
PRESENT_TEMPERATURE = Register(63, 1, name="Present_Temperature")
MOVING = Register(66, 1, name="Moving")
PRESENT_CURRENT = Register(69, 2, sign_bit=15, name="Present_Current")

#: Address range of the stored settings, read in one packet.
SETTINGS = 3, 34
#: Address range of all registers of a state, read in one packet.
STATE = 42, 71

TICKS = 4096
RAD_PER_TICK = 2 * pi / TICKS
#: The units are one tick per second (velocity), 6.5 mA (current) and 0.1 % (torque limit).
MA_PER_UNIT, FULL_TORQUE = 6.5, 1000
#: Largest goal velocity, of a servo at 12 V.
MAX_VELOCITY = 3400
#: Operating mode with position control.
POSITION_MODE = 0
#: Printed model name of each model number. These models have the same memory table.
MODELS = {777: "STS3215", 2825: "STS3250"}


class Phase(IntFlag):
    """Bits of `PHASE`."""

    #: The motor turns the other way.
    MOTOR_REVERSED = 0x01
    #: Velocities count one tick per second; otherwise 50.
    FINE_VELOCITY = 0x04
    #: Positions continue beyond one turn.
    COUNTS_TURNS = 0x10
    #: Positions increase the other way.
    POSITION_REVERSED = 0x80


class State(IntFlag):
    """Protection states of the servo, as bits in every reply."""

    VOLTAGE = 0x01
    ENCODER = 0x02
    OVERHEATING = 0x04
    OVERCURRENT = 0x08
    OVERLOAD = 0x20
