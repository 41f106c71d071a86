"""What a servo's gears take without load: along the way, and from one movement to the next.

Friction of gears is never twice the same. Part of it comes back at the same places, as the teeth
turn: an empty hand that closes slowly shows it. The rest has another size in every movement and
stays through it: the scatter of many short movements tells how much that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sensor.current_pairs import CurrentPairs

FloatArray = NDArray[np.float64]

#: Below this a load cell says that nothing is pressed, newtons.
_FREE_N = 0.1
#: A movement shows the shape of the friction over at least this way, mm.
_LONG_MM = 5.0
#: The map's spacing and smoothing, mm: finer than the teeth of a small servo's last gears.
_SPACING_MM, _SMOOTHING_MM = 0.5, 0.4
#: From so many short movements on their own scatter is believed; before that, this share of the
#: friction is taken for it (a guess for small geared servos, between a tenth and a quarter).
_FEWEST_MOVEMENTS, _USUAL_SHARE = 10, 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class GearFriction:
    """Servo current of an empty hand that closes."""

    #: Over the way, and how well that is known.
    mean_ma: float
    mean_sd_ma: float
    #: Scatter from movement to movement.
    movement_ma: float
    #: By how much more at widths, rising; empty where no long movement showed it.
    along_mm: tuple[float, ...] = ()
    along_ma: tuple[float, ...] = ()

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> GearFriction | None:
        """Fit to the readings without load; None where no movement has several of them.

        Examples
        --------
        Two long closings and twelve short ones, of gears that take 40 mA, 4 more at 20 mm:

        >>> way_mm = np.linspace(40.0, 10.0, 300)
        >>> gears_ma = lambda mm: 40.0 + 4.0 * np.exp(-(((mm - 20.0) / 2.0) ** 2))
        >>> width_mm = np.concatenate([way_mm, way_mm, way_mm[:36]])
        >>> movement = np.repeat(np.arange(14), [300, 300] + 12 * [3])
        >>> found = GearFriction.fit(CurrentPairs(
        ...     force_n=(0.0,) * 636, current_ma=tuple(gears_ma(width_mm)),
        ...     width_mm=tuple(width_mm), movement=tuple(movement)))
        >>> round(found.mean_ma), found.at(np.array([12.0, 20.0])).round().tolist()
        (40, [40.0, 44.0])
        """
        free = np.array(pairs.force_n) < _FREE_N
        runs = _runs(pairs, free) if pairs.movement else []
        if not runs:
            return None
        ways_mm = [float(np.ptp(width)) for width, _ in runs]
        long = [way > max(_LONG_MM, 0.5 * max(ways_mm)) for way in ways_mm]
        at_mm, shape = _shape([run for run, showing in zip(runs, long, strict=True) if showing])
        levels = [
            float(current.mean() / np.interp(width, at_mm, shape).mean()) for width, current in runs
        ]
        short = [
            (run, level) for run, level, far in zip(runs, levels, long, strict=True) if not far
        ]
        if len(short) < _FEWEST_MOVEMENTS:
            mean_ma, count = float(np.mean(levels)), len(levels)
            movement_ma = _USUAL_SHARE * abs(mean_ma)
        else:
            mean_ma, count = float(np.mean([level for _, level in short])), len(short)
            noise = [np.var(current, ddof=1) / current.size for (_, current), _ in short]
            scatter = np.var([level for _, level in short], ddof=1) - np.mean(noise)
            movement_ma = float(np.sqrt(max(scatter, 0.0)))
        return cls(
            mean_ma=mean_ma,
            mean_sd_ma=movement_ma / float(np.sqrt(count)),
            movement_ma=movement_ma,
            along_mm=tuple(at_mm.tolist()),
            along_ma=tuple((mean_ma * (shape - 1.0)).tolist()),
        )

    def at(self, width_mm: FloatArray) -> FloatArray:
        """Return what the gears take at widths on average, mA."""
        if not self.along_mm:
            return np.full_like(width_mm, self.mean_ma)
        return self.mean_ma + np.interp(width_mm, self.along_mm, self.along_ma)


def _runs(pairs: CurrentPairs, free: NDArray[np.bool_]) -> list[tuple[FloatArray, FloatArray]]:
    """Return widths and currents of every movement that has more than one reading without load."""
    movement = np.where(free, pairs.movement, -1)
    width, current = np.array(pairs.width_mm), np.array(pairs.current_ma)
    numbers, counts = np.unique(movement[free], return_counts=True)
    return [(width[movement == one], current[movement == one]) for one in numbers[counts > 1]]


def _shape(runs: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return widths and the friction there over its mean, smoothed over all these movements."""
    if not runs:
        return np.zeros(1), np.ones(1)
    width = np.concatenate([width for width, _ in runs])
    share = np.concatenate([current / current.mean() for _, current in runs])
    at_mm = np.arange(width.min(), width.max() + _SPACING_MM, _SPACING_MM)
    near = np.exp(-0.5 * ((at_mm[:, None] - width) / _SMOOTHING_MM) ** 2)
    return at_mm, np.asarray(near @ share / near.sum(axis=1))
