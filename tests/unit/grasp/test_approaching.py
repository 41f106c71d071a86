"""The touch after a way at speed: what the sheet remembers of the first one is waited for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.grasp.sweep import blind_s
from palpate.rig.simulated import calibrate_twin
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World


def test_what_a_sheet_remembers_is_no_touch(plan: Plan, bench: Any) -> None:
    """It keeps half of the first touch, and forgets half of that every second."""
    read, last = type(bench).read, {"force_n": 0.0, "time_s": 0.0}

    def remembering(*, timeout_s: float) -> Any:
        frame = read(bench, timeout_s=timeout_s)
        if bench.force_n > 0:
            last.update(force_n=bench.force_n, time_s=frame.time_s)
            return frame
        left = 0.5 * last["force_n"] * 0.5 ** ((frame.time_s - last["time_s"]) / 1.0)
        return replace(frame, counts=np.rint(np.array(frame.counts) * (1 + 0.15 * left)))

    bench.read = remembering
    memories = list[GraspState]()

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.estimate.residual is not None and not memories:
            memories.append(grasp_state)

    result = run_grasp(plan, array=bench, gripper=bench, clock=bench.clock, watchers=[watch])
    memory = memories[0].estimate.residual
    assert memory.reading > 0
    assert plan.dwell_s <= memories[0].estimate.still_s < 0.6
    assert result.size_mm.low <= bench.size_mm <= result.size_mm.high


@pytest.mark.slow
@pytest.mark.parametrize("level", ["lab", "field"])
def test_slowing_down_before_an_expected_size_is_no_touch(level: str) -> None:
    """Resistances rise with the speed of the fingers, and fall as they slow down or by noise."""
    calibration = calibrate_twin(seed=5, level=level, apart_from="strawberry")
    # So light that a finger which pushes it to the middle feels nothing.
    berry = replace(draw_object(np.random.default_rng(11), "strawberry"), mass_g=0.1)
    felt_s = dict[bool, list[float]]()
    for expected in (False, True):
        world = World(berry, seed=11, sheet_seed=5, level=level)
        gripper = TwinGripper(world)
        size_mm = berry.size_mm + 3.0 if expected else None
        plan = plan_grasp(calibration, gripper=gripper, expect_size_mm=size_mm)
        phases = list[tuple[str, float]]()

        def watch(grasp_state: GraspState, to: list[tuple[str, float]] = phases) -> None:
            if not to or grasp_state.activity != to[-1][0]:
                to.append((grasp_state.activity, grasp_state.estimate.now_s))

        run_grasp(
            plan, array=TwinArray(world), gripper=gripper, clock=world.clock, watchers=[watch]
        )
        felt_s[expected] = [time_s for phase, time_s in phases if phase == Activity.LOOK]
    assert len(felt_s[False]) == len(felt_s[True]) == 1
    assert felt_s[True][0] <= felt_s[False][0]


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [15.0, 250.0])
def test_a_hand_that_expects_a_size_feels_again_before_the_object_can_be_there(
    rate_hz: float,
) -> None:
    calibration = calibrate_twin(seed=5, level="lab", apart_from="strawberry")
    berry = draw_object(np.random.default_rng(11), "strawberry")
    world = World(berry, seed=11, sheet_seed=5, level="lab", frame_rate_hz=rate_hz)
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper, expect_size_mm=berry.size_mm - 5.0)
    slowed = list[tuple[float, float]]()

    def watch(grasp_state: GraspState) -> None:
        if (
            grasp_state.estimate.sweep is not None
            and grasp_state.estimate.sweep.slowed
            and not slowed
        ):
            left_mm = gripper.state().width_mm - berry.size_mm
            slowed.append(
                (left_mm / grasp_state.estimate.sweep.rate, blind_s(grasp_state.estimate.period_s))
            )

    run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock, watchers=[watch])
    [(before_s, blind)] = slowed
    assert blind <= before_s < blind + 0.3


def test_a_sheet_that_keeps_the_whole_touch_is_lost(plan: Plan, bench: Any) -> None:
    """From the first touch on every pixel flickers about one value, whatever the fingers do."""
    read, stuck = type(bench).read, list[np.ndarray]()

    def sticking(*, timeout_s: float) -> Any:
        frame = read(bench, timeout_s=timeout_s)
        if not stuck and bench.force_n < 1.0:
            return frame
        stuck.append(np.array(frame.counts) if not stuck else stuck[0])
        return replace(frame, counts=stuck[0] + frame.sequence % 3)

    bench.read = sticking
    result = run_grasp(plan, array=bench, gripper=bench, clock=bench.clock)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "reads as much after the fingers went back" in " ".join(result.faults)
    assert bench.force_n == 0.0


def entered_phases(plan: Plan, bench: Any) -> tuple[list[str], list[float]]:
    """Grasp, and return the phases in turn and the closures up to the hold."""
    phases, closures = list[str](), list[float]()

    def watch(grasp_state: GraspState) -> None:
        if not phases or grasp_state.activity != phases[-1]:
            phases.append(grasp_state.activity)
        if Phase.HOLD not in phases:
            closures.append(grasp_state.estimate.closure)

    result = run_grasp(plan, array=bench, gripper=bench, clock=bench.clock, watchers=[watch])
    assert result.outcome is Outcome.HELD
    return phases, closures


def test_a_gentle_touch_is_the_first_step_of_the_squeeze(plan: Plan, bench: Any) -> None:
    bench.n_per_mm = 0.4
    _, closures = entered_phases(plan, bench)
    assert (np.diff(closures) >= 0).all()


def test_a_firm_touch_is_left_and_met_again_close_to_where_it_was(plan: Plan, bench: Any) -> None:
    bench.n_per_mm = 10.0
    _, closures = entered_phases(plan, bench)
    ways = np.diff(closures)
    back = int(np.argmin(ways))
    met = closures[back]
    assert ways[back] < -plan.step
    again = closures[back + 1 :][int(np.argmax(ways[back + 1 :] > 0)) + 1]
    assert met - plan.step < again < met


def test_after_one_finger_the_other_is_sought_at_speed(plan: Plan, bench: Any) -> None:
    """The first finger touches two millimetres early and pushes the object to the middle."""
    read, size_mm = type(bench).read, bench.size_mm

    def pushing(*, timeout_s: float) -> Any:
        frame = read(bench, timeout_s=timeout_s)
        if bench.width_mm < size_mm + 2.0 and bench.force_n < 0.5:
            counts = np.array(frame.counts)
            counts[:2] = np.rint(1.05 * counts[:2])
            return replace(frame, counts=counts)
        return frame

    bench.read = pushing
    phases, _ = entered_phases(plan, bench)
    felt = phases.index(Activity.LOOK)
    assert phases[felt : felt + 3] == [Activity.LOOK, Activity.SWEEP, Activity.LOOK]


def test_a_touch_that_one_finger_feels_hardly_less_is_no_push(plan: Plan, bench: Any) -> None:
    """A sheet that is nearly blind to a newton: one finger just feels it, the other just not."""
    read, rest, size_mm = type(bench).read, list[np.ndarray](), bench.size_mm

    def faint(*, timeout_s: float) -> Any:
        frame = read(bench, timeout_s=timeout_s)
        counts = np.array(frame.counts)
        rest.append(counts)
        if bench.width_mm < size_mm and bench.force_n < 1.0:
            # Of a resistance of 9 kohm over 4.7, by 1.5 and 0.9 percent.
            counts = np.rint(rest[0] * np.repeat([1.010, 1.006], 4).reshape(4, 2))
        return replace(frame, counts=counts)

    bench.read, bench.n_per_mm = faint, 0.4
    phases, _ = entered_phases(plan, bench)
    felt = [n for n, phase in enumerate(phases) if phase == Activity.LOOK]
    assert phases[felt[0] + 1] == Activity.TOUCH
