"""Simulated devices for the tests of the grasp: a spring between two fingers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.factories import fit_even_sheet

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.object.compliance import Compliance
from palpate.object.damage import DamageModel, fit_damage_model
from palpate.object.strength import ClosingCurve
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, Frame

REST_OHM = 9000.0
PERIOD_S = 1 / 15
GRIPPER_MM_PER_N = 0.2
#: The fingers are where they are sent before the next frame, and report that they were sent so.
_AT_ONCE_MM_PER_S = 2000.0
_VIEWS = ("subscribers", "watchers", "requests")


class Bench:
    """Array, gripper and clock of one spring. Excess conductance equals twice the force."""

    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    layout: ArrayLayout = RIGID_LAYOUT

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.size_mm, self.n_per_mm = 50.3, 2.0
        self.width_mm = self._seen_mm = 74.0
        self.sequence = -1
        self.commands: list[GripperCommand] = []
        self.stops = 0
        self.commanded_s = 0.0
        self.lost_after_s = float("inf")
        self.gone_after_s = float("inf")
        #: True force at each reading of the array.
        self.forces_n = list[float]()

    @property
    def force_n(self) -> float:
        return max(0.0, self.size_mm - self.width_mm) / (1 / self.n_per_mm + GRIPPER_MM_PER_N)

    def read(self, *, timeout_s: float) -> Frame:
        if self.clock.now_s() > self.gone_after_s:
            raise DeviceError("port /dev/ttyUSB0 vanished; plug it in again")
        if self.clock.now_s() > self.lost_after_s:
            self.clock.sleep_s(timeout_s)
            raise DeviceTimeoutError(f"no frame in {timeout_s:.2f} s; check the cable")
        self.clock.sleep_s(PERIOD_S)
        self.sequence += 1
        self.forces_n.append(self.force_n)
        ohm = REST_OHM / (1 + 2 * self.force_n / self.layout.pixels)
        # Every movement of the fingers shakes the sheet for a moment.
        shaken, self._seen_mm = self.width_mm != self._seen_mm, self.width_mm
        counts = np.rint(1024 * 4700 / (4700 + ohm)) + shaken * (self.sequence % 2)
        return Frame(
            time_s=self.clock.now_s(),
            sequence=self.sequence,
            counts=np.full((self.layout.rows, self.layout.cols), counts),
        )

    def state(self) -> GripperState:
        return GripperState(time_s=self.clock.now_s(), width_mm=self.width_mm)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        self.commands.append(wanted)
        self.commanded_s = self.clock.now_s()
        self.width_mm = wanted.target
        return replace(wanted, rate=_AT_ONCE_MM_PER_S)

    def stop(self) -> None:
        self.stops += 1

    def release(self) -> None:
        self.width_mm = self.limits.highest

    def close(self) -> None:
        pass

    def change_frames(self, change: Callable[[Frame], Frame]) -> None:
        """Read every frame from now on as `change` returns it."""
        read = self.read
        self.read = lambda *, timeout_s: change(read(timeout_s=timeout_s))  # type: ignore[method-assign]

    def grasp(self, plan: Plan, **more: Any) -> GraspResult:
        """Grasp the spring; `more` are views of the loop, and changes of the plan."""
        views = {name: more.pop(name) for name in _VIEWS if name in more}
        changed = replace(plan, **more)
        return run_grasp(changed, array=self, gripper=self, clock=self.clock, **views)

    def grasp_until(
        self, outcome: Outcome, plan: Plan, *, words: str | None = None, **more: Any
    ) -> GraspResult:
        """Grasp the spring; check the outcome, and the words of a fault, or that there is none."""
        result = self.grasp(plan, **more)
        assert result.outcome is outcome, result.faults
        assert words in " ".join(result.faults) if words is not None else result.faults == ()
        return result


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture(scope="session")
def plan() -> Plan:
    force = np.array([0.3, 0.6, 1.2, 2.5, 5.0, 10.0])
    compliance = Compliance.fit(force, width_mm=40 - GRIPPER_MM_PER_N * force, block_mm=40.0)
    return Plan(
        layout=RIGID_LAYOUT,
        rest_ohm=np.full((4, 2), REST_OHM),
        law=fit_even_sheet(RIGID_LAYOUT.pixels, force_n=force, scatter=0.02),
        compliance=replace(compliance, residual_mm=0.02),
        steepest_n=compliance.stiffest_n_per_mm,
        gripper=Bench.limits,
        rest_s=0.5,
    )


@pytest.fixture(scope="session")
def damage() -> DamageModel:
    """Damage model of springs that yield after about 1.5 mm."""
    rng = np.random.default_rng(3)
    paths, limits_n = [], []
    for stiffness in np.geomspace(0.5, 8.0, 24):
        limits_n.append(float(stiffness * 1.5 * np.exp(0.1 * rng.standard_normal())))
        curve, path = ClosingCurve(), []
        for x_mm in np.arange(0.05, limits_n[-1] / stiffness, 0.05):
            path += curve.push(float(x_mm), force_n=float(stiffness * x_mm))
        paths.append(path)
    return fit_damage_model(paths, rupture_force_n=limits_n, kinds=["spring"] * len(paths))
