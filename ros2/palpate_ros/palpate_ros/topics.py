"""Topics of a sensor: pixels, force with interval, opening, health, provenance."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import FluidPressure, Image, JointState
from std_msgs.msg import String

from palpate.calibration import Calibration
from palpate.errors import PalpateError
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingInfo
from palpate.recording.channels import encode_info
from palpate.sensor.array import Frame
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.health import MIN_FRAMES, check_health
from palpate.sensor.sample import Sample, SampleReader
from palpate.signal.relative import mean_change
from palpate_ros import messages
from palpate_ros.frame_force import FrameForce

#: Duration of the frames without contact in a health check, and mean change of a contact.
_CHECKED_S, _TOUCH_PERCENT = 4.0, -3.0
#: Time without frames after which the sensor is reported as silent.
_SILENT_S = 1.0
#: Raw counts are offered reliably with a queue of 250: a recorder requests all frames, a viewer the
#: newest (best effort).
_RELIABLE = QoSProfile(depth=250)
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Description of the messages.

    Attributes
    ----------
    info : RecordingInfo
        As in a recording; published once, latched, so that a bag can be converted to a recording.
    calibration : Calibration or None
        Without a calibration, no force is published.
    oversampling : int
        Conversions summed per pixel.
    frame_id : str
        Frame of the pad.
    joint : str
        Name of the hand's joint.
    """

    info: RecordingInfo
    calibration: Calibration | None
    oversampling: int
    frame_id: str
    joint: str = "palpate_gripper"


class SensorTopics:
    """Publishers of frames and health; a timer calls `diagnose`.

    Derived quantities are published with best effort, because a late force is useless. `info` is
    latched.
    """

    def __init__(self, node: Node, about: Provenance) -> None:
        self._node, self._about, self._lock = node, about, threading.Lock()
        known = about.calibration
        self._force = None if known is None else FrameForce(known)
        self._rest_ohm = None if known is None else known.rest_ohm
        self._reader = SampleReader(about.info.layout, self._rest_ohm)
        self._quiet: deque[Frame] = deque()
        self._received_s, self._fault, self._last = time.monotonic(), "", None
        create = node.create_publisher
        sensor = qos_profile_sensor_data
        self._counts = create(Image, "~/counts", _RELIABLE)
        self._ohm = create(Image, "~/resistance", sensor)
        self._forces = tuple(
            create(WrenchStamped, f"~/{name}", sensor)
            for name in ("force", "force_low", "force_high")
        )
        self._joints = create(JointState, "joint_states", 10)
        self._pressure = create(FluidPressure, "~/pressure", sensor)
        self._diagnostics = create(DiagnosticArray, "/diagnostics", 10)
        self._info = create(String, "~/info", _LATCHED)
        head = {**encode_info(about.info), "oversampling": str(about.oversampling)}
        self._info.publish(String(data=json.dumps(head)))

    def publish(self, frame: Frame, state: GripperState | None = None) -> None:
        """Publish a frame, and the state of the gripper if given."""
        about = self._about
        stamp = messages.stamp_of(frame.time_s, zero_unix_ns=about.info.clock_zero_unix_ns)
        at = {"stamp": stamp, "frame_id": about.frame_id}
        self._counts.publish(messages.counts_image(frame, **at))
        sample = self._reader.read(frame)
        if self._ohm.get_subscription_count():
            self._ohm.publish(messages.ohm_image(sample.resistance_ohm, **at))
        if self._force is not None:
            # Also without a subscriber: the law needs every frame.
            limits_n = self._force.limits_n(sample)
            for publisher, force_n in zip(self._forces, limits_n, strict=False):
                publisher.publish(messages.wrench(force_n, **at))
        if state is not None:
            self._publish_state(state, **at)
        self._store_quiet_frame(frame, sample)

    def fail(self, text: str) -> None:
        """Report a fault of the equipment until the next frame."""
        with self._lock:
            self._fault = text

    def diagnose(self) -> None:
        """Publish the health of the sensor."""
        now = self._node.get_clock().now().to_msg()
        array = DiagnosticArray(status=[self._diagnose()])
        array.header.stamp = now
        self._diagnostics.publish(array)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in (
            *(self._counts, self._ohm, self._joints, self._pressure, self._diagnostics),
            *(*self._forces, self._info),
        ):
            self._node.destroy_publisher(publisher)

    def _publish_state(self, state: GripperState, **at: object) -> None:
        if np.isfinite(state.width_mm):
            before = self._last or state
            self._joints.publish(
                messages.joint_state(
                    state, name=self._about.joint, before=before, stamp=at["stamp"]
                )
            )
        elif np.isfinite(state.pressure_kpa):
            self._pressure.publish(messages.pressure(state, **at))
        self._last = state

    def _store_quiet_frame(self, frame: Frame, sample: Sample) -> None:
        """Store the latest frames without contact, for the health check."""
        touched = False
        if self._rest_ohm is not None:
            change = mean_change(sample.change_percent)
            touched = bool(np.nan_to_num(change) < _TOUCH_PERCENT)
        with self._lock:
            self._received_s, self._fault = time.monotonic(), ""
            if touched or (self._quiet and frame.oversampling != self._quiet[0].oversampling):
                self._quiet.clear()
            if not touched:
                self._quiet.append(frame)
            while self._quiet and frame.time_s - self._quiet[0].time_s > _CHECKED_S:
                self._quiet.popleft()

    def _diagnose(self) -> DiagnosticStatus:
        name = f"{self._node.get_name()}: sensor"
        names = {"name": name, "hardware_id": self._about.info.rig or "palpate"}
        with self._lock:
            silent_s = time.monotonic() - self._received_s
            fault, quiet = self._fault, list(self._quiet)
        if fault or silent_s > _SILENT_S:
            text = fault or f"no frame for {silent_s:.1f} s; check cable, power and `palpate ports`"
            return messages.status(DiagnosticStatus.ERROR, text, **names)
        if len(quiet) < MIN_FRAMES:
            return messages.status(
                DiagnosticStatus.OK, "contact, or just started; the pixels are not checked", **names
            )
        try:
            health = check_health(
                FrameColumns.from_frames(quiet),
                layout=self._about.info.layout,
                known_ohm=self._rest_ohm,
            )
        except PalpateError as error:
            return messages.status(DiagnosticStatus.ERROR, str(error), **names)
        return messages.diagnosis(health, **names)
