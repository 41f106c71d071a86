"""Current force during random staircases of closing and opening, on sheets of the twin.

The baseline, boosted trees, is trained on other sheets that were calibrated and used in the same
way. Its inputs are the readings up to each frame and both calibrated laws; its target is the force
in newtons, as scored.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.calibrate.guided import Bench, measure_rest
from palpate.calibration import ForcePairs
from palpate.errors import CalibrationError
from palpate.force.force_follower import ForceFollower, ForceSource
from palpate.force.force_law import ForceLaw
from palpate.force.force_states import CONTACT_EXCESS
from palpate.force.of_calibration import HORIZON_S, fit_sheet_law, follow_force, pairs_at
from palpate.gripper.interface import GripperCommand
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import total_excess
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin, twin_bench
from palpate.twin.velostat import Sheet
from palpate.twin.world import World
from palpate_studies.baselines.full_input_learners import TREES, Predictor, learn
from palpate_studies.protocol.paired import compare, rms
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group
from palpate_studies.second.sheets import other_sheet

#: Lags of the readings in the trees' inputs, seconds; extremes are taken over the longest lag.
_AGO_S = (0.07, 0.14, 0.27, 0.54, 1.1, 2.2, 4.4)
#: Relative change of a moving reading, and the time in which it occurs, seconds.
_MOVED_FRACTION, _WITHIN_S = 0.05, 0.14
#: Test objects; none of them is a face of the load cell in the calibration.
GRASPED = ("ball-40lbs", "ball-55lbs", "springs-2", "springs-6", "tomato", "avocado-day-2")
#: A staircase: steps at the speed of a grasp, reversed at a lowest and a highest force; probability
#: of a closing step; and range of the log-uniform dwell times.
DURATION_S = 20.0
_STEP_MM, _RATE_MM_PER_S = 1.0, 3.5
_LOWEST_N, _HIGHEST_N, _CLOSING_PROBABILITY = 0.3, 12.0, 0.55
_DWELL_S = (0.2, 5.0)
#: Initial width, beyond the largest object, mm; approach speed; and force at contact.
_START_MM, _APPROACH_MM_PER_S, _TOUCH_N = 72.0, 10.0, 0.05
#: Smallest scored force.
LEAST_SCORED_N = 0.2
_FRAME_TIMEOUT_S = 2.0
#: Time, excess conductance of the pixels and reference force of one frame.
FrameRead: TypeAlias = tuple[float, FloatArray, float]
#: The same for all frames of a staircase.
Run: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
#: The law of the sheet without its history; the law with memory, learned on other sensors and
#: scaled with this
#: sensor's settled readings; the law of the sheet (`live --force`); and boosted trees with the
#: readings up to each frame and the law without history as inputs, trained on other sheets.
METHODS = ("settled", "memory", "now", TREES)
#: Baselines of `now`.
BASELINES = ("settled", "memory", TREES)
#: First test sheet of each generator, fixed before anything was scored on it. Earlier evaluations
#: used 60_000 to 60_059 and 61_000 to 61_059, and on the second generator 96_100 and later, 97_100
#: to 97_129 and 97_300 to 97_329. The law of the sheet was chosen on 3_100_000 to 3_100_011 of both
#: generators.
FIRST_SHEET, SECOND_SHEET = 62_000, 97_400
#: First training sheet of the trees, and number of training sheets; none of them is tested.
LEARNING_SHEET, LEARNED_FROM = 1_700_000, 60
_SECOND = (
    "Second generator: sheets whose conductance first rises steeply, then with the logarithm of "
    "the load, with hysteresis of a fixed force and creep that does not slow down."
)


def list_features(time_s: FloatArray, excess: FloatArray, *, pairs: ForcePairs) -> FloatArray:
    """Return the trees' inputs for each frame, shape (frames, numbers).

    Parameters
    ----------
    time_s : ndarray, shape (frames,)
        Times.
    excess : ndarray, shape (frames, rows, cols)
        Excess conductance of the pixels.
    pairs : ForcePairs
        Pairs of the sheet's calibration.
    """
    read = fit_sheet_law(pairs, layout=RIGID_LAYOUT).read_settled(excess).force_n
    log = np.log(np.maximum(read, 1e-3))
    total = total_excess(excess)
    strongest = excess.max(axis=(1, 2)) / np.maximum(total, 0.01)
    ago = [_reading_before(log, time_s, ago_s=ago_s) for ago_s in _AGO_S]
    recent = np.stack([log, *ago])
    return np.column_stack(
        [
            read,
            log,
            np.log1p(np.maximum(total, 0.0)),
            strongest,
            *(log - one for one in ago),
            recent.max(axis=0) - log,
            recent.min(axis=0) - log,
            _since_moved_s(log, time_s),
            time_s - time_s[0],
        ]
    )


def _reading_before(log: FloatArray, time_s: FloatArray, *, ago_s: float) -> FloatArray:
    """Return the reading `ago_s` earlier, or the first reading."""
    index = np.searchsorted(time_s, time_s - ago_s + 1e-6, side="right") - 1
    return np.asarray(log[np.maximum(index, 0)])


def _since_moved_s(log: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the time since the reading last moved, seconds."""
    moved = np.abs(log - _reading_before(log, time_s, ago_s=_WITHIN_S)) > _MOVED_FRACTION
    last_s = np.maximum.accumulate(np.where(moved, time_s, time_s[0]))
    return np.asarray(time_s - last_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedForce:
    """One method's estimates on a test staircase; arrays of shape (frames,)."""

    sensor: int
    force_n: FloatArray
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def is_covered(self) -> NDArray[np.bool_]:
        """Whether the interval covers the force."""
        return (self.low_n <= self.force_n) & (self.force_n <= self.high_n)


def follow_staircases(
    sensor: int,
    *,
    level: str,
    staircases: int,
    replace_sheet: Callable[[Sheet], Sheet] | None = None,
    trees: Learned[Predictor] | None = None,
) -> Mapping[str, list[FollowedForce]]:
    """Calibrate a sheet with a user's steps and track staircases on other objects.

    Returns method -> staircases. `replace_sheet`: as in `World`. `trees`: trained on other sheets,
    without an interval.
    """
    pairs, runs = _run_staircases(
        sensor, level=level, staircases=staircases, replace_sheet=replace_sheet
    )
    law = fit_sheet_law(pairs, layout=RIGID_LAYOUT)
    at_rest, known_n = pairs_at(pairs, since_move_s=HORIZON_S)
    read = at_rest > CONTACT_EXCESS
    memory = ForceLaw.fit(at_rest[read], force_n=known_n[read])
    found: dict[str, list[FollowedForce]] = {}
    for time_s, excess, force_n in runs:
        static = law.read_settled(excess)
        ends_n = law.interval_n(static.force_n, log_sd=static.log_sd)
        answers: dict[str, tuple[ArrayLike, ArrayLike, ArrayLike]] = {
            "settled": (static.force_n, *ends_n)
        }
        followers: dict[str, ForceSource] = {
            "memory": ForceFollower(memory),
            "now": follow_force(law),
        }
        for name, follower in followers.items():
            now = [follower.step(*one) for one in zip(time_s.tolist(), excess, strict=True)]
            answers[name] = (
                [one.value or 0.0 for one in now],
                [one.low or 0.0 for one in now],
                [one.high or np.inf for one in now],
            )
        if trees is not None:
            value_n = trees.on([str(sensor)])(list_features(time_s, excess, pairs=pairs))
            answers[TREES] = (value_n, value_n, value_n)
        scored = force_n > LEAST_SCORED_N
        for method, each in answers.items():
            value_n, low_n, high_n = (np.asarray(one)[scored] for one in each)
            found.setdefault(method, []).append(
                FollowedForce(
                    sensor=sensor,
                    force_n=force_n[scored],
                    value_n=value_n,
                    low_n=low_n,
                    high_n=high_n,
                )
            )
    return found


def learn_from_staircases(
    sensors: Sequence[int],
    *,
    level: str,
    staircases: int,
    replace_sheet: Callable[[Sheet], Sheet] | None = None,
) -> Learned[Predictor]:
    """Train trees on the staircases of some sheets; skip sheets that fail calibration."""
    rows, force_n, sheets = list[FloatArray](), list[float](), list[str]()
    for sensor in sensors:
        try:
            pairs, runs = _run_staircases(
                sensor, level=level, staircases=staircases, replace_sheet=replace_sheet
            )
        except CalibrationError:
            continue
        for time_s, excess, true_n in runs:
            used = true_n > LEAST_SCORED_N
            rows.append(list_features(time_s, excess, pairs=pairs)[used])
            force_n += true_n[used].tolist()
            sheets.append(str(sensor))
    return learn(TREES, np.concatenate(rows), targets=force_n, seen=sheets)


def _run_staircases(
    sensor: int, *, level: str, staircases: int, replace_sheet: Callable[[Sheet], Sheet] | None
) -> tuple[ForcePairs, list[Run]]:
    """Calibrate a sheet and run its staircases."""
    pairs = calibrate_twin(
        seed=sensor, level=level, apart_from="", replace_sheet=replace_sheet
    ).force
    rng = np.random.default_rng([sensor, 7])
    names = rng.choice(GRASPED, staircases, replace=False).tolist()
    world = World(
        None, seed=sensor + 2_000_006, sheet_seed=sensor, level=level, replace_sheet=replace_sheet
    )
    bench, runs = twin_bench(world, start=_START_MM), list[Run]()
    for name in names:
        rest_ohm = np.array(measure_rest(bench, duration_s=1.0).ohm)
        world.place(draw_object(rng, name))
        frames = zip(*_staircase(bench, rest_ohm=rest_ohm, rng=rng), strict=True)
        time_s, excess, force_n = map(np.array, frames)
        runs.append((time_s, excess, force_n))
    return pairs, runs


def _staircase(
    bench: Bench, *, rest_ohm: FloatArray, rng: np.random.Generator
) -> Iterator[FrameRead]:
    """Yield time, excess of the pixels and reference force of every frame."""
    gripper, cell = bench.gripper, bench.cell
    reader = SampleReader(bench.array.layout, rest_ohm)

    def frame() -> FrameRead:
        sample = reader.read(bench.array.read(timeout_s=_FRAME_TIMEOUT_S))
        return sample.time_s, sample.excess, cell.read_n()

    gripper.command(GripperCommand(target=gripper.limits.lowest, rate=_APPROACH_MM_PER_S))
    while gripper.state().moving and cell.read_n() < _TOUCH_N:
        yield frame()
    gripper.stop()
    ends_s = bench.clock.now_s() + DURATION_S
    while bench.clock.now_s() < ends_s:
        closes = cell.read_n() < _LOWEST_N or (
            cell.read_n() < _HIGHEST_N and bool(rng.random() < _CLOSING_PROBABILITY)
        )
        target = gripper.state().width_mm + (-_STEP_MM if closes else _STEP_MM)
        if target < gripper.limits.lowest:
            return
        gripper.command(GripperCommand(target=target, rate=_RATE_MM_PER_S))
        until_s = bench.clock.now_s() + float(np.exp(rng.uniform(*np.log(_DWELL_S))))
        while gripper.state().moving or bench.clock.now_s() < until_s:
            yield frame()


Runs = dict[str, dict[str, list[FollowedForce]]]


def report(
    *,
    sheets: Annotated[int, typer.Option(help="Sheets of each level.", min=1)] = 4,
    staircases: Annotated[int, typer.Option(help="Test staircases of each.", min=1, max=6)] = 2,
    second: SecondOption = False,
) -> StudyReport:
    """Track the force through staircases of 20 s with the laws of a calibration.

    Example: palpate study staircases --sheets 2
    """
    runs: Runs = {level: {name: [] for name in METHODS} for level in LEVELS}
    replace_sheet, first = (other_sheet, SECOND_SHEET) if second else (None, FIRST_SHEET)
    training = range(LEARNING_SHEET, LEARNING_SHEET + LEARNED_FROM)
    for level in LEVELS:
        trees = learn_from_staircases(
            training, level=level, staircases=staircases, replace_sheet=replace_sheet
        )
        for sensor in range(first, first + sheets):
            try:
                each = follow_staircases(
                    sensor,
                    level=level,
                    staircases=staircases,
                    replace_sheet=replace_sheet,
                    trees=trees,
                )
            except CalibrationError as error:
                # The guided steps refuse a sheet with a pixel at the end of its converter.
                sys.stderr.write(f"sheet {sensor}, {level}: refused: {error}\n")
                continue
            for name, some in each.items():
                runs[level][name] += some
    return _report(runs, sheets=sheets, staircases=staircases, second=second)


command = as_command(report)


def _summary(runs: Runs) -> list[dict[str, Any]]:
    return [
        {"level": level, "method": name, **_scores(each, runs[level]["settled"])}
        for level in LEVELS
        for name, each in runs[level].items()
        if each
    ]


def _scores(
    each: Sequence[FollowedForce], settled: Sequence[FollowedForce]
) -> dict[str, float | None]:
    logs = [np.log(np.maximum(one.value_n, 0.01) / one.force_n) for one in each]
    own = [log - np.median(log) for log in logs]
    half_n = np.concatenate([(one.high_n - one.low_n) / 2 for one in each])
    by_sheet = [_rms_n(mine) for _, mine in group(each, "sensor")]
    return {
        "rms_error_n": _rms_n(each),
        # A few sheets with large errors dominate the pooled RMS.
        "median_sheet_rms_n": float(np.median(by_sheet)),
        "share_of_settled": _rms_n(each) / _rms_n(settled),
        "rms_log_error": float(np.sqrt(np.mean(np.concatenate(logs) ** 2))),
        "rms_log_error_own_gain_out": float(np.sqrt(np.mean(np.concatenate(own) ** 2))),
        # The trees have no interval.
        "coverage": float(np.mean(np.concatenate([one.is_covered for one in each])))
        if half_n.any()
        else None,
        "mean_half_width_n": float(np.mean(half_n)) if half_n.any() else None,
    }


def _compare_baselines(runs: Runs) -> list[dict[str, Any]]:
    """Compare the RMS error of `now` with each baseline's on the same frames, by sheet."""
    return [
        row
        for level, each in runs.items()
        for row in compare(
            {name: _errors_n(each[name]) for name in ("now", *BASELINES) if each[name]},
            [str(one.sensor) for one in each["now"] for _ in one.force_n],
            ours="now",
            statistic=rms,
            level=level,
        )
    ]


def _rms_n(each: Sequence[FollowedForce]) -> float:
    return float(rms(_errors_n(each)))


def _errors_n(each: Sequence[FollowedForce]) -> FloatArray:
    return np.concatenate([one.value_n - one.force_n for one in each])


def _report(runs: Runs, *, sheets: int, staircases: int, second: bool) -> StudyReport:
    summary = _summary(runs)
    return StudyReport(
        name="staircases",
        title="Current force during random staircases of closing and opening (simulated)",
        provenance=(
            "Simulated: sheets of the twin, each calibrated once like the simulated rigs (a load "
            "cell with changing faces) and tested on other objects in another session. Steps of "
            "1 mm at 3.5 mm/s, dwells of 0.2-5 s, forces above 0.2 N. Sheets with saturated pixels "
            "are refused, reported on standard error and not scored.",
            "`own gain out` is the error without the median of each staircase, which corresponds "
            "to a known gain of the contact.",
            f"The trees are trained on staircases of {LEARNED_FROM} other sheets of the same level "
            f"and law (seeds from {LEARNING_SHEET} on). Their inputs are the forces of both laws, "
            "the readings of the last 4 s and the times. They have no interval.",
            *([_SECOND] if second else []),
        ),
        tables=[
            Table.of(
                f"Current force, {sheets} sheets per level, {staircases} staircases of 20 s each",
                summary,
            )
        ],
        payload={
            "second_generator": second,
            "summary": summary,
            "compared": _compare_baselines(runs),
            "sheets": sheets,
            "staircases": staircases,
        },
    )
