"""Soft fingers: width of an item at contact, and number of loaded pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.measurement import Measurement
from palpate.sensor.array import SOFT_LAYOUT
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World
from palpate_station.answer_pixels import answer_pixel_percent
from palpate_station.ripeness.closing import ClosingWatch
from palpate_station.ripeness.firmness import RIPENESS_N, minus_log_sharing
from palpate_station.ripeness.shared_load import measure_shared_pixels
from palpate_studies.twin_avocado import draw_avocado

pytestmark = pytest.mark.slow

SIZES_MM = (58.0, 68.0)


@dataclass(frozen=True)
class SensedGrasp:
    result: GraspResult
    seen: list[Observation]
    measured: dict[str, Measurement]

    @property
    def minus_log_pixels(self) -> float:
        pixels = answer_pixel_percent(self.seen, result=self.result, layout=SOFT_LAYOUT)
        return minus_log_sharing(np.array(pixels, dtype=float))

    def shared_pixels(self, **other: Measurement) -> Measurement:
        measured = self.measured | other
        found = measure_shared_pixels(
            self.seen, result=self.result, layout=SOFT_LAYOUT, measured=measured
        )
        return found["shared_pixels"]


@cache
def on_sensor(seed: int) -> list[SensedGrasp]:
    """Return grasps of a small and a large fruit of equal stiffness."""
    calibration = calibrate_twin(seed=seed, level="lab", apart_from="avocado", kind="soft")
    fruit = draw_avocado(np.random.default_rng(3)).spot(0.0, rng=np.random.default_rng(4))
    found = []
    for size_mm in SIZES_MM:
        obj = replace(fruit, size_mm=size_mm, force_at_1mm_n=2.5)
        world = World(obj, seed=seed, level="lab", gripper="soft", frame_rate_hz=10.0)
        gripper, seen = TwinGripper(world), list[Observation]()
        plan = plan_grasp(calibration, gripper=gripper, target_force_n=RIPENESS_N, hold_s=0.0)
        plan = replace(plan, force_step_n=1.2)
        watch = ClosingWatch(plan)
        result = run_grasp(
            plan,
            array=TwinArray(world),
            gripper=gripper,
            clock=world.clock,
            subscribers=[seen.append],
            watchers=[watch.add_state],
        )
        measured = {"force_n": result.force_n} | watch.list_measurements()
        found.append(SensedGrasp(result=result, seen=seen, measured=measured))
    return found


def test_contact_width_interval_covers_the_true_width() -> None:
    covered = list[bool]()
    for seed in (6, 7, 8):
        small, large = widths = [sensed.measured["contact_mm"] for sensed in on_sensor(seed)]
        for size_mm, width in zip(SIZES_MM, widths, strict=True):
            assert width.low < width.value < width.high
            covered.append(width.low <= size_mm <= width.high)
        assert large.value - small.value == pytest.approx(SIZES_MM[1] - SIZES_MM[0], abs=1.5)
    # Intervals of 90 %: one of six may miss.
    assert sum(covered) >= 5


def test_shared_pixels_correction_reduces_the_effect_of_size() -> None:
    small, large = on_sensor(6)
    read = small.minus_log_pixels - large.minus_log_pixels
    corrected = [sensed.shared_pixels() for sensed in (small, large)]
    assert read > 0.05
    assert abs(math.log(corrected[1].value / corrected[0].value)) < 0.6 * read
    assert all(one.low <= one.value <= one.high for one in corrected)
