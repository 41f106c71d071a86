"""Timed grasps of an item for sorting.

A sheet recovers from a load within seconds, a poor sheet within half a minute. Recovery during the
approach could hide the first contact or resemble a contact. Each grasp therefore waits until the
readings are stable.

For a second grasp the size is approximately known, so the fingers approach at full speed. Another
side may be thicker; a clearance allows for this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from palpate.arrays import FloatArray
from palpate.clock import Clock
from palpate.grasp.plan import Plan
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import Gripper
from palpate.measurement import Measurement
from palpate.recording.contents import Origin
from palpate.sensor.array import PressureArray
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import mean_change
from palpate_station.grasp_record import list_answers
from palpate_station.records import Grasp

#: Clearance as a fraction of the known size, larger than the out-of-roundness of produce.
_CLEARANCE_FRACTION = 0.15
#: The sheet is stable if two successive averages of this duration differ by at most this
#: percentage. The wait has a time limit.
_AVERAGE_S, _STABLE_PERCENT, _TIMEOUT_S = 1.0, 0.3, 20.0
_FRAME_TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedGrasp:
    """A grasp and its duration, including the wait for a stable sheet."""

    grasp: Grasp
    lasted_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SortingHand:
    """Devices of one rig, and the plan of every grasp."""

    #: The devices.
    array: PressureArray
    gripper: Gripper
    clock: Clock
    #: Plan of each grasp.
    plan: Plan
    #: Fields of the grasp records.
    rig: str
    origin: Origin
    calibration_id: str
    #: Returns the time for the records, with time zone.
    now: Callable[[], datetime]

    def grasp(self, item_id: str, *, expected: Measurement | None = None) -> TimedGrasp:
        """Grasp the item and return the timed record.

        `expected`: size from an earlier grasp.
        Raises `DeviceError` if a device fails before the grasp begins; later failures are outcomes.
        """
        start_s, taken_at = self.clock.now_s(), self.now()
        plan = self.plan
        if expected is not None:
            plan = replace(plan, expect_size_mm=expected.high * (1.0 + _CLEARANCE_FRACTION))
        self._wait_until_stable()
        result = run_grasp(plan, array=self.array, gripper=self.gripper, clock=self.clock)
        grasp = Grasp(
            item_id=item_id,
            taken_at=taken_at,
            rig=self.rig,
            drive=self.plan.gripper.drive,
            origin=self.origin,
            outcome=result.outcome,
            measurements=list_answers(result),
            decision_time_s=result.decision_time_s,
            peak_force_n=result.peak_force_n,
            calibration_id=self.calibration_id,
        )
        return TimedGrasp(grasp=grasp, lasted_s=self.clock.now_s() - start_s)

    def _wait_until_stable(self) -> None:
        """Wait until the sheet has recovered, with a time limit."""
        deadline_s = self.clock.now_s() + _TIMEOUT_S
        before = self._mean_ohm()
        while self.clock.now_s() < deadline_s:
            now = self._mean_ohm()
            reader = SampleReader(self.array.layout, before)
            change = mean_change(reader.read_ohm(now).change_percent)
            if not abs(float(change)) > _STABLE_PERCENT:
                return
            before = now

    def _mean_ohm(self) -> FloatArray:
        """Read frames for the averaging time and return each pixel's mean resistance."""
        until_s = self.clock.now_s() + _AVERAGE_S
        frames = [self.array.read(timeout_s=_FRAME_TIMEOUT_S)]
        while self.clock.now_s() < until_s:
            frames.append(self.array.read(timeout_s=_FRAME_TIMEOUT_S))
        ohm = FrameColumns.from_frames(frames).ohm(layout=self.array.layout)
        return np.asarray(ohm.mean(axis=0))
