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
from palpate.produce.answer_pixels import MEAN_S, answer_pixel_percent
from palpate.produce.ripeness.closing import ClosingWatch
from palpate.produce.ripeness.firmness import RIPENESS_N, minus_log_sharing
from palpate.produce.ripeness.shared_load import measure_shared_pixels
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.array import SOFT_LAYOUT
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World
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


def test_shared_pixels_are_corrected_by_at_most_the_cube_root_of_the_force() -> None:
    sensed, _ = on_sensor(6)
    force = sensed.measured["force_n"]
    harder = sensed.shared_pixels(force_n=replace(force, value=1.5 * force.value))
    # With 1.5 times the force, the corrected count falls with the exponent measured in the grasp.
    exponent = math.log(sensed.shared_pixels().value / harder.value) / math.log(1.5)
    assert 0.05 < exponent <= 1.0 / 3.0 + 1e-9


def test_shared_pixels_without_half_load_are_not_corrected() -> None:
    """Residual of the previous grasp recovers: all pixels except one fall below their rest."""
    sensed, _ = on_sensor(6)
    first = sensed.seen[0].frame
    answer_s = max(one.time_s for one in sensed.result.moments if one.name == "answer")
    rest = np.asarray(first.counts)
    moved = next(o.frame.counts for o in reversed(sensed.seen) if o.frame.time_s <= answer_s) - rest
    recovery = np.full(rest.shape, -0.1)
    recovery.flat[np.argmax(np.abs(moved))] = 0.05
    light = rest + recovery * moved
    seen = [
        replace(one, frame=replace(one.frame, counts=light))
        if first.time_s + MEAN_S < one.frame.time_s < answer_s - 1.0
        else one
        for one in sensed.seen
    ]
    corrected = replace(sensed, seen=seen).shared_pixels()
    assert corrected.value == pytest.approx(math.exp(-sensed.minus_log_pixels))
