"""Traces of a sheet next to a load cell, frame by frame, as study `staircases` records them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError

#: A reference that moves by less than this share of itself, or this, over a whole calibration is a
#: cell that isn't connected, or nothing between the fingers.
_FLAT_SHARE, _FLAT_N = 0.05, 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadTraces:
    """Frames of staircases of closing and opening beside a reference force.

    Attributes
    ----------
    run : ndarray of int, shape (frames,)
        Which placement of the load cell.
    time_s : ndarray, shape (frames,)
        Time of the frame, rising within a run.
    excess : ndarray, shape (frames, pixels)
        Excess conductance G/G0 - 1 of each pixel.
    width_mm : ndarray, shape (frames,)
        Width that the gripper reported.
    current_ma : ndarray, shape (frames,)
        Servo current; NaN where the servo has none.
    force_n : ndarray, shape (frames,)
        Reference: mean of the fingers' normal forces.

    Raises
    ------
    CalibrationError
        If the columns differ in length, time runs backwards within a run, or the reference never
        changes.
    """

    run: ArrayLike
    time_s: ArrayLike
    excess: ArrayLike
    width_mm: ArrayLike
    current_ma: ArrayLike
    force_n: ArrayLike

    def __post_init__(self) -> None:
        for one in fields(self):
            values = np.array(getattr(self, one.name), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, one.name, values)
        lengths = {one.name: len(np.asarray(getattr(self, one.name))) for one in fields(self)}
        if len(set(lengths.values())) != 1:
            raise CalibrationError(f"force traces: columns of unequal length: {lengths}")
        self._refuse_bad()

    def _refuse_bad(self) -> None:
        force, time_s, run = map(np.asarray, (self.force_n, self.time_s, self.run))
        excess = np.asarray(self.excess)
        if excess.ndim != 2 or not (np.isfinite(excess).all() and np.isfinite(force).all()):
            raise CalibrationError(
                "force traces: excess must be finite, one value per pixel, and every force a "
                "finite number of newtons; is a pixel open or shorted? Run `palpate doctor`"
            )
        if (np.diff(time_s)[np.diff(run) == 0] < 0).any():
            raise CalibrationError("force traces: time runs backwards within a run; keep the order")
        if force.size and np.ptp(force) < max(_FLAT_SHARE * np.abs(force).max(), _FLAT_N):
            raise CalibrationError(
                f"force traces: the reference stays at {force[0]:g} N; is the load cell connected?"
            )

    def runs(self) -> Iterator[LoadTraces]:
        """Yield the frames of each placement."""
        run = np.asarray(self.run)
        for number in np.unique(run):
            mine = run == number
            columns = {one.name: np.asarray(getattr(self, one.name))[mine] for one in fields(self)}
            yield _unchecked(columns)


def _unchecked(columns: dict[str, FloatArray]) -> LoadTraces:
    """Return a part of traces that were checked whole: one placement may well be nearly flat."""
    part = object.__new__(LoadTraces)
    for name, values in columns.items():
        object.__setattr__(part, name, values)
    return part


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFrame:
    """One frame of the traces; attributes as there."""

    time_s: float
    excess: FloatArray
    width_mm: float
    current_ma: float
    force_n: float


def frames(trace: LoadTraces) -> Iterator[LoadFrame]:
    """Yield the frames one by one, as an observer meets them."""
    columns = (trace.time_s, trace.excess, trace.width_mm, trace.current_ma, trace.force_n)
    for time_s, excess, width_mm, current_ma, force_n in zip(
        *map(np.asarray, columns), strict=True
    ):
        yield LoadFrame(
            time_s=float(time_s),
            excess=excess,
            width_mm=float(width_mm),
            current_ma=float(current_ma),
            force_n=float(force_n),
        )
