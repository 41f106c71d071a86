"""Rest values of a grasp: climate, a loaded sheet, an object already held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.factories import draw, grasp_on_twin

from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.state import GraspState
from palpate.twin.rig import calibrate_twin
from palpate.twin.velostat import Environment
from palpate.twin.world import World

OLD, DRIFTED = "the calibration's rest values are used", "climate or wear changed the sheet"


def test_drifted_sheet_closes_finely_until_rest_is_verified_and_detects_no_early_touch(
    plan: Plan, bench: Any
) -> None:
    """The rest values were 20 % higher at calibration."""
    closures = list[float]()

    def watch(grasp_state: GraspState) -> None:
        closure = grasp_state.estimate.closure
        if grasp_state.attempt.rest_check_from is not None and closure not in closures:
            closures.append(closure)

    rest_ohm = 1.2 * plan.rest_ohm
    wishes = {"rest_ohm": rest_ohm, "watchers": [watch], "words": DRIFTED}
    result = bench.grasp_until(Outcome.HELD, plan, **wishes)
    assert abs(result.size_mm.value - 50.3) < 0.4
    assert 0.7 * plan.step <= max(closures) <= plan.step
    assert np.diff(closures).max() <= plan.fine_step + 1e-9


def test_object_already_between_the_fingers_is_detected_at_once(plan: Plan, bench: Any) -> None:
    bench.size_mm, bench.n_per_mm = 75.0, 3.0
    result = bench.grasp(plan)
    assert any(f"{OLD}: the reading rose" in fault for fault in result.faults)
    assert result.outcome is not Outcome.NOTHING_THERE


def test_rest_waits_until_the_sensor_is_released(plan: Plan, bench: Any) -> None:
    """A person holds the open fingers and releases them after 1.5 s."""
    size_mm = bench.size_mm
    bench.size_mm, bench.n_per_mm = 75.0, 3.0

    def let_go(observation: Observation) -> None:
        if observation.frame.time_s > 1.5:
            bench.size_mm = size_mm

    result = bench.grasp_until(Outcome.HELD, plan, subscribers=[let_go])
    assert abs(result.size_mm.value - size_mm) < 0.3


def test_sheet_never_at_rest_uses_calibrated_rest_values(plan: Plan, bench: Any) -> None:
    bench.n_per_mm = 3.0

    def worry(grasp_state: GraspState) -> None:
        if grasp_state.estimate.rest_ohm is None:
            bench.size_mm = 75.0 + 2.0 * (int(5.0 * bench.clock.now_s()) % 2)
        elif grasp_state.phase is Phase.APPROACH:
            bench.size_mm = 50.3

    bench.grasp_until(Outcome.HELD, plan, watchers=[worry], words=OLD)


@pytest.mark.slow
def test_field_sheet_in_another_climate_measures_the_size() -> None:
    """On a hot day, rest values are a third lower than at calibration."""
    calibration = calibrate_twin(seed=172, level="field", apart_from="strawberry")
    thing = draw("strawberry", 5)
    world = World(thing, seed=9171, sheet_seed=172, level="field")
    world.set_environment(Environment(temperature_c=47.0))
    result = grasp_on_twin(world, calibration)
    assert any(DRIFTED in fault for fault in result.faults)
    assert result.size_mm.low <= thing.size_mm <= result.size_mm.high
    assert abs(result.size_mm.value - thing.size_mm) < 1.0
