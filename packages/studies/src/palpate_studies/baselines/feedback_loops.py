"""Baselines of force control: close to contact, correct with force feedback, lift.

`run_paper_loop` is the paper's proposal. Section 3.3 fits a line from the settled mean relative
change to the force (Table 4), and proposes to use its reading as feedback. The paper prints no such
loop. Here it has its strongest simple form: contact as in Figure 13, then secant corrections in
both directions until the line reads the target.

`run_learned_loop` is the same loop with all of palpate's readings as inputs. The learner corrects
the calibrated law of settled readings. Its training data come from the same loop with that law as
feedback, on other objects and other sensors of the level; the label is the true settled force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.force.line_law import LineForceLaw, fit_settled_line
from palpate.force.of_calibration import HORIZON_S
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.gripper.interface import GripperCommand
from palpate.sensor.sample import SampleReader, pixel_resistance_ohm, relative_change_percent
from palpate.settling.exponential import Exponential
from palpate.signal.relative import (
    CONTACT_PERCENT,
    finger_means,
    largest_change,
    mean_change,
    total_excess,
)
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import GripperKind, World
from palpate_studies.baselines.full_input_learners import LEARNERS, Predictor, learn
from palpate_studies.force_control_world import (
    GRASPS_PER_SHEET,
    LIFTED_S,
    GripOutcome,
    Task,
    calibration_of,
    is_damaged,
)
from palpate_studies.protocol.parts import Learned

#: Closing speed, mm/s or kPa/s, and reading time after each step of the approach.
_RATE: dict[GripperKind, float] = {"rigid": 20.0, "soft": 15.0}
_DWELL_S = 0.42
#: Step of the approach, mm or kPa, which is also the largest correction; and smallest correction,
#: the resolution of a servo or regulator.
STEP: dict[GripperKind, float] = {"rigid": 1.0, "soft": 0.8}
_SMALLEST_STEP: dict[GripperKind, float] = {"rigid": 0.05, "soft": 0.2}
#: Relative error that counts as on target, and largest number of corrections.
_TOLERANCE, _MAX_CORRECTIONS = 0.05, 12
PAPER_LINE = "the paper's line, exponential at 2.5 s"
#: Reading time of the exponential, and its frames.
READING_S, _FRAME_RATE_HZ = 2.5, 15
_FRAMES = int(READING_S * _FRAME_RATE_HZ)
#: Additional frames after a movement in the learners' inputs, the frame soon after it, and the
#: smallest force of the law, newtons.
_SHOWN, _EARLY, _SMALLEST_N = (2, 14, 24), 6, 0.05
#: Learner -> method.
LOOPS = {learner: f"{words}, as feedback at 2.5 s" for learner, words in LEARNERS.items()}
#: Learner -> trained law.
Laws: TypeAlias = Mapping[str, Learned[Predictor]]
#: From the closure and the servo current of the movement (mA) to the force, N.
ForceReader: TypeAlias = Callable[[float, float], float]
#: From array, gripper and rest values, shape (rows, cols), to a reader of the force.
MakeReader: TypeAlias = Callable[[TwinArray, TwinGripper, FloatArray], ForceReader]


def run_paper_loop(task: Task) -> GripOutcome:
    """Close to contact, then correct until the line reads the target, and lift."""
    law = _fit_line(task.seed // GRASPS_PER_SHEET, task.level, task.kind)

    def reader(array: TwinArray, _gripper: TwinGripper, rest_ohm: FloatArray) -> ForceReader:
        def force_n(_closure: float, _current_ma: float) -> float:
            ohm = read_ohm(array, seconds=READING_S, last=_FRAMES)
            change = mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
            return float(law.force_n(_forecast(change)).value)

        return force_n

    return correct_by_reading(task, name=PAPER_LINE, reader=reader)


@lru_cache(maxsize=4)
def _fit_line(sheet: int, level: str, kind: GripperKind) -> LineForceLaw:
    """Fit the line to the settled pairs of palpate's calibration."""
    return fit_settled_line(calibration_of(sheet, level, kind).force, horizon_s=HORIZON_S)


def _forecast(mean_percent: FloatArray) -> float:
    """Predict the settled change with the exponential from the frames since a movement."""
    time_s = np.arange(1, len(mean_percent) + 1) / _FRAME_RATE_HZ
    found = Exponential().predict(time_s, mean_percent[None], horizon_s=20.0, level=0.9)
    return float(np.asarray(found.value)[0])


def run_learned_loop(task: Task, learner: str, *, laws: Laws) -> GripOutcome:
    """Close to contact, then correct until the learned law reads the target, and lift."""
    predict = laws[learner].on([_sensor(task)])

    def factor(numbers: FloatArray, _law_n: float) -> float:
        return float(np.exp(predict(numbers[None])[0]))

    return correct_by_reading(task, name=LOOPS[learner], reader=_make_reader(task, factor))


def learn_laws(tasks: Sequence[Task]) -> Laws:
    """Grip training objects with the calibrated law, and learn its error factor."""
    training = [(task, *each) for task in tasks for each in collect_training_rows(task)]
    rows = np.array([numbers for _, numbers, _ in training])
    logs = [log for *_, log in training]
    seen = [_sensor(task) for task, *_ in training]
    return {name: learn(name, rows, targets=logs, seen=seen) for name in LEARNERS}


def collect_training_rows(task: Task) -> list[tuple[FloatArray, float]]:
    """Grip one object; return the inputs of each reading and ln(true / calibrated force).

    Readings without a grip force are skipped.
    """
    world, found = task.world(), list[tuple[FloatArray, float]]()

    def factor(numbers: FloatArray, law_n: float) -> float:
        settled_n = world.truth().force_n
        if settled_n > _SMALLEST_N:
            found.append((numbers, float(np.log(settled_n / law_n))))
        return 1.0

    correct_by_reading(
        task, name="the calibrated law", reader=_make_reader(task, factor), world=world
    )
    return found


def _sensor(task: Task) -> str:
    return f"{task.level} {task.seed // GRASPS_PER_SHEET}"


def _make_reader(task: Task, factor: Callable[[FloatArray, float], float]) -> MakeReader:
    """Return a reader of the calibrated law's force times a factor.

    `factor` is a function of the readings and of the law's force.
    """
    calibration = calibration_of(task.seed // GRASPS_PER_SHEET, task.level, task.kind)

    def reader(array: TwinArray, gripper: TwinGripper, rest_ohm: FloatArray) -> ForceReader:
        plan = plan_grasp(calibration, gripper=gripper)
        history = list[tuple[float, float]]()

        def force_n(closure: float, current_ma: float) -> float:
            read, law_n = _read_all(array, rest_ohm, plan)
            history.append((closure, law_n))
            (first, _), (last, last_n) = history[0], history[max(len(history) - 2, 0)]
            movement = [
                float(task.kind == "soft"),
                closure,
                closure - first,
                closure - last,
                law_n - last_n,
                float(len(history)),
                current_ma if np.isfinite(current_ma) else 0.0,
                0.0 if plan.compliance is None else float(plan.compliance.deflection_mm(law_n)),
            ]
            return law_n * factor(np.array([*movement, *read]), law_n)

        return force_n

    return reader


def _read_all(array: TwinArray, rest_ohm: FloatArray, plan: Plan) -> tuple[list[float], float]:
    """Read after a movement; return the readings and the settled force by the law."""
    ohm = read_ohm(array, seconds=READING_S, last=_FRAMES)
    ohm = np.maximum(ohm, plan.layout.divider.least_ohm)
    pixels = SampleReader(plan.layout, rest_ohm).read_ohm(ohm)
    change, excess = pixels.change_percent, pixels.excess
    reading = plan.law.read_settled(excess).force_n
    early_n, law_n = (max(float(reading[frame]), _SMALLEST_N) for frame in (_EARLY, -1))
    mean = mean_change(change)
    risen = np.log1p(np.maximum(reading, 0.0))
    return [
        float(np.log(law_n)),
        float(np.log(early_n)),
        float(np.log1p(max(float(total_excess(excess[-1])), 0.0))),
        float(mean[-1]),
        _forecast(mean),
        float(np.max(finger_means(change[-1], finger_of_row=plan.layout.finger_of_row))),
        float(largest_change(change[-1])),
        float(risen[-1]),
        *(float(risen[frame] - risen[-1]) for frame in _SHOWN),
    ], law_n


def correct_by_reading(
    task: Task, *, name: str, reader: MakeReader, world: World | None = None
) -> GripOutcome:
    """Close to contact, correct until the force reading is on target, lift and hold.

    `name`: name of the method. `world`: world of the task; created by default.
    """
    world = task.world() if world is None else world
    array, gripper, kind = TwinArray(world), TwinGripper(world), task.kind
    rest_ohm = read_ohm(array, seconds=0.5)
    touched = make_touch_check(array, world, rest_ohm)
    closed = close_until(world, gripper, touched, step=STEP[kind], kind=kind)
    touched_s, force_n = world.clock.now_s(), reader(array, gripper, rest_ohm)
    reading_n, step = force_n(closed, gripper.state().current_ma), STEP[kind] / 2
    on_target_s = None
    for _ in range(_MAX_CORRECTIONS):
        if abs(reading_n / task.target_n - 1.0) <= _TOLERANCE:
            on_target_s = world.clock.now_s() - touched_s
            break
        # Step towards the target within the limits of a correction.
        size = float(np.clip(abs(step), _SMALLEST_STEP[kind], STEP[kind]))
        step = size if task.target_n > reading_n else -size
        closed = float(np.clip(closed + step, 0.0, gripper.limits.span))
        current_ma = drive(world, gripper, closed, kind=kind)
        before_n, reading_n = reading_n, force_n(closed, current_ma)
        # Secant through the last two readings; a full step if the reading did not change.
        slope = (reading_n - before_n) / step
        step = (task.target_n - reading_n) / slope if slope > 1e-3 else STEP[kind]
    world.clock.sleep_s(1.0)
    world.lift()
    world.clock.sleep_s(LIFTED_S)
    world.force_n(world.now_s())
    return GripOutcome(
        task=task,
        method=name,
        outcome="lifted",
        lifted=True,
        dropped=world.has_dropped,
        force_n=world.truth().force_n,
        damaged=is_damaged(world, task),
        reported_n=reading_n,
        on_target_s=on_target_s,
    )


def make_touch_check(
    array: TwinArray, world: World, rest_ohm: FloatArray, *, both_fingers: bool = False
) -> Callable[[], bool]:
    """Return a function that reads the sheet and checks the paper's contact threshold.

    The threshold applies to the mean over all pixels (section 2.1), with `both_fingers` to the mean
    of each finger.
    """

    def is_touching() -> bool:
        change = relative_change_percent(read_ohm(array, seconds=_DWELL_S), rest_ohm=rest_ohm)
        if both_fingers:
            fingers = finger_means(change, finger_of_row=world.layout.finger_of_row)
            return bool(np.all(fingers <= CONTACT_PERCENT))
        return bool(mean_change(change) <= CONTACT_PERCENT)

    return is_touching


def read_ohm(array: TwinArray, *, seconds: float, last: int | None = None) -> FloatArray:
    """Read frames; return the mean resistance of the last three, or the `last` frames."""
    count = max(int(seconds * 15), 3)
    frames = [array.read(timeout_s=1.0) for _ in range(count)]
    used = frames[-3:] if last is None else frames[-last:]
    ohm = [pixel_resistance_ohm(f.counts, layout=array.layout, oversampling=1) for f in used]
    return np.asarray(np.mean(ohm, axis=0) if last is None else ohm)


def close_until(
    world: World,
    gripper: TwinGripper,
    done: Callable[[], bool],
    *,
    step: float,
    kind: GripperKind,
) -> float:
    """Close stepwise until `done` returns true or the hand is closed; return the closure."""
    closed = gripper.limits.closure(gripper.state())
    while closed < gripper.limits.span - step:
        closed += step
        drive(world, gripper, closed, kind=kind)
        if done():
            break
    return closed


def drive(world: World, gripper: TwinGripper, closure: float, *, kind: GripperKind) -> float:
    """Move to a closure and wait; return the servo current late in the movement, mA."""
    limits = gripper.limits
    closure = min(closure, limits.span)
    travel = abs(closure - limits.closure(gripper.state()))
    gripper.command(GripperCommand(target=limits.target(closure), rate=_RATE[kind]))
    world.clock.sleep_s(0.9 * travel / _RATE[kind])
    current_ma = gripper.state().current_ma
    world.clock.sleep_s(0.1 * travel / _RATE[kind] + 0.05)
    return current_ma
