"""Force from the servo's current during closing: a second measurement next to the sheet's.

While a servo closes, the friction of its gears adds to the grip, so the current is linear in the
force. At rest it is not: friction then carries any part of the grip, either way. One reading is
coarse (some tenths of a newton), and so is one movement, because friction differs from one to the
next; but a closing has several movements, and the sheet shows how the force rose through them.
Together they give the final force as well as a calibrated sheet does, whatever the wear and
wherever on the sheet the object lies.

The friction of the gears without load has two parts. One repeats at the same places, as the teeth
turn: an empty hand that closes slowly shows it. The other differs from movement to movement and is
constant within one: the scatter of many short movements shows its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.estimate.gain import MeasuredForce
from palpate.sensor.calibration import CurrentPairs

#: A calibration of the current needs this many readings under load, and this range of force.
_FEWEST, _RANGE_N = 10, 2.0
#: How the force rose is measured by a sheet whose lag is not quite known, and the object relaxes a
#: little once the fingers stop: a few percent of error, the same for all readings.
_SHAPE_SD = 0.03
#: From session to session the torque of an ampere changes with the warmth of the motor: copper and
#: magnets lose some percent from cold to warm.
WARMTH_SD = 0.035
#: Force that a sheet may not show (threshold of its pixels, typical), newtons, and the least
#: fraction of the final force that a reading must have to be used.
_THRESHOLD_N, _MIN_FRACTION = 0.25, 0.3
#: Friction grows with the load: by this share of the grip (a guess for small geared servos, between
#: a twentieth and a quarter). The empty hand does not show how that part scatters.
_LOAD_FRACTION = 0.15
#: Friction where no empty hand was closed: this fraction of it from movement to movement, and along
#: the way (a guess for small geared servos, between a tenth and a quarter).
_TYPICAL_FRACTION = 0.15

#: Below this force on the load cell nothing is pressed, newtons.
_FREE_N = 0.1
#: A movement shows the shape of the friction over at least this way, mm.
_LONG_MM = 5.0
#: The map's spacing and smoothing, mm: finer than the teeth of a small servo's last gears.
_SPACING_MM, _SMOOTHING_MM = 0.5, 0.4
#: From this many short movements on their own scatter is believed; before that, this share of the
#: friction is taken for it (a guess for small geared servos, between a tenth and a quarter).
_FEWEST_MOVEMENTS, _TYPICAL_GEAR_FRACTION = 10, 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentLaw:
    """current = gears + slope * force, while closing."""

    #: Current without load.
    gears: GearFriction
    #: The slope.
    ma_per_n: float
    #: Scatter of a single reading.
    noise_ma: float

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> CurrentLaw:
        """Fit the line to readings on a load cell and without load, if any.

        Raises `CalibrationError` if the readings are too few, or the current does not rise with the
        force.

        >>> force_n = np.linspace(0.0, 10.0, 40)
        >>> current_ma = 40.0 + 16.0 * force_n + np.tile([3.0, -3.0], 20)
        >>> law = CurrentLaw.fit(
        ...     CurrentPairs(force_n=tuple(force_n), current_ma=tuple(current_ma))
        ... )
        >>> round(law.gears.mean_ma), round(law.ma_per_n), round(law.noise_ma)
        (40, 16, 3)
        """
        force = np.array(pairs.force_n)
        reach_n = float(np.ptp(force)) if force.size else 0.0
        if force.size < _FEWEST or reach_n < _RANGE_N:
            raise CalibrationError(
                f"current calibration: {force.size} readings over {reach_n:.1f} N; "
                f"at least {_FEWEST} over {_RANGE_N:g} N are needed"
            )
        gears = GearFriction.fit(pairs)
        slope, zero, noise_ma = _line(pairs, gears)
        if slope <= 0:
            raise CalibrationError(
                "current calibration: the current must rise with the force; does the servo report "
                "the current of the fingers' drive, with the sign of closing?"
            )
        if gears is None:
            usual_ma = _TYPICAL_FRACTION * abs(zero)
            gears = GearFriction(mean_ma=zero, mean_sd_ma=usual_ma, movement_ma=usual_ma)
        return cls(gears=gears, ma_per_n=slope, noise_ma=noise_ma)

    def measure(
        self,
        current_ma: ArrayLike,
        *,
        share: ArrayLike,
        width_mm: ArrayLike,
        movement: ArrayLike,
        tilt_sd: float = 0.0,
    ) -> MeasuredForce | None:
        """Return the force at the end of a closing; None without a reading under load.

        A sheet that is blind to faint forces gives shares that are too small, the more so the
        smaller they are: force = share * end + (1 - share) * blind, `blind` some tenths of a
        newton. Readings of one movement share its error of friction.

        `current_ma`, `width_mm`, shape (n,): readings while closing, and where.
        `share`, shape (n,): force at each, as a fraction of that at the end, by the sheet.
        `movement`, shape (n,): equal for readings of one movement.
        `tilt_sd`: scatter of the exponent of the sheet that gave the shares.

        >>> gears = GearFriction(mean_ma=40.0, mean_sd_ma=0.0, movement_ma=0.0)
        >>> law = CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0)
        >>> share = np.linspace(0.5, 1.0, 12)
        >>> found = law.measure(
        ...     40 + 16 * 5.0 * share, share=share, width_mm=30 - share, movement=[0] * 12
        ... )
        >>> abs(found.force_n - 5.0) < 0.1, round(found.sd_n, 2)
        (True, 0.15)
        """
        share = np.asarray(share, dtype=float)
        if not share.size or not share.max() > _MIN_FRACTION:
            return None
        gears_ma = self.gears.at(np.asarray(width_mm, dtype=float))
        force_n = (np.asarray(current_ma, dtype=float) - gears_ma) / self.ma_per_n
        noise_n, movement_n = self.noise_ma / self.ma_per_n, self.gears.movement_ma / self.ma_per_n
        alike = np.equal.outer(np.asarray(movement), np.asarray(movement))
        design = np.column_stack([share, 1.0 - share])
        end_n = 0.0
        # Twice: how much friction scatters depends on the force.
        for _ in range(2):
            moved_n = movement_n * (1.0 + self._load_fraction(end_n) * share)
            scatter = noise_n**2 * np.eye(share.size) + alike * np.outer(moved_n, moved_n)
            weighed = np.linalg.solve(scatter, design)
            covariance = np.linalg.inv(design.T @ weighed + np.diag([0.0, 1.0 / _THRESHOLD_N**2]))
            end_n = float((covariance @ (weighed.T @ force_n))[0])
        mean_sd_n = self.gears.mean_sd_ma / self.ma_per_n
        seen = share[share > _MIN_FRACTION]
        tilted = tilt_sd * float(np.average(np.log(seen), weights=seen**2))
        return MeasuredForce(
            force_n=end_n,
            sd_n=float(np.hypot(np.sqrt(covariance[0, 0]), mean_sd_n)),
            log_sd=float(np.linalg.norm([WARMTH_SD, _SHAPE_SD, tilted])),
        )

    def _load_fraction(self, force_n: float) -> float:
        """Return by which fraction of itself the friction grows under a force."""
        free_ma = max(self.gears.mean_ma, 1e-9)
        return min(_LOAD_FRACTION * self.ma_per_n * max(force_n, 0.0) / free_ma, 2.0)


def _line(pairs: CurrentPairs, gears: GearFriction | None) -> tuple[float, float, float]:
    """Return slope (mA/N), current without load, and the scatter of readings, mA.

    Every movement has an offset of its own, so that friction that differs tilts no line.
    """
    force, current = np.array(pairs.force_n), np.array(pairs.current_ma)
    number = np.array(pairs.movement or (0,) * force.size)
    if gears is not None:
        current = current - (gears.at(np.array(pairs.width_mm)) - gears.mean_ma)
    offsets = np.equal.outer(number, np.unique(number)).astype(float)
    design = np.column_stack([force, offsets])
    found = np.linalg.lstsq(design, current, rcond=None)[0]
    left = current - design @ found
    freedom = max(force.size - found.size, 1)
    return float(found[0]), float(found[1:].mean()), float(np.sqrt(left @ left / freedom))


@dataclass(frozen=True, slots=True, kw_only=True)
class GearFriction:
    """Servo current of an empty hand that closes."""

    #: Over the way, and how well that is known.
    mean_ma: float
    mean_sd_ma: float
    #: Scatter from movement to movement.
    movement_ma: float
    #: Increase at widths, rising; empty where no long movement showed it.
    along_mm: tuple[float, ...] = ()
    along_ma: tuple[float, ...] = ()

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> GearFriction | None:
        """Fit to the readings without load; None where no movement has several of them.

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
            movement_ma = _TYPICAL_GEAR_FRACTION * abs(mean_ma)
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
