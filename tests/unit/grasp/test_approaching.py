"""The touch after a way at speed: what the sheet remembers of the first one is waited for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp


def test_a_sheet_that_remembers_is_waited_for(plan: Plan, bench: Any) -> None:
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
    memories = list[Belief]()

    def watch(belief: Belief) -> None:
        if belief.memory is not None and not memories:
            memories.append(belief)

    result = run_grasp(plan, array=bench, gripper=bench, clock=bench.clock, watchers=[watch])
    memory = memories[0].memory
    assert memory is not None
    blind_n = float(plan.early_law.force_n(0.0, level=plan.level).high)
    left_n = float(plan.early_law.force_n(memory.reading).value)
    assert left_n < 0.5 * blind_n
    assert plan.dwell_s < memories[0].still_s < 3.0
    assert result.size_mm is not None
    assert result.size_mm.low <= bench.size_mm <= result.size_mm.high


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
