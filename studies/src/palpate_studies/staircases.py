"""Force now during random staircases of closing and opening, on sheets of the twin.

Boosted trees learn newtons, for newtons are scored, on other sheets that were calibrated and used
in the same way, from the readings up to each frame and both calibrated laws.
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
from palpate.calibrate.laws import DWELL_S, HORIZON_S, force_now, laws_of, laws_with_memory
from palpate.errors import CalibrationError
from palpate.estimate.force_follower import ForceFollower, ForceSource
from palpate.estimate.force_now import ForceNow
from palpate.gripper.interface import GripperCommand
from palpate.rig.simulated import calibrate_twin, twin_bench
from palpate.sensor.calibration import ForcePairs
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import excess_conductance, total_excess
from palpate.twin.objects import draw_object
from palpate.twin.velostat import Sheet
from palpate.twin.world import World
from palpate_studies.baselines.full_input_learners import TREES, Answer, learn
from palpate_studies.protocol.paired import compare, rms
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group
from palpate_studies.second.sheets import other_sheet

#: Readings this long ago are shown, and the extremes within the last one, seconds.
_AGO_S = (0.07, 0.14, 0.27, 0.54, 1.1, 2.2, 4.4)
#: A reading that changed by this share within the second of those times has moved.
_MOVED_FRACTION, _WITHIN_S = 0.05, 0.14
#: What is grasped after the calibration: no name is among the faces of the load cell.
GRASPED = ("ball-40lbs", "ball-55lbs", "springs-2", "springs-6", "tomato", "avocado-day-2")
#: A staircase: steps at a grasp's speed, turned back at these forces; dwells are drawn from a
#: range, uniformly in the logarithm, directions closing a little more often than not.
DURATION_S = 20.0
_STEP_MM, _RATE_MM_PER_S = 1.0, 3.5
_LOWEST_N, _HIGHEST_N, _CLOSING_PROBABILITY = 0.3, 12.0, 0.55
_DWELL_S = (0.2, 5.0)
#: Opening beyond the largest object, mm; how fast contact is looked for, and from which force on
#: the cell feels it.
_START_MM, _APPROACH_MM_PER_S, _TOUCH_N = 72.0, 10.0, 0.05
#: Smaller forces are not scored.
LEAST_SCORED_N = 0.2
_FRAME_TIMEOUT_S = 2.0
#: Time, excess conductance of the pixels and reference force of one frame.
FrameRead: TypeAlias = tuple[float, FloatArray, float]
#: The same of a staircase, an array of frames each.
Run: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
#: The law of settled readings; both laws, by the time since the reading moved; the law with memory,
#: of other sensors, by the settled readings of this one; the mean of the last two in ln force
#: (`live --force`); and boosted trees given all that these read, learned on other sheets.
METHODS = ("settled", "by_time", "memory", "now", TREES)
#: What `now` is compared with.
RIVALS = ("settled", "by_time", TREES)
#: The first sheet that is tested, written down before anything was scored on it; used before:
#: 60_000 to 60_059 and 61_000 to 61_059, of the second generator 96_100 on, 97_100 to 97_129 and
#: 97_300 to 97_329. The mean of two laws was chosen on 2_500_000 to 2_500_009 of both.
FIRST_SHEET, SECOND_SHEET = 62_000, 97_400
#: Sheets that the trees learn from; none of them is tested.
LEARNING_SHEET, LEARNED_FROM = 1_700_000, 60
_SECOND = (
    "Second generator: sheets whose conductance rises steeply, then with the logarithm of the load "
    "only, with play of a fixed force, and creep that does not slow down."
)


def list_features(time_s: FloatArray, excess: FloatArray, *, pairs: ForcePairs) -> FloatArray:
    """Return what each frame and those before it show, shape (frames, numbers).

    Parameters
    ----------
    time_s : ndarray, shape (frames,)
        Times.
    excess : ndarray, shape (frames, rows, cols)
        Excess conductance of the pixels.
    pairs : ForcePairs
        Of the sheet's calibration.
    """
    reading, early, settled, _ = laws_of(pairs)
    read = np.asarray(reading.reading(excess), dtype=float)
    log = np.log(np.maximum(read, 1e-3))
    total = total_excess(excess)
    strongest = excess.max(axis=(1, 2)) / np.maximum(total, 0.01)
    forces_n = [np.asarray(law.force_n(read).value) for law in (early, settled)]
    ago = [_reading_before(log, time_s, ago_s=ago_s) for ago_s in _AGO_S]
    recent = np.stack([log, *ago])
    return np.column_stack(
        [
            *forces_n,
            *np.log(np.maximum(forces_n, 0.01)),
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
    """Return the reading some time ago, or the first one."""
    index = np.searchsorted(time_s, time_s - ago_s + 1e-6, side="right") - 1
    return np.asarray(log[np.maximum(index, 0)])


def _since_moved_s(log: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the time since the reading last moved, seconds."""
    moved = np.abs(log - _reading_before(log, time_s, ago_s=_WITHIN_S)) > _MOVED_FRACTION
    last_s = np.maximum.accumulate(np.where(moved, time_s, time_s[0]))
    return np.asarray(time_s - last_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedForce:
    """One test staircase of a sensor as one method followed it; arrays of shape (frames,)."""

    sensor: int
    force_n: FloatArray
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def is_covered(self) -> NDArray[np.bool_]:
        """Whether the interval held the force."""
        return (self.low_n <= self.force_n) & (self.force_n <= self.high_n)


def follow_staircases(
    sensor: int,
    *,
    level: str,
    staircases: int,
    remade: Callable[[Sheet], Sheet] | None = None,
    trees: Learned[Answer] | None = None,
) -> Mapping[str, list[FollowedForce]]:
    """Calibrate a sheet as a user does and follow staircases on other objects, by method.

    `remade`: as in `World`. `trees`: learned on other sheets; they give no interval.
    """
    pairs, runs = _run_staircases(sensor, level=level, staircases=staircases, remade=remade)
    laws = laws_with_memory(pairs)
    assert laws.memory is not None
    found: dict[str, list[FollowedForce]] = {}
    for time_s, excess, force_n in runs:
        static = laws.settled.force_n(laws.reading.reading(excess))
        answers: dict[str, tuple[ArrayLike, ArrayLike, ArrayLike]] = {
            "settled": (static.value, static.low, static.high)
        }
        followers: dict[str, ForceSource] = {
            "by_time": ForceNow(laws._replace(memory=None), early_s=DWELL_S, settled_s=HORIZON_S),
            "memory": ForceFollower(laws.memory),
            "now": force_now(pairs),
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
        felt = force_n > LEAST_SCORED_N
        for method, each in answers.items():
            value_n, low_n, high_n = (np.asarray(one)[felt] for one in each)
            found.setdefault(method, []).append(
                FollowedForce(
                    sensor=sensor,
                    force_n=force_n[felt],
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
    remade: Callable[[Sheet], Sheet] | None = None,
) -> Learned[Answer]:
    """Learn the force now from staircases of some sheets; those that are refused teach nothing."""
    rows, force_n, sheets = list[FloatArray](), list[float](), list[str]()
    for sensor in sensors:
        try:
            pairs, runs = _run_staircases(sensor, level=level, staircases=staircases, remade=remade)
        except CalibrationError:
            continue
        for time_s, excess, true_n in runs:
            felt = true_n > LEAST_SCORED_N
            rows.append(list_features(time_s, excess, pairs=pairs)[felt])
            force_n += true_n[felt].tolist()
            sheets.append(str(sensor))
    return learn(TREES, np.concatenate(rows), asked=force_n, seen=sheets)


def _run_staircases(
    sensor: int, *, level: str, staircases: int, remade: Callable[[Sheet], Sheet] | None
) -> tuple[ForcePairs, list[Run]]:
    """Return a sheet's calibration and its staircases."""
    pairs = calibrate_twin(seed=sensor, level=level, apart_from="", remade=remade).force
    rng = np.random.default_rng([sensor, 7])
    names = rng.choice(GRASPED, staircases, replace=False).tolist()
    world = World(None, seed=sensor + 2_000_006, sheet_seed=sensor, level=level, remade=remade)
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
    gripper, cell, layout = bench.gripper, bench.cell, bench.array.layout

    def frame() -> FrameRead:
        seen = bench.array.read(timeout_s=_FRAME_TIMEOUT_S)
        ohm = pixel_resistance_ohm(seen.counts, layout=layout, oversampling=seen.oversampling)
        known = np.maximum(ohm, layout.divider.least_ohm)
        return seen.time_s, excess_conductance(known, rest_ohm=rest_ohm), cell.read_n()

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
    """Follow the force through staircases of 20 s with the laws of a calibration.

    Example: palpate study staircases --sheets 2
    """
    runs: Runs = {level: {name: [] for name in METHODS} for level in LEVELS}
    remade, first = (other_sheet, SECOND_SHEET) if second else (None, FIRST_SHEET)
    training = range(LEARNING_SHEET, LEARNING_SHEET + LEARNED_FROM)
    for level in LEVELS:
        trees = learn_from_staircases(training, level=level, staircases=staircases, remade=remade)
        for sensor in range(first, first + sheets):
            try:
                each = follow_staircases(
                    sensor, level=level, staircases=staircases, remade=remade, trees=trees
                )
            except CalibrationError as error:
                # A pixel at the end of its converter: the guided steps refuse such a sheet.
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
        # A few sheets that go astray decide over all together.
        "median_sheet_rms_n": float(np.median(by_sheet)),
        "share_of_settled": _rms_n(each) / _rms_n(settled),
        "rms_log_error": float(np.sqrt(np.mean(np.concatenate(logs) ** 2))),
        "rms_log_error_own_gain_out": float(np.sqrt(np.mean(np.concatenate(own) ** 2))),
        # A method that gives no interval covers nothing, and is not asked to.
        "coverage": float(np.mean(np.concatenate([one.is_covered for one in each])))
        if half_n.any()
        else None,
        "mean_half_width_n": float(np.mean(half_n)) if half_n.any() else None,
    }


def _compare_rivals(runs: Runs) -> list[dict[str, Any]]:
    """Return the RMS error of `now` less each rival's on the same frames, by sheet."""
    return [
        row
        for level, each in runs.items()
        for row in compare(
            {name: _errors_n(each[name]) for name in ("now", *RIVALS) if each[name]},
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
        title="Force now during random staircases of closing and opening (simulated)",
        provenance=(
            "Simulated: sheets of the twin, each calibrated once as the simulated rigs are (a load "
            "cell with changing faces) and tested on other objects in another session; steps of "
            "1 mm at 3.5 mm/s, dwells of 0.2-5 s, forces above 0.2 N. Sheets whose pixels saturate "
            "are refused, named on standard error and left out.",
            "`own gain out` is the error with the median of each staircase taken away: what "
            "remains when the gain of that contact is known.",
            f"The trees learn from staircases of {LEARNED_FROM} other sheets of the level, of "
            f"the same law (seeds from {LEARNING_SHEET} on): both laws' forces, the readings up to "
            "4 s ago and the times. They give no interval.",
            *([_SECOND] if second else []),
        ),
        tables=[
            Table.of(
                f"Force now, {sheets} sheets of each level, {staircases} staircases of 20 s each",
                summary,
            )
        ],
        payload={
            "second_generator": second,
            "summary": summary,
            "compared": _compare_rivals(runs),
            "sheets": sheets,
            "staircases": staircases,
        },
    )
