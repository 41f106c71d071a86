"""A spring in a gripper with servo current, which corrects the force."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.force.servo_force import CurrentLaw, GearFriction
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety import SafetyLimits
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperState

GEARS = GearFriction(mean_ma=40.0, mean_sd_ma=0.5, movement_ma=0.0)
LAW = CurrentLaw(gears=GEARS, ma_per_n=16.0, noise_ma=6.0)


@pytest.fixture
def slow(bench: Any) -> Any:
    """A slow gripper with frames during its movements and with servo current.

    Its sheet reads `gain` times what it was calibrated to.
    """

    class Slow(type(bench)):  # type: ignore[misc]
        gain, reading = 1.0, False
        begun, way = (0.0, 74.0), GripperCommand(target=74.0, rate=60.0)
        rng = np.random.default_rng(3)

        @property
        def width_mm(self) -> float:
            since_s, from_mm = self.begun
            done_mm = (self.clock.now_s() - since_s) * self.way.rate
            whole_mm = self.way.target - from_mm
            return from_mm + float(np.sign(whole_mm)) * min(done_mm, abs(whole_mm))

        @width_mm.setter
        def width_mm(self, value: float) -> None:
            assert value == 74.0

        @property
        def force_n(self) -> float:
            true_n = float(super().force_n)
            return self.gain * true_n if self.reading else true_n

        def read(self, *, timeout_s: float) -> Any:
            self.reading = True
            frame = super().read(timeout_s=timeout_s)
            self.reading = False
            return frame

        def state(self) -> GripperState:
            moving = self.width_mm != self.way.target
            # At rest the gears hold any part of their friction, either way.
            gears_ma = 40.0 if moving else self.rng.uniform(-40, 40)
            current = gears_ma + 16.0 * self.force_n + 6.0 * self.rng.standard_normal()
            return GripperState(
                time_s=self.clock.now_s(), width_mm=self.width_mm, current_ma=current, moving=moving
            )

        def command(self, wanted: GripperCommand) -> GripperCommand:
            self.begun, self.way = (self.clock.now_s(), self.width_mm), wanted
            return wanted

    return Slow()


@pytest.mark.parametrize("gain", [0.6, 1.5])
def test_current_corrects_the_gain_of_the_sheet(plan: Plan, slow: Any, gain: float) -> None:
    """The gain of the sheet is uncertain by a third."""
    law, forces = replace(plan.law, noise=0.35, misfit=1.0), list[float]()
    slow.gain = gain

    def at_hold(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.HOLD:
            forces.append(slow.force_n)

    wishes = {"law": law, "target_force_n": 4.0, "current": LAW}
    result = slow.grasp_until(Outcome.HELD, plan, watchers=[at_hold], **wishes)
    assert forces[-1] == pytest.approx(4.0, rel=0.15)
    assert result.force_n.low <= forces[-1] <= result.force_n.high
    assert result.force_n.high / result.force_n.low < 1.6


@pytest.mark.parametrize("ceiling_n", [15.0, 8.0])
def test_excess_force_is_corrected_from_below_up_to_a_wider_opening_than_before(
    plan: Plan, slow: Any, ceiling_n: float
) -> None:
    """Something pushes the object thicker at the last step; the hand opens and closes again.

    It is one movement with a high ceiling, several with a low one.
    """
    stood, again, came = list[float](), list[float](), list[float]()
    eased_n, held_n = list[float](), list[float]()

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.activity is Activity.FORECAST:
            slow.size_mm = 51.0
            (came if again else stood).append(plan.gripper.target(grasp_state.estimate.sent))
        if grasp_state.activity is Activity.EASE:
            again.append(plan.gripper.target(grasp_state.correction.return_closure))
            eased_n.append(slow.force_n)
        if grasp_state.phase is Phase.HOLD:
            held_n.append(slow.force_n)

    safety = SafetyLimits(force_ceiling_n=ceiling_n)
    result = slow.grasp(plan, target_force_n=4.0, safety=safety, watchers=[watch])
    names = [moment.name for moment in result.moments if moment.finger is None]
    assert names.index("eased") < names.index("answer")
    assert min(eased_n) < 0.8 * 4.0
    assert min(again) > min(stood)
    assert came[0] == pytest.approx(again[0], abs=plan.resolution)
    assert held_n[-1] == pytest.approx(4.0, rel=0.1)
    assert result.force_n.value == pytest.approx(4.0, rel=0.1)
