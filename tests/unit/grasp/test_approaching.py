"""Contact after a fast approach, with a wait for the first contact's residual."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.conftest import calibrate_once
from tests.factories import draw, grasp_on_twin

from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import Outcome
from palpate.grasp.state import GraspState
from palpate.grasp.sweep import blind_time_s
from palpate.sensor.array import Frame
from palpate.twin.devices import TwinGripper
from palpate.twin.world import World


def test_approach_does_not_take_sheet_residual_for_contact(plan: Plan, bench: Any) -> None:
    """The sheet retains half of the first contact, which decays by half every second."""
    last = {"force_n": 0.0, "time_s": 0.0}

    def remembering(frame: Frame) -> Frame:
        if bench.force_n > 0:
            last.update(force_n=bench.force_n, time_s=frame.time_s)
            return frame
        left = 0.5 * last["force_n"] * 0.5 ** ((frame.time_s - last["time_s"]) / 1.0)
        return replace(frame, counts=np.rint(np.array(frame.counts) * (1 + 0.15 * left)))

    bench.change_frames(remembering)
    memories = list[GraspState]()

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.estimate.residual is not None and not memories:
            memories.append(grasp_state)

    result = bench.grasp(plan, watchers=[watch])
    memory = memories[0].estimate.residual
    assert memory.sheet_n > 0
    assert plan.dwell_s <= memories[0].estimate.still_s < 0.6
    assert result.size_mm.low <= bench.size_mm <= result.size_mm.high


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [15.0, 250.0])
def test_sweep_checks_for_contact_again_before_expected_size(rate_hz: float) -> None:
    calibration = calibrate_once(seed=5, level="lab", apart_from="strawberry")
    berry, requests = draw("strawberry", 11), Requests()
    world = World(berry, seed=11, sheet_seed=5, level="lab", frame_rate_hz=rate_hz)
    slowed = list[tuple[float, float]]()

    def watch(grasp_state: GraspState) -> None:
        sweep = grasp_state.estimate.sweep
        if sweep is not None and sweep.slowed and not slowed:
            left_mm = TwinGripper(world).state().width_mm - berry.size_mm
            slowed.append((left_mm / sweep.rate, blind_time_s(grasp_state.estimate.period_s)))
            requests.stop.set()

    views = {"watchers": [watch], "requests": requests}
    grasp_on_twin(world, calibration, views=views, expect_size_mm=berry.size_mm - 5.0)
    [(before_s, blind)] = slowed
    assert blind <= before_s < blind + 0.3


def test_sheet_with_unchanged_reading_after_retraction_ends_grasp(plan: Plan, bench: Any) -> None:
    """After the first contact every pixel flickers about a constant value."""
    stuck = list[np.ndarray]()

    def sticking(frame: Frame) -> Frame:
        if not stuck and bench.force_n < 1.0:
            return frame
        stuck.append(np.array(frame.counts) if not stuck else stuck[0])
        return replace(frame, counts=stuck[0] + frame.sequence % 3)

    bench.change_frames(sticking)
    bench.grasp_until(
        Outcome.SENSOR_LOST, plan, words="most of the contact force after the fingers retracted"
    )
    assert bench.force_n == 0.0
