"""Servo current beside a sheet: what it says of the force at rest and on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from palpate.estimate.creep import FloatArray
from palpate.estimate.observer_fit import least_absolute

#: From session to session the torque of an ampere changes with the warmth of the motor: copper and
#: magnets lose some percent from cold to warm.
WARMTH_SD = 0.035
#: A current is believed to follow the force from so many readings and this correlation on.
_FEWEST_READINGS, _FOLLOWS = 20, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Current:
    """Servo current as a second witness: (zero + way gear) + (1 + way share) ma_per_n force.

    While the fingers move, friction of the gears adds to the grip (way +1, closing) or takes from
    it (-1, opening). At rest it holds anything in between (0, on average): how much depends on how
    the last movement ended, and stays until the next.

    Attributes
    ----------
    zero_ma, ma_per_n : float
        The line at rest.
    gear_ma, gear_share : float
        Friction without load, and as a share of the grip.
    sd_n : float
        Scatter of a single reading, newtons.
    stuck_n, stuck_share : float
        Scatter at rest, from one stop to another: newtons, and a share of the force.
    warmth_sd : float
        Of the torque of an ampere, from session to session.
    """

    zero_ma: float
    ma_per_n: float
    gear_ma: float
    gear_share: float
    sd_n: float
    stuck_n: float
    stuck_share: float
    warmth_sd: float = WARMTH_SD

    def force_n(self, current_ma: ArrayLike, *, way: ArrayLike = 0.0) -> FloatArray:
        """Return the force that a current means, newtons."""
        way = np.asarray(way, dtype=float)
        above_ma = np.asarray(current_ma, dtype=float) - self.zero_ma - way * self.gear_ma
        return np.asarray(above_ma / (self.ma_per_n * (1.0 + way * self.gear_share)))

    def stuck_sd_n(self, force_n: ArrayLike) -> FloatArray:
        """Return the scatter at rest, newtons."""
        return self.stuck_n + self.stuck_share * np.asarray(force_n, dtype=float)


class CurrentTrace(Protocol):
    """One placement of the load cell, frame by frame; arrays of shape (frames,)."""

    @property
    def current_ma(self) -> FloatArray:
        """What the servo reported."""
        ...

    @property
    def force_n(self) -> FloatArray:
        """Reference."""
        ...

    @property
    def still(self) -> NDArray[np.bool_]:
        """Whether the fingers stood still since the last frame."""
        ...

    @property
    def stop(self) -> NDArray[np.int64]:
        """Number of the stop."""
        ...

    @property
    def way(self) -> NDArray[np.int64]:
        """1 or -1 on the way of a closing or an opening, 0 else."""
        ...


def fit_line(runs: Sequence[CurrentTrace]) -> Current | None:
    """Fit the current to the force, at rest and on the way; None where it does not follow it."""
    current, force_n, still, way = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("current_ma", "force_n", "still", "way")
    )
    used = still | (way != 0)
    if not np.isfinite(current).all() or np.count_nonzero(used) < _FEWEST_READINGS:
        return None
    # Readings of one stop share what the gears hold: together they count as one on the way.
    weight = np.concatenate([_one_per_stop(run) for run in runs])
    # In units of their spread, for which the fit's trace of ridge is made.
    force_unit_n, unit_ma = float(np.std(force_n)), float(np.std(current))
    force = force_n / force_unit_n
    design = np.stack([np.ones_like(force), force, way, way * force], axis=1)
    zero_ma, ma_per_n, gear_ma, turned_ma_per_n = (
        least_absolute(design[used], current[used] / unit_ma, weight[used])
        * unit_ma
        / np.array([1.0, force_unit_n, 1.0, force_unit_n])
    )
    if ma_per_n <= 0 or np.corrcoef(current[used], force_n[used])[0, 1] < _FOLLOWS:
        return None
    line = Current(
        zero_ma=float(zero_ma),
        ma_per_n=float(ma_per_n),
        gear_ma=max(float(gear_ma), 0.0),
        gear_share=float(np.clip(turned_ma_per_n / ma_per_n, 0.0, 0.8)),
        sd_n=1.0,
        stuck_n=0.0,
        stuck_share=0.0,
    )
    return replace(line, **_scatter(line, runs))


def _one_per_stop(run: CurrentTrace) -> FloatArray:
    """Return weights of readings of the current."""
    shared = np.bincount(run.stop, weights=run.still)[run.stop]
    return np.where(run.still, 1.0 / np.maximum(shared, 1.0), 1.0)


def _scatter(line: Current, runs: Sequence[CurrentTrace]) -> dict[str, float]:
    """Return the scatter of single readings, and from stop to stop."""
    errors, means, forces = [], [], []
    for run in runs:
        error_n = line.force_n(run.current_ma, way=run.way) - run.force_n
        for stop in np.unique(run.stop[run.still]):
            mine = run.still & (run.stop == stop)
            errors.append(error_n[mine] - error_n[mine].mean())
            means.append(abs(error_n[mine].mean()))
            forces.append(run.force_n[mine].mean())
        errors.append(error_n[run.way != 0])
    # Mean absolute values, to standard deviations of a normal scatter.
    design = np.column_stack([np.ones(len(means)), forces])
    stuck_n, stuck_share = nnls(design, 1.25 * np.array(means))[0]
    return {
        "sd_n": max(float(np.sqrt(np.mean(np.concatenate(errors) ** 2))), 0.01),
        "stuck_n": float(stuck_n),
        "stuck_share": float(stuck_share),
    }
