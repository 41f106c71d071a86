"""Servo current beside a sheet: what it says of the force at rest and on the way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from palpate.estimate.creep import FloatArray
from palpate.estimate.gear_friction import GearFriction
from palpate.estimate.observer_fit import least_absolute

#: From session to session the torque of an ampere changes with the warmth of the motor: copper and
#: magnets lose some percent from cold to warm.
WARMTH_SD = 0.035
#: A current is believed to follow the force from so many readings and this correlation on.
_FEWEST_READINGS, _FOLLOWS = 20, 0.5
#: Along the way friction differs by no more than this share of its mean: more is a mistake.
_MOST_ALONG = 0.5
#: Less friction than this tells nothing of how it scatters, newtons.
_LEAST_FRICTION_N = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Current:
    """Servo current as a second witness: (zero + way gear) + (1 + way share) ma_per_n force.

    While the fingers move, friction of the gears adds to the grip (way +1, closing) or takes from
    it (-1, opening). At rest it holds anything in between (0, on average): how much depends on how
    the last movement ended, and stays until the next. Nor is it twice the same on the way.

    Attributes
    ----------
    zero_ma, ma_per_n : float
        The line at rest.
    gear_ma, gear_share : float
        Friction without load, and as a share of the grip.
    sd_n : float
        Scatter of a single reading, newtons.
    gear_scatter : float
        Of the friction from one movement to another, as a share of it.
    along_mm, along : tuple of float
        Friction at widths, rising, over its mean; 1 where no empty hand showed it.
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
    gear_scatter: float = 0.0
    along_mm: tuple[float, ...] = ()
    along: tuple[float, ...] = ()
    warmth_sd: float = WARMTH_SD

    def force_n(
        self, current_ma: ArrayLike, *, way: ArrayLike = 0.0, width_mm: ArrayLike = np.nan
    ) -> FloatArray:
        """Return the force that a current means, newtons."""
        way = np.asarray(way, dtype=float) * self.friction(width_mm)
        above_ma = np.asarray(current_ma, dtype=float) - self.zero_ma - way * self.gear_ma
        return np.asarray(above_ma / (self.ma_per_n * (1.0 + way * self.gear_share)))

    def friction(self, width_mm: ArrayLike) -> FloatArray:
        """Return the friction at a width over its mean."""
        at_mm = np.asarray(width_mm, dtype=float)
        if not self.along_mm:
            return np.ones_like(at_mm)
        found = np.interp(at_mm, self.along_mm, self.along, left=1.0, right=1.0)
        return np.where(np.isfinite(at_mm), found, 1.0)

    def stuck_sd_n(self, force_n: ArrayLike) -> FloatArray:
        """Return the scatter at rest, newtons."""
        return self.stuck_n + self.stuck_share * np.asarray(force_n, dtype=float)

    def way_sd_n(self, force_n: ArrayLike, *, way: ArrayLike) -> FloatArray:
        """Return the scatter on the way, from one movement to another.

        An opening tells less: there friction takes from the grip, and the current is small.
        """
        friction_ma = self.gear_ma + self.gear_share * self.ma_per_n * np.asarray(force_n)
        per_ma = 1.0 / (self.ma_per_n * (1.0 + np.asarray(way) * self.gear_share))
        return np.asarray(self.gear_scatter * friction_ma * per_ma)


def current_from_dict(stored: Mapping[str, Any]) -> Current:
    """Return the current that a calibration file holds; TypeError if a value is missing."""
    lists = {name: tuple(stored.get(name, ())) for name in ("along_mm", "along")}
    return Current(**{**stored, **lists})


class CurrentTrace(Protocol):
    """One placement of the load cell, frame by frame; arrays of shape (frames,)."""

    @property
    def current_ma(self) -> FloatArray:
        """What the servo reported."""
        ...

    @property
    def width_mm(self) -> FloatArray:
        """Reported opening."""
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


def fit_line(runs: Sequence[CurrentTrace], *, gears: GearFriction | None = None) -> Current | None:
    """Fit the current to the force, at rest and on the way; None where it does not follow it.

    Parameters
    ----------
    runs : sequence of CurrentTrace
        Loaded frames.
    gears : GearFriction, optional
        What an empty hand showed of the friction along the way.
    """
    current, force_n, width_mm, still, way = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("current_ma", "force_n", "width_mm", "still", "way")
    )
    along_mm, along = _along(gears)
    line = replace(_UNKNOWN, along_mm=along_mm, along=along)
    used = still | (way != 0)
    if not np.isfinite(current).all() or np.count_nonzero(used) < _FEWEST_READINGS:
        return None
    # Readings of one stop share what the gears hold: together they count as one on the way.
    weight = np.concatenate([_one_per_stop(run) for run in runs])
    # In units of their spread, for which the fit's trace of ridge is made.
    force_unit_n, unit_ma = float(np.std(force_n)), float(np.std(current))
    force = force_n / force_unit_n
    met = way * line.friction(width_mm)
    design = np.stack([np.ones_like(force), force, met, met * force], axis=1)
    zero_ma, ma_per_n, gear_ma, turned_ma_per_n = (
        least_absolute(design[used], current[used] / unit_ma, weight[used])
        * unit_ma
        / np.array([1.0, force_unit_n, 1.0, force_unit_n])
    )
    if ma_per_n <= 0 or np.corrcoef(current[used], force_n[used])[0, 1] < _FOLLOWS:
        return None
    line = replace(
        line,
        zero_ma=float(zero_ma),
        ma_per_n=float(ma_per_n),
        gear_ma=max(float(gear_ma), 0.0),
        gear_share=float(np.clip(turned_ma_per_n / ma_per_n, 0.0, 0.8)),
    )
    return _with_scatter(line, runs)


#: Before anything is known.
_UNKNOWN = Current(
    zero_ma=0.0,
    ma_per_n=1.0,
    gear_ma=0.0,
    gear_share=0.0,
    sd_n=1.0,
    stuck_n=0.0,
    stuck_share=0.0,
)


def _along(gears: GearFriction | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return widths and the friction there over its mean; empty where nothing showed it."""
    if gears is None or not gears.along_mm or not gears.mean_ma > 0:
        return (), ()
    more = np.clip(np.array(gears.along_ma) / gears.mean_ma, -_MOST_ALONG, _MOST_ALONG)
    return gears.along_mm, tuple((1.0 + more).tolist())


def _one_per_stop(run: CurrentTrace) -> FloatArray:
    """Return weights of readings of the current."""
    shared = np.bincount(run.stop, weights=run.still)[run.stop]
    return np.where(run.still, 1.0 / np.maximum(shared, 1.0), 1.0)


def _with_scatter(line: Current, runs: Sequence[CurrentTrace]) -> Current:
    """Return the line with its scatter: of single readings, of stops, and of movements."""
    within, stops, ways = [], list[tuple[float, float]](), list[tuple[float, float]]()
    unit = replace(line, gear_scatter=1.0)
    for run in runs:
        error_n = line.force_n(run.current_ma, way=run.way, width_mm=run.width_mm) - run.force_n
        for mine in _parts(run.still, run.stop):
            within.append(error_n[mine] - error_n[mine].mean())
            stops.append((float(run.force_n[mine].mean()), abs(float(error_n[mine].mean()))))
        for mine in _parts(run.way != 0, np.cumsum(np.diff(run.way, prepend=0) != 0)):
            within.append(error_n[mine] - error_n[mine].mean())
            friction_n = unit.way_sd_n(run.force_n[mine].mean(), way=run.way[mine][0])
            ways.append((float(friction_n), float(error_n[mine].mean())))
    # Mean absolute values, to standard deviations of a normal scatter.
    forces, errors = np.array(stops).reshape(-1, 2).T
    stuck_n, stuck_share = nnls(np.column_stack([np.ones_like(forces), forces]), 1.25 * errors)[0]
    friction, missed = np.array(ways).reshape(-1, 2).T
    share = np.abs(missed) / np.maximum(friction, _LEAST_FRICTION_N)
    return replace(
        line,
        sd_n=max(float(np.sqrt(np.mean(np.concatenate(within) ** 2))), 0.01),
        stuck_n=float(stuck_n),
        stuck_share=float(stuck_share),
        gear_scatter=1.25 * float(np.mean(share)) if ways else 0.0,
    )


def _parts(used: NDArray[np.bool_], number: NDArray[np.int64]) -> Iterator[NDArray[np.bool_]]:
    """Return the frames of each stop or movement."""
    for one in np.unique(number[used]):
        yield used & (number == one)
