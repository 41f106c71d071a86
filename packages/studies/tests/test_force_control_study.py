"""Scores and comparisons of the force control study, and its end by a stop signal."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from typing import Any

import pytest

from palpate_studies import force_control_world
from palpate_studies.baselines.feedback_loops import (
    LOOPS,
    collect_training_rows,
    learn_laws,
    run_learned_loop,
)
from palpate_studies.baselines.full_input_learners import RIDGE
from palpate_studies.force_control import compare_methods, grip_all, scores
from palpate_studies.force_control_world import (
    GripOutcome,
    draw_task,
    learn_damage,
)
from palpate_studies.protocol.parts import SeenBeforeError


def outcome(*, force_ratio: float, limited: bool = False) -> GripOutcome:
    one = draw_task(7, level="lab")
    return GripOutcome(
        task=one,
        method="ours",
        outcome="held",
        force_n=force_ratio * one.target_n,
        lifted=True,
        dropped=False,
        damaged=False,
        reported_n=one.target_n,
        low_n=0.9 * one.target_n,
        high_n=1.1 * one.target_n,
        limited=limited,
        on_target_s=2.0,
    )


def test_scores_of_known_grasps_are_exact() -> None:
    limited = outcome(force_ratio=0.5, limited=True)
    counted = scores([outcome(force_ratio=1.05), outcome(force_ratio=1.3), limited])
    assert (counted["aimed"], counted["limited"]) == (2, 1)
    assert counted["within_10_percent"] == 0.5
    assert counted["within_10_percent_of_all"] == counted["coverage"] == 1 / 3
    weak, strong = (
        replace(limited, task=replace(limited.task, obj=replace(limited.task.obj, yield_n=n)))
        for n in (0.5, 99.0)
    )
    counted = scores([weak, strong, strong])
    assert (counted["limited"], counted["limited_could_bear"], counted["could_bear"]) == (3, 2, 2)


@pytest.mark.slow
def test_learned_loop_rejects_training_sensors_and_grips_on_others() -> None:
    laws = learn_laws([draw_task(seed, level="lab") for seed in (700_000, 700_004, 700_008)])
    with pytest.raises(SeenBeforeError, match="lab 175000 was used"):
        run_learned_loop(draw_task(700_001, level="lab"), RIDGE, laws=laws)
    found = run_learned_loop(draw_task(700_016, level="lab"), RIDGE, laws=laws)
    assert found.method == LOOPS[RIDGE]
    assert found.reported_n == pytest.approx(found.task.target_n, rel=0.05)
    assert found.force_n == pytest.approx(found.task.target_n, rel=0.6)
    # The training holds are real grips, on which the calibrated law has an error of some percent.
    rows = collect_training_rows(draw_task(700_000, level="lab"))
    assert 1 <= len(rows) <= 13
    assert all(abs(log) < 1.0 for _, log in rows)


def test_compare_methods_uses_objects_gripped_by_both() -> None:
    near, far = outcome(force_ratio=1.0), outcome(force_ratio=1.5)
    other = replace(near, task=draw_task(8, level="lab"))
    (row,) = compare_methods([near, replace(far, method="rival"), other])
    assert (row["cases"], row["ours_near"], row["rival_near"]) == (1, 1.0, 0.0)
    assert row["difference"] == -1.0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_during_grasp_ends_study_with_hand_stopped(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(number)
    worlds = list[Any]()

    class Gripper(force_control_world.TwinGripper):
        def command(self, wanted: Any) -> Any:
            os.kill(os.getpid(), number)
            worlds.append(self)
            return super().command(wanted)

    monkeypatch.setattr(force_control_world, "TwinGripper", Gripper)
    tasks = [draw_task(seed, level="lab") for seed in (8, 9)]
    with pytest.raises(KeyboardInterrupt):
        list(grip_all(tasks, damage=learn_damage(seed=1), laws={}))
    assert len(worlds) == 1
    assert not worlds[0].state().moving
    assert signal.getsignal(number) is before
