"""Traces of a sheet beside a load cell: random staircases of closing and opening, with dwells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError
from palpate.grasp.calibrating import Bench, measure_rest
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.sensor.array import Frame
from palpate.sensor.load_traces import LoadTraces
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import excess_conductance

#: A first touch of the load cell, newtons, and how slowly it is looked for.
_TOUCH_N, _APPROACH_MM_PER_S = 0.05, 10.0
#: As slow as a grasp squeezes: some frames of a slow readout fall into a step of a millimetre, so
#: that the servo's current is read on the way, when its friction is known.
_RATE_MM_PER_S = 3.5
#: Speed of opening before a run.
_OPENING_MM_PER_S = 20.0
_FRAME_TIMEOUT_S = 2.0
#: Steps of a run are a share of this, so that stiff faces get small forces too.
STEP_MM = 1.0
#: Dwells are drawn from this range, uniformly in the logarithm: short ones show the fast creep.
DWELL_S = (0.2, 5.0)


Columns: TypeAlias = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class _Row:
    """One frame with what gripper and cell said at its time."""

    frame: Frame
    state: GripperState
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Staircase:
    """One run: how long it lasts, how far a step goes, and between which forces it stays.

    Each step keeps to the way of the last with the probability `onward`; else its way is drawn,
    closing a little more often than not.
    """

    duration_s: float
    highest_n: float
    step_mm: float = STEP_MM
    lowest_n: float = 0.3
    onward: float = 0.0


#: The guided runs: small and large forces mixed, fine steps among the coarse, so that stiff faces
#: show small forces too and dwells come at every force. They keep to their way for long, because
#: steps of chance alone seldom climb to the highest force, and no law is known beyond it.
GUIDED = tuple(
    Staircase(duration_s=40.0, highest_n=highest_n, step_mm=step_mm, onward=0.75)
    for highest_n, step_mm in (
        (6.0, 0.5),
        (15.0, 0.5),
        (12.0, 1.0),
        (15.0, 1.0),
        (4.0, 0.25),
        (15.0, 0.5),
        (10.0, 1.0),
        (15.0, 1.0),
    )
)


def record_traces(
    bench: Bench,
    *,
    staircases: Sequence[Staircase],
    reseat: Callable[[int], None],
    rng: np.random.Generator,
    progress: Callable[[int, float], None] | None = None,
) -> LoadTraces:
    """Close on a load cell in random staircases, up and down, and keep every frame.

    Each run is a fresh placement of the cell. Which way a step goes is drawn: towards closing at
    first, back where the force limit of the run is reached or the cell hardly feels the hand.

    Parameters
    ----------
    bench : Bench
        The devices.
    staircases : sequence of Staircase
        One for each run.
    reseat : callable
        Called with the number of the run once the hand is open: the user moves the load cell.
    rng : Generator
        Draws directions and dwells.
    progress : callable, optional
        Called after each step with the number of the run and the force, newtons.

    Raises
    ------
    CalibrationError
        If the load cell never feels the hand.
    """
    runs: list[Columns] = []
    for run, staircase in enumerate(staircases):
        rest_ohm = np.array(measure_rest(bench, duration_s=1.0).ohm)
        reseat(run)
        recorder = _Recorder(bench)
        recorder.approach()
        ends_s, closing = bench.clock.now_s() + staircase.duration_s, True
        while bench.clock.now_s() < ends_s:
            closing = _closes(bench.cell.read_n(), staircase, rng, closing=closing)
            if not recorder.step(-staircase.step_mm if closing else staircase.step_mm):
                break
            dwell_s = float(np.exp(rng.uniform(*np.log(DWELL_S))))
            recorder.read(dwell_s)
            if progress is not None:
                progress(run, recorder.rows[-1].force_n)
        runs.append(recorder.columns(run, rest_ohm=rest_ohm))
    bench.gripper.release()
    columns = {name: np.concatenate([one[name] for one in runs]) for name in runs[0]}
    if not (columns["force_n"] > _TOUCH_N).any():
        raise CalibrationError(
            "force calibration: the hand closed fully and the load cell felt nothing; "
            "is the cell between the fingers, and connected?"
        )
    return LoadTraces(**columns)


def _closes(
    force_n: float, staircase: Staircase, rng: np.random.Generator, *, closing: bool
) -> bool:
    """Return whether the next step closes; `closing` is what the last one did."""
    if force_n < staircase.lowest_n:
        return True
    if force_n > staircase.highest_n:
        return False
    return closing if rng.random() < staircase.onward else bool(rng.random() < 0.55)


class _Recorder:
    """Reads every frame of one run, with what gripper and cell say at its time."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.rows: list[_Row] = []

    def columns(self, run: int, *, rest_ohm: NDArray[np.float64]) -> Columns:
        """Return what was read, as `LoadTraces` keeps it."""
        frames = [row.frame for row in self.rows]
        ohm = pixel_resistance_ohm(
            np.stack([frame.counts for frame in frames]),
            layout=self._bench.array.layout,
            oversampling=frames[0].oversampling,
        )
        told = np.maximum(ohm, self._bench.array.layout.divider.least_ohm)
        excess = excess_conductance(told, rest_ohm=rest_ohm)
        return {
            "run": np.full(len(frames), float(run)),
            "time_s": np.array([frame.time_s for frame in frames]),
            "excess": excess.reshape(len(frames), -1),
            "width_mm": np.array([row.state.width_mm for row in self.rows]),
            "current_ma": np.array([row.state.current_ma for row in self.rows]),
            "force_n": np.array([row.force_n for row in self.rows]),
        }

    def approach(self) -> None:
        """Close until the cell feels the hand."""
        bench = self._bench
        start = GripperCommand(target=bench.start, rate=_OPENING_MM_PER_S)
        bench.gripper.command(start)
        while self._frame():
            pass
        self.rows.clear()
        self.read(0.5)
        command = GripperCommand(target=bench.gripper.limits.lowest, rate=_APPROACH_MM_PER_S)
        bench.gripper.command(command)
        while self._frame() and self.rows[-1].force_n < _TOUCH_N:
            pass
        bench.gripper.stop()

    def step(self, by_mm: float) -> bool:
        """Move by so much and read until it is done; return whether there was room."""
        bench = self._bench
        width_mm = bench.gripper.state().width_mm + by_mm
        if width_mm < bench.gripper.limits.lowest:
            return False
        bench.gripper.command(GripperCommand(target=width_mm, rate=_RATE_MM_PER_S))
        while self._frame():
            pass
        return True

    def read(self, duration_s: float) -> None:
        """Read frames for so long."""
        until_s = self._bench.clock.now_s() + duration_s
        while self._bench.clock.now_s() < until_s:
            self._frame()

    def _frame(self) -> bool:
        """Read one frame; return whether the fingers move."""
        bench = self._bench
        frame, state = bench.array.read(timeout_s=_FRAME_TIMEOUT_S), bench.gripper.state()
        self.rows.append(_Row(frame, state, bench.cell.read_n()))
        return state.moving
