"""One item in the hand, and again: measured, with the time that it took.

A sheet recovers from a load in seconds, a bad one in half a minute. Its recovery while the fingers
approach would hide the first contact, or resemble one; so each grasp waits until the sheet stands
still.

The second grasp of an item has its approximate size, so the fingers approach at full speed.
Another side of it may be thicker, so they stay well clear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from palpate.clock import Clock
from palpate.estimate.measurement import Measurement
from palpate.grasp.plan import Plan
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import Gripper
from palpate.produce.grasp_record import list_answers
from palpate.produce.records import Grasp
from palpate.recording.contents import Origin
from palpate.sensor.array import PressureArray
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import mean_change, relative_change_percent

#: An item may be thicker by this share from another side than its known size: produce is not more
#: out of round.
_CLEAR_SHARE = 0.15
#: The sheet stands still where two averages of this length differ by this little (as for
#: re-zeroing); it is given this much time.
_AVERAGE_S, _STILL_PERCENT, _LONGEST_S = 1.0, 0.3, 20.0
_FRAME_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedGrasp:
    """One grasp, and the time from its first movement until the hand was open again."""

    grasp: Grasp
    lasted_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SortingHand:
    """Devices of one rig, and the plan by which every item is grasped."""

    #: The devices.
    array: PressureArray
    gripper: Gripper
    clock: Clock
    #: By default a gentle squeeze.
    plan: Plan
    #: As they stand in the records of grasps.
    rig: str
    origin: Origin
    calibration_id: str
    #: Returns the time that records get, aware.
    now: Callable[[], datetime]

    def grasp(self, item_id: str, *, expected: Measurement | None = None) -> TimedGrasp:
        """Grasp the item; `expected`: its size by an earlier grasp.

        Raises `DeviceError` if a device fails before the grasp begins; later failures are outcomes.
        """
        began_s, taken_at = self.clock.now_s(), self.now()
        plan = self.plan
        if expected is not None:
            plan = replace(plan, expect_size_mm=expected.high * (1.0 + _CLEAR_SHARE))
        self._wait_for_rest()
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
        return TimedGrasp(grasp=grasp, lasted_s=self.clock.now_s() - began_s)

    def _wait_for_rest(self) -> None:
        """Wait until the sheet has recovered, or time is up."""
        give_up_s = self.clock.now_s() + _LONGEST_S
        before = self._mean_ohm(_AVERAGE_S)
        while self.clock.now_s() < give_up_s:
            now = self._mean_ohm(_AVERAGE_S)
            change = mean_change(relative_change_percent(now, rest_ohm=before))
            if not abs(float(change)) > _STILL_PERCENT:
                return
            before = now

    def _mean_ohm(self, duration_s: float) -> NDArray[np.float64]:
        """Read frames for a duration, leaving none queued for the grasp; return the mean."""
        until_s = self.clock.now_s() + duration_s
        found: list[NDArray[np.float64]] = []
        while self.clock.now_s() < until_s or not found:
            frame = self.array.read(timeout_s=_FRAME_S)
            found.append(
                pixel_resistance_ohm(
                    frame.counts, layout=self.array.layout, oversampling=frame.oversampling
                )
            )
        return np.asarray(np.mean(found, axis=0))
