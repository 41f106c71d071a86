"""Guided traces and test staircases of sheets on the twin, and how each method follows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.estimate.observer_sheet import SheetModel, SheetObserver
from palpate.estimate.observer_sheet_fit import fit_current, fit_sheet, without_current
from palpate.estimate.sheet_current import Current
from palpate.estimate.sheet_reading_fit import FAINT_N
from palpate.grasp.load_traces import GUIDED, Staircase, record_traces
from palpate.rig.twin_bench import FACES, twin_bench
from palpate.sensor.load_traces import LoadTraces, frames
from palpate.settling.relaxation import Relaxation
from palpate.twin.objects import draw_object
from palpate.twin.world import World

#: What is grasped after the calibration: no name is among the faces of the load cell.
GRASPED = ("ball-40lbs", "ball-55lbs", "springs-2", "springs-6", "tomato", "avocado-day-2")
#: A test staircase: 20 s in steps of 1 mm, turned back at this force.
TEST = Staircase(duration_s=20.0, highest_n=12.0)
#: Opening beyond the largest object, mm.
START_MM = 72.0
#: A dwell is given to `settling` from so long on, and read again every so many frames.
_SETTLING_FROM_S, _SETTLING_EVERY = 0.5, 15
_STILL_MM = 0.06
#: When the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedForce:
    """One test staircase as one method followed it; arrays of shape (frames,)."""

    time_s: FloatArray
    force_n: FloatArray
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether the interval held the force."""
        return (self.low_n <= self.force_n) & (self.force_n <= self.high_n)


def guided_traces(sensor: int, *, level: str) -> LoadTraces:
    """Return what the guided steps of `palpate calibrate force` record on one sheet."""
    return _recorded(sensor, level=level, session=1, names=FACES, staircases=GUIDED)


def trial_traces(sensor: int, *, level: str, staircases: int) -> LoadTraces:
    """Return staircases on other objects in another session."""
    rng = np.random.default_rng([sensor, 7])
    names = [str(name) for name in rng.choice(GRASPED, staircases, replace=False)]
    return _recorded(sensor, level=level, session=2, names=names, staircases=[TEST] * staircases)


def _recorded(
    sensor: int, *, level: str, session: int, names: Sequence[str], staircases: Sequence[Staircase]
) -> LoadTraces:
    rng = np.random.default_rng([sensor, session])
    world = World(None, seed=sensor + 1_000_003 * session, sheet_seed=sensor, level=level)
    return record_traces(
        twin_bench(world, start=START_MM),
        staircases=staircases,
        reseat=lambda run: world.place(draw_object(rng, names[run])),
        rng=rng,
    )


def followed(guided: LoadTraces, tested: LoadTraces) -> Mapping[str, list[FollowedForce]]:
    """Learn every method from the guided traces and follow the tested ones."""
    full, static = fit_sheet(guided), fit_sheet(guided, memory=False)
    settled = fit_sheet(settled_traces(guided), memory=False)
    found = {
        "static": [_follow(static, run) for run in tested.runs()],
        "settling": [_follow(settled, run) for run in settled_traces(tested).runs()],
        "observer": [_follow(without_current(full), run) for run in tested.runs()],
    }
    current = fit_current(guided)
    if current is not None:
        found["current"] = [_follow_current(current, run) for run in tested.runs()]
        found["both"] = [_follow(full, run) for run in tested.runs()]
    return found


def settled_traces(traces: LoadTraces) -> LoadTraces:
    """Return the traces with the summed reading replaced by what it is predicted to settle to.

    Each dwell is predicted from its own frames; before half a second of it the reading stands.
    """
    excess = [value for run in traces.runs() for value in _settled(run)]
    return replace(traces, excess=np.array(excess)[:, None])


def _settled(run: LoadTraces) -> Iterator[float]:
    method, times_s, values = Relaxation(), list[float](), list[float]()
    began_s, width_mm, value = -np.inf, np.nan, np.nan
    for frame in frames(run):
        summed = float(np.maximum(frame.excess, 0.0).sum())
        if not abs(frame.width_mm - width_mm) < _STILL_MM:
            times_s, values = [], []
            began_s, value = frame.time_s, np.nan
        width_mm = frame.width_mm
        since_s = frame.time_s - began_s
        times_s.append(since_s)
        values.append(summed)
        due = since_s >= _SETTLING_FROM_S and len(values) % _SETTLING_EVERY == 0
        if due and since_s < HORIZON_S:
            found = method.predict(
                np.array(times_s), np.array([values]), horizon_s=HORIZON_S, level=0.9
            )
            value = max(float(np.ravel(found.value)[0]), 0.0)
        yield summed if np.isnan(value) else value


def _follow(model: SheetModel, run: LoadTraces) -> FollowedForce:
    observer, rows = SheetObserver(model), []
    for frame in frames(run):
        now = observer.step(
            frame.time_s, frame.excess, width_mm=frame.width_mm, current_ma=frame.current_ma
        )
        if frame.force_n > FAINT_N:
            rows.append((frame.time_s, frame.force_n, now.value, now.low, now.high))
    return _as_followed(rows)


def _follow_current(current: Current, run: LoadTraces) -> FollowedForce:
    rows = []
    for frame in frames(run):
        if frame.force_n > FAINT_N:
            value = max(float(current.force_n(frame.current_ma)), 0.0)
            wide = 1.645 * float(np.hypot(current.sd_n, current.stuck_sd_n(value)))
            rows.append((frame.time_s, frame.force_n, value, value - wide, value + wide))
    return _as_followed(rows)


def _as_followed(rows: Sequence[tuple[float, ...]]) -> FollowedForce:
    columns = np.array(rows).reshape(-1, 5).T
    return FollowedForce(
        time_s=columns[0],
        force_n=columns[1],
        value_n=columns[2],
        low_n=columns[3],
        high_n=columns[4],
    )
