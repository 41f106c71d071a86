"""Contact after a fast approach."""

from __future__ import annotations

import pytest
from tests.factories import draw, grasp_on_twin
from tests.fixtures import calibrate_once

from palpate.grasp.requests import Requests
from palpate.grasp.state import GraspState
from palpate.grasp.sweep import blind_time_s
from palpate.twin.devices import TwinGripper
from palpate.twin.world import World


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
