"""A series of grasps of one object: what it tells, and what ends it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from palpate.errors import CalibrationError
from palpate.grasp.belief import Belief
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.runner import Watcher
from palpate.grasp.series import GRASPS, PAUSE_S, Series, SeriesGrasp, run_series, targets_n

from .conftest import Bench

UP_TO_N = 8.0


def series_of(bench: Bench, plan: Plan, *watchers: Watcher) -> tuple[Series, list[SeriesGrasp]]:
    """Run a series on the bench; return it and what was told on the way."""
    told: list[SeriesGrasp] = []
    series = run_series(
        plan,
        up_to_n=UP_TO_N,
        array=bench,
        gripper=bench,
        clock=bench.clock,
        told=told.append,
        watchers=watchers,
    )
    return series, told


def test_it_tells_the_spring_and_every_grasp_of_it(bench: Bench, plan: Plan) -> None:
    series, told = series_of(bench, plan)

    assert series.grasps == tuple(told)
    assert [one.target_force_n for one in told] == list(targets_n(UP_TO_N))
    assert len(series.held) == GRASPS
    found, at = series.stiffness_n_per_mm, series.firmest_force_n
    assert found is not None
    assert at is not None
    assert found.low < bench.n_per_mm < found.high
    assert at.value == pytest.approx(UP_TO_N, rel=0.1)


def test_the_hand_stands_open_between_grasps(bench: Bench, plan: Plan) -> None:
    began_s: list[float] = []
    ended_s: list[float] = []

    def see(belief: Belief) -> None:
        if belief.frames == 1:
            began_s.append(belief.now_s)
            assert bench.width_mm == bench.limits.highest
        if belief.phase is Phase.STOPPED:
            ended_s.append(belief.now_s)

    series_of(bench, plan, see)

    pauses_s = [after - before for before, after in zip(ended_s, began_s[1:], strict=False)]
    assert len(pauses_s) == GRASPS - 1
    assert min(pauses_s) >= PAUSE_S


def test_an_object_that_was_taken_ends_it(bench: Bench, plan: Plan) -> None:
    grasps = 0

    def take(belief: Belief) -> None:
        nonlocal grasps
        grasps += belief.frames == 1
        if grasps == 3:
            bench.size_mm = 0.0

    series, _ = series_of(bench, plan, take)

    outcomes = [one.result.outcome for one in series.grasps]
    assert outcomes == [Outcome.HELD, Outcome.HELD, Outcome.NOTHING_THERE]
    assert series.stiffness_n_per_mm is None


def test_a_light_grasp_that_slips_does_not_end_it(bench: Bench, plan: Plan) -> None:
    slipped = False

    def slip(belief: Belief) -> None:
        nonlocal slipped
        if belief.phase is Phase.HOLD and not slipped:
            bench.size_mm, slipped = bench.size_mm - 20.0, True
        elif belief.phase is Phase.RELEASE and bench.size_mm < 40.0:
            bench.size_mm += 20.0

    series, _ = series_of(bench, replace(plan, hold_s=3.0), slip)

    outcomes = [one.result.outcome for one in series.grasps]
    assert outcomes == [Outcome.SLIPPED] + [Outcome.HELD] * 4
    found = series.stiffness_n_per_mm
    assert found is not None
    assert found.low < bench.n_per_mm < found.high


@pytest.mark.parametrize("after_s", [5.0, PAUSE_S + 3.0])
def test_a_lost_sensor_ends_it_and_the_result_says_so(
    bench: Bench, plan: Plan, after_s: float
) -> None:
    def lose(belief: Belief) -> None:
        if belief.phase is Phase.RELEASE and bench.lost_after_s == float("inf"):
            bench.lost_after_s = belief.now_s + after_s

    series, told = series_of(bench, plan, lose)

    assert told[-1].result.outcome is Outcome.SENSOR_LOST
    assert "no frame" in " ".join(told[-1].result.faults)
    assert len(series.grasps) == 2


def test_fingers_whose_pressure_tells_no_width_are_refused(bench: Bench, plan: Plan) -> None:
    with pytest.raises(CalibrationError, match="driven by width"):
        series_of(bench, replace(plan, give=None))
    assert bench.commands == []


@pytest.mark.parametrize("up_to_n", [1.0, 2.5, 4.0, 12.0])
def test_targets_rise_evenly_to_the_firmest(up_to_n: float) -> None:
    targets = targets_n(up_to_n)

    assert len(targets) == GRASPS
    assert targets[-1] == up_to_n
    assert targets[0] >= min(1.5, up_to_n / 2)
    assert all(after > before for before, after in pairwise(targets))
