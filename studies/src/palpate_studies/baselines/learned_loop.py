"""A learned force law as feedback: the paper's loop, told everything that ours reads.

The learner corrects the calibrated law of settled readings. It learns from the same loop with that
law alone as feedback, on other things gripped by other sensors of the level, each reading with the
force that the hold settled to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.settling.exponential import Exponential
from palpate.signal.relative import (
    excess_conductance,
    finger_means,
    largest_change,
    mean_change,
    relative_change_percent,
    total_excess,
)
from palpate.twin.devices import TwinArray, TwinGripper
from palpate_studies.baselines.paper_loop import ForceReader, corrected
from palpate_studies.baselines.told_everything import LEARNERS, Answer, learned
from palpate_studies.force_control_baselines import read_ohm
from palpate_studies.force_control_grasps import Gripped, calibration_of
from palpate_studies.force_control_world import GRASPS_PER_SHEET, Task
from palpate_studies.protocol.parts import Learned

#: As long as the paper's exponential waits, and the frames of that.
_WAITS_S, _FRAME_RATE_HZ = 2.5, 15
_FRAMES = int(_WAITS_S * _FRAME_RATE_HZ)
#: Frames after a move whose readings are shown too, the one that a grasp of ours reads first, and
#: the least force of a law, newtons.
_SHOWN, _EARLY, _FAINT_N = (2, 14, 24), 6, 0.05
#: Learner -> method.
LOOPS = {learner: f"{words}, as feedback at 2.5 s" for learner, words in LEARNERS.items()}
#: By learner.
Laws: TypeAlias = Mapping[str, Learned[Answer]]
#: What was read, and the force by the calibrated law -> factor on that.
_Factor: TypeAlias = Callable[[FloatArray, float], float]


def learned_loop(task: Task, learner: str, *, laws: Laws) -> Gripped:
    """Close to contact, then correct until the learned law reads the target, and lift."""
    answer = laws[learner].on([_sensor(task)])

    def factor(numbers: FloatArray, _law_n: float) -> float:
        return float(np.exp(answer(numbers[None])[0]))

    return corrected(task, name=LOOPS[learner], reader=_reader(task, factor))


def learned_laws(tasks: Sequence[Task]) -> Laws:
    """Grip other things by the calibrated law alone, and learn by what factor it is off."""
    taught = [(task, *each) for task in tasks for each in _taught(task)]
    rows = np.array([numbers for _, numbers, _ in taught])
    logs = [log for *_, log in taught]
    seen = [_sensor(task) for task, *_ in taught]
    return {name: learned(name, rows, asked=logs, seen=seen) for name in LEARNERS}


def _taught(task: Task) -> list[tuple[FloatArray, float]]:
    """Return what each reading showed, and ln of the settled force over the calibrated law's.

    A hand that does not hold the thing yet teaches nothing.
    """
    world, found = task.world(), list[tuple[FloatArray, float]]()

    def factor(numbers: FloatArray, law_n: float) -> float:
        settled_n = world.truth().force_n
        if settled_n > _FAINT_N:
            found.append((numbers, float(np.log(settled_n / law_n))))
        return 1.0

    corrected(task, name="the calibrated law", reader=_reader(task, factor), world=world)
    return found


def _reader(
    task: Task, factor: _Factor
) -> Callable[[TwinArray, TwinGripper, FloatArray], ForceReader]:
    calibration = calibration_of(task.seed // GRASPS_PER_SHEET, task.level, task.kind)

    def reader(array: TwinArray, gripper: TwinGripper, rest_ohm: FloatArray) -> ForceReader:
        plan = plan_grasp(calibration, gripper=gripper)
        before = list[tuple[float, float]]()

        def force_n(closure: float, current_ma: float) -> float:
            read, law_n = _read(array, rest_ohm, plan)
            before.append((closure, law_n))
            (first, _), (last, last_n) = before[0], before[max(len(before) - 2, 0)]
            how = [
                float(task.kind == "soft"),
                closure,
                closure - first,
                closure - last,
                law_n - last_n,
                float(len(before)),
                current_ma if np.isfinite(current_ma) else 0.0,
                0.0 if plan.give is None else float(plan.give.give_mm(law_n)),
            ]
            return law_n * factor(np.array([*how, *read]), law_n)

        return force_n

    return reader


def _read(array: TwinArray, rest_ohm: FloatArray, plan: Plan) -> tuple[list[float], float]:
    """Wait after a move; return what the sheet shows, and the calibrated law's settled force."""
    ohm = read_ohm(array, seconds=_WAITS_S, last=_FRAMES)
    ohm = np.maximum(ohm, plan.layout.divider.least_ohm)
    change = relative_change_percent(ohm, rest_ohm=rest_ohm)
    excess = excess_conductance(ohm, rest_ohm=rest_ohm)
    reading = np.asarray(plan.reading.reading(excess), dtype=float)
    early_n, law_n = (
        max(float(law.force_n(reading[frame]).value), _FAINT_N)
        for law, frame in ((plan.early_law, _EARLY), (plan.settled_law, -1))
    )
    mean = mean_change(change)
    time_s = np.arange(1, _FRAMES + 1) / _FRAME_RATE_HZ
    forecast = Exponential().predict(time_s, mean[None], horizon_s=20.0, level=0.9).value
    risen = np.log1p(np.maximum(reading, 0.0))
    return [
        float(np.log(law_n)),
        float(np.log(early_n)),
        float(np.log1p(max(float(total_excess(excess[-1])), 0.0))),
        float(mean[-1]),
        float(np.asarray(forecast)[0]),
        float(np.max(finger_means(change[-1], finger_of_row=plan.layout.finger_of_row))),
        float(largest_change(change[-1])),
        float(risen[-1]),
        *(float(risen[frame] - risen[-1]) for frame in _SHOWN),
    ], law_n


def _sensor(task: Task) -> str:
    return f"{task.level} {task.seed // GRASPS_PER_SHEET}"
