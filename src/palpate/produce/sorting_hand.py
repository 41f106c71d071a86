"""One item in the hand, and again: measured, and how long it took.

The second grasp of an item knows about how large it is, so the fingers wait near it instead of
opening fully. Another side of it may be thicker, so they stay well clear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from palpate.clock import Clock
from palpate.estimate.measurement import Measurement
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.sensor.array import PressureArray

#: How wide the fingers wait for an item whose size is known: more than produce is out of round.
_CLEAR_SHARE, _CLEAR_MM = 0.15, 4.0
#: A fast movement shakes the sheet; its rest values are taken after it has calmed down.
_CALM_S, _FRAME_S = 0.8, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemGrasp:
    """One grasp of one item.

    Attributes
    ----------
    outcome : Outcome
        How it ended.
    measured : mapping of str to Measurement
        What was measured, by name.
    lasted_s : float
        From the first movement until the hand was open again.
    decision_time_s, peak_force_n : float or None
        As in `GraspResult`.
    """

    outcome: Outcome
    measured: Mapping[str, Measurement]
    lasted_s: float
    decision_time_s: float | None = None
    peak_force_n: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SortingHand:
    """Devices of one rig, and the plan by which every item is grasped.

    Attributes
    ----------
    array, gripper, clock
        The devices.
    plan : Plan
        A gentle squeeze.
    """

    array: PressureArray
    gripper: Gripper
    clock: Clock
    plan: Plan

    def grasp(self, *, expected_mm: float | None = None) -> ItemGrasp:
        """Grasp what lies there; `expected_mm` is its size, where an earlier grasp knows it.

        Raises
        ------
        DeviceError
            If a device fails before the grasp begins; later failures are outcomes.
        """
        began_s = self.clock.now_s()
        result = run_grasp(
            self._near(expected_mm), array=self.array, gripper=self.gripper, clock=self.clock
        )
        return ItemGrasp(
            outcome=result.outcome,
            measured=_measured(result),
            lasted_s=self.clock.now_s() - began_s,
            decision_time_s=result.decision_time_s,
            peak_force_n=result.peak_force_n,
        )

    def _near(self, expected_mm: float | None) -> Plan:
        """Bring the fingers near an item of known size; return the plan that starts from there."""
        limits = self.plan.gripper
        if expected_mm is None or limits.drive != "width":
            return self.plan
        wait_mm = expected_mm * (1.0 + _CLEAR_SHARE) + _CLEAR_MM
        if wait_mm >= limits.highest:
            return self.plan
        self.gripper.command(GripperCommand(target=wait_mm, rate=self.plan.rate))
        way_mm = abs(limits.reported(self.gripper.state()) - wait_mm)
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
