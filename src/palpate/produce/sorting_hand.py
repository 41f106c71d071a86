"""One item in the hand, and again: measured, and how long it took.

The second grasp of an item knows about how large it is, so the fingers wait near it instead of
opening fully. Another side of it may be thicker, so they stay well clear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from palpate.clock import Clock
from palpate.estimate.measurement import Measurement
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.produce.records import Grasp
from palpate.recording.contents import Origin
from palpate.sensor.array import PressureArray

#: How wide the fingers wait for an item whose size is known: more than produce is out of round.
_CLEAR_SHARE, _CLEAR_MM = 0.15, 4.0
#: A long movement shakes the sheet; its rest values are taken after it has calmed down.
_CALM_S, _FRAME_S = 0.8, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedGrasp:
    """One grasp, and the time from its first movement until the hand was open again."""

    grasp: Grasp
    lasted_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SortingHand:
    """Devices of one rig, and the plan by which every item is grasped.

    Attributes
    ----------
    array, gripper, clock
        The devices.
    plan : Plan
        A gentle squeeze.
    rig, origin, calibration_id
        As they stand in the records of grasps.
    began_at : datetime
        What the time was when the clock stood at 0.
    """

    array: PressureArray
    gripper: Gripper
    clock: Clock
    plan: Plan
    rig: str
    origin: Origin
    calibration_id: str
    began_at: datetime

    def grasp(self, item_id: str, *, expected: Measurement | None = None) -> TimedGrasp:
        """Grasp what lies there; `expected` is its size, where an earlier grasp knows it.

        Raises
        ------
        DeviceError
            If a device fails before the grasp begins; later failures are outcomes.
        """
        began_s = self.clock.now_s()
        taken_at = self.now()
        result = run_grasp(
            self._near(expected), array=self.array, gripper=self.gripper, clock=self.clock
        )
        grasp = Grasp(
            item_id=item_id,
            taken_at=taken_at,
            rig=self.rig,
            drive=self.plan.gripper.drive,
            origin=self.origin,
            outcome=result.outcome,
            measurements=_measured(result),
            decision_time_s=result.decision_time_s,
            peak_force_n=result.peak_force_n,
            calibration_id=self.calibration_id,
        )
        return TimedGrasp(grasp=grasp, lasted_s=self.clock.now_s() - began_s)

    def now(self) -> datetime:
        """Return the time, by this rig's clock."""
        return self.began_at + timedelta(seconds=self.clock.now_s())

    def _near(self, expected: Measurement | None) -> Plan:
        """Bring the fingers near an item of known size; return the plan that starts from there."""
        limits = self.plan.gripper
        if expected is None or limits.drive != "width":
            return self.plan
        wait_mm = expected.high * (1.0 + _CLEAR_SHARE) + _CLEAR_MM
        if wait_mm >= limits.highest:
            return self.plan
        way_mm = abs(limits.reported(self.gripper.state()) - wait_mm)
        self.gripper.command(GripperCommand(target=wait_mm, rate=self.plan.rate))
        until_s = self.clock.now_s() + way_mm / self.plan.rate + _CALM_S
        while self.clock.now_s() < until_s:
            # Read and let go, so that no old frame waits for the grasp.
            self.array.read(timeout_s=_FRAME_S)
        return replace(self.plan, gripper=replace(limits, highest=wait_mm))


def _measured(result: GraspResult) -> dict[str, Measurement]:
    found = {
        "settled_percent": result.settled_percent,
        "size_mm": result.size_mm,
        "force_n": result.force_n,
        "stiffness_n_per_mm": result.stiffness_n_per_mm,
    }
    return {name: value for name, value in found.items() if value is not None}
