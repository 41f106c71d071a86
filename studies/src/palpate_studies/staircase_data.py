"""Random staircases of closing and opening on the twin, and how each law follows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.estimate.force import StaticLaw
from palpate.estimate.force_follower import FollowsForce, ForceFollower
from palpate.estimate.force_now import ForceNow
from palpate.estimate.pixel_law import PixelReading
from palpate.grasp.calibrating import Bench, measure_rest
from palpate.grasp.planning import DWELL_S, HORIZON_S, force_now, laws_of
from palpate.gripper.interface import GripperCommand
from palpate.rig.simulated import calibrate_twin, twin_bench
from palpate.sensor.calibration import ForcePairs
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import excess_conductance
from palpate.twin.objects import draw_object
from palpate.twin.velostat import Sheet
from palpate.twin.world import World
from palpate_studies.baselines.learned_now import NowLaws, learned_now, numbers_of

#: What is grasped after the calibration: no name is among the faces of the load cell.
GRASPED = ("ball-40lbs", "ball-55lbs", "springs-2", "springs-6", "tomato", "avocado-day-2")
#: A staircase: steps at a grasp's speed, turned back at these forces; dwells are drawn from a
#: range, uniformly in the logarithm, directions closing a little more often than not.
DURATION_S = 20.0
_STEP_MM, _RATE_MM_PER_S = 1.0, 3.5
_LOWEST_N, _HIGHEST_N, _ONWARD = 0.3, 12.0, 0.55
_DWELL_S = (0.2, 5.0)
#: Opening beyond the largest object, mm; how fast contact is looked for, and from which force on
#: the cell feels it.
_START_MM, _APPROACH_MM_PER_S, _TOUCH_N = 72.0, 10.0, 0.05
#: Smaller forces are not scored.
FAINT_N = 0.2
_FRAME_TIMEOUT_S = 2.0

#: Time, excess conductance of the pixels and reference force of one frame.
FrameRead: TypeAlias = tuple[float, FloatArray, float]
#: From the time and the excess conductance of a frame to force and the ends of its interval.
Reader = Callable[[float, FloatArray], tuple[float, float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedForce:
    """One test staircase of a sensor as one method followed it; arrays of shape (frames,)."""

    sensor: int
    time_s: FloatArray
    force_n: FloatArray
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether the interval held the force."""
        return (self.low_n <= self.force_n) & (self.force_n <= self.high_n)


def followed(
    sensor: int,
    *,
    level: str,
    staircases: int,
    remade: Callable[[Sheet], Sheet] | None = None,
    laws: NowLaws | None = None,
) -> Mapping[str, list[FollowedForce]]:
    """Calibrate a sheet as a user does and follow staircases on other objects, by method.

    `remade`: as in `World`. `laws`: learned on other sheets; they give no interval.
    """
    pairs, runs = _used(sensor, level=level, staircases=staircases, remade=remade)
    found: dict[str, list[FollowedForce]] = {}
    for frames in runs:
        for method, read in _readers(pairs).items():
            found.setdefault(method, []).append(_follow(frames, read, sensor=sensor))
        for learner, law in (laws or {}).items():
            value_n = law.on([str(sensor)])(_numbers(frames, pairs))
            found.setdefault(learner, []).append(_answered(frames, value_n, sensor=sensor))
    return found


def learned_from(
    sensors: Sequence[int],
    *,
    level: str,
    staircases: int,
    remade: Callable[[Sheet], Sheet] | None = None,
) -> NowLaws:
    """Learn the force now from staircases of some sheets; those that are refused teach nothing."""
    rows, force_n, sheets = list[FloatArray](), list[float](), list[str]()
    for sensor in sensors:
        try:
            pairs, runs = _used(sensor, level=level, staircases=staircases, remade=remade)
        except CalibrationError:
            continue
        for frames in runs:
            felt = np.array([one > FAINT_N for *_, one in frames])
            rows.append(_numbers(frames, pairs)[felt])
            force_n += [one for *_, one in frames if one > FAINT_N]
            sheets.append(str(sensor))
    return learned_now(np.concatenate(rows), force_n=np.array(force_n), sheets=sheets)


def _used(
    sensor: int, *, level: str, staircases: int, remade: Callable[[Sheet], Sheet] | None
) -> tuple[ForcePairs, list[list[FrameRead]]]:
    """Return a sheet's calibration and the frames of its staircases."""
    pairs = calibrate_twin(seed=sensor, level=level, apart_from="", remade=remade).force
    rng = np.random.default_rng([sensor, 7])
    names = rng.choice(GRASPED, staircases, replace=False).tolist()
    world = World(None, seed=sensor + 2_000_006, sheet_seed=sensor, level=level, remade=remade)
    bench, runs = twin_bench(world, start=_START_MM), list[list[FrameRead]]()
    for name in names:
        rest_ohm = np.array(measure_rest(bench, duration_s=1.0).ohm)
        world.place(draw_object(rng, name))
        runs.append(list(_staircase(bench, rest_ohm=rest_ohm, rng=rng)))
    return pairs, runs


def _numbers(frames: Sequence[FrameRead], pairs: ForcePairs) -> FloatArray:
    time_s, excess, _ = zip(*frames, strict=True)
    return numbers_of(np.array(time_s), np.array(excess), pairs=pairs)


def _readers(pairs: ForcePairs) -> Mapping[str, Reader]:
    laws = laws_of(pairs)
    reading, early, settled, memory = laws
    assert memory is not None
    by_time = ForceNow(laws._replace(memory=None), early_s=DWELL_S, settled_s=HORIZON_S)
    return {
        "settled": _static(reading, settled),
        "early": _static(reading, early),
        "by_time": _following(by_time),
        "memory": _following(ForceFollower(memory)),
        "now": _following(force_now(pairs)),
    }


def _following(follower: FollowsForce) -> Reader:
    def read(time_s: float, excess: FloatArray) -> tuple[float, float, float]:
        answer = follower.step(time_s, excess)
        return float(answer.value or 0.0), float(answer.low or 0.0), float(answer.high or np.inf)

    return read


def _static(reading: PixelReading, law: StaticLaw) -> Reader:
    def read(_: float, excess: FloatArray) -> tuple[float, float, float]:
        answer = law.force_n(reading.reading(excess))
        return float(answer.value), float(answer.low), float(answer.high)

    return read


def _follow(frames: Sequence[FrameRead], read: Reader, *, sensor: int) -> FollowedForce:
    answers = np.array([read(time_s, excess) for time_s, excess, _ in frames])
    return _answered(frames, *answers.reshape(-1, 3).T, sensor=sensor)


def _answered(
    frames: Sequence[FrameRead],
    value_n: FloatArray,
    low_n: FloatArray | None = None,
    high_n: FloatArray | None = None,
    *,
    sensor: int,
) -> FollowedForce:
    """Gather what was answered where there was enough force; no interval is as wide as nothing."""
    time_s = np.array([one for one, *_ in frames])
    force_n = np.array([one for *_, one in frames])
    felt = force_n > FAINT_N
    return FollowedForce(
        sensor=sensor,
        time_s=time_s[felt],
        force_n=force_n[felt],
        value_n=value_n[felt],
        low_n=(value_n if low_n is None else low_n)[felt],
        high_n=(value_n if high_n is None else high_n)[felt],
    )


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
            cell.read_n() < _HIGHEST_N and bool(rng.random() < _ONWARD)
        )
        target = gripper.state().width_mm + (-_STEP_MM if closes else _STEP_MM)
        if target < gripper.limits.lowest:
            return
        gripper.command(GripperCommand(target=target, rate=_RATE_MM_PER_S))
        until_s = bench.clock.now_s() + float(np.exp(rng.uniform(*np.log(_DWELL_S))))
        while gripper.state().moving or bench.clock.now_s() < until_s:
            yield frame()
