"""Conversion of palpate's types to standard messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import FluidPressure, Image, JointState

from palpate.gripper.interface import GripperState
from palpate.measurement import Measurement
from palpate.sensor.array import Frame
from palpate.sensor.findings import Severity
from palpate.sensor.health import Health

_LEVELS = {Severity.FAULT: DiagnosticStatus.ERROR, Severity.ADVICE: DiagnosticStatus.WARN}


def stamp_of(time_s: float, *, zero_unix_ns: int) -> Time:
    """Return a device time as a stamp."""
    sec, nanosec = divmod(zero_unix_ns + round(time_s * 1e9), 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def image(array: np.ndarray, *, encoding: str, stamp: Time, frame_id: str) -> Image:
    """Return pixels as an image with the rows and columns of the array."""
    message = Image(height=array.shape[0], width=array.shape[1], encoding=encoding)
    message.header.stamp, message.header.frame_id = stamp, frame_id
    message.step = array.shape[1] * array.itemsize
    message.data = array.tobytes()
    return message


def counts_image(frame: Frame, *, stamp: Time, frame_id: str) -> Image:
    """Return the raw counts; 10-bit conversions summed up to 64 times fit 16 bits."""
    return image(frame.counts.astype("<u2"), encoding="16UC1", stamp=stamp, frame_id=frame_id)


def ohm_image(ohm: np.ndarray, *, stamp: Time, frame_id: str) -> Image:
    """Return resistances as an image; inf for an open pixel."""
    return image(ohm.astype("<f4"), encoding="32FC1", stamp=stamp, frame_id=frame_id)


def wrench(force_n: float, *, stamp: Time, frame_id: str) -> WrenchStamped:
    """Return a force along the closing axis, z of the pad's frame."""
    message = WrenchStamped()
    message.header.stamp, message.header.frame_id = stamp, frame_id
    message.wrench.force.z = float(force_n)
    return message


def joint_state(state: GripperState, *, name: str, before: GripperState, stamp: Time) -> JointState:
    """Return the joint of a width drive, m and m/s; 0 at rest."""
    passed_s = state.time_s - before.time_s
    speed = (state.width_mm - before.width_mm) / passed_s if passed_s > 0 else 0.0
    message = JointState(name=[name], position=[state.width_mm / 1e3])
    message.velocity = [speed / 1e3 if state.moving else 0.0]
    # NaN means "not sensed", as in ros2_control; rosbags 0.11 rejects a trailing empty list.
    message.effort = [math.nan]
    message.header.stamp = stamp
    return message


def pressure(state: GripperState, *, stamp: Time, frame_id: str) -> FluidPressure:
    """Return the gauge pressure of a pressure drive, Pa."""
    message = FluidPressure(fluid_pressure=state.pressure_kpa * 1e3)
    message.header.stamp, message.header.frame_id = stamp, frame_id
    return message


def diagnosis(health: Health, *, name: str, hardware_id: str) -> DiagnosticStatus:
    """Return the health: the first finding as text, all findings as values."""
    worst = max((_LEVELS[found.severity] for found in health.findings), default=DiagnosticStatus.OK)
    first = next((found for found in health.findings), None)
    text = "ok" if first is None else f"{first.where}: {first.text}; {first.check}"
    values = {
        "rate_hz": f"{health.link.rate_hz:.1f}",
        "frames": str(health.link.frames),
        "lost": str(health.link.lost),
        **{f"{found.code} {found.where}": found.text for found in health.findings},
    }
    return status(worst, text, name=name, hardware_id=hardware_id, values=values)


def status(
    level: bytes, text: str, *, name: str, hardware_id: str, values: dict[str, str] | None = None
) -> DiagnosticStatus:
    """Return one diagnostic status."""
    pairs = [KeyValue(key=key, value=value) for key, value in (values or {}).items()]
    return DiagnosticStatus(
        level=level, name=name, message=text, hardware_id=hardware_id, values=pairs
    )


def build_measurement(kind: Any, name: str, found: Measurement | None) -> Any:
    """Return a measurement as a message of type `kind`; unknown numbers are NaN."""
    if found is None:
        nan = math.nan
        return kind(name=name, value=nan, low=nan, high=nan, level=nan, status="not_measured")
    numbers = {
        key: math.nan if (number := getattr(found, key)) is None else float(number)
        for key in ("value", "low", "high", "level")
    }
    return kind(name=name, unit=found.unit, status=str(found.status), **numbers)
