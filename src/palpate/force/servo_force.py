"""Force from the servo current during closing: a measurement in addition to the sheet's.

While a servo closes, gear friction adds to the grip force, so the current is linear in the force.
At rest it is not, because friction may carry part of the grip in either direction. A single reading
has an uncertainty of some tenths of a newton. So has a single movement, because friction differs
between movements. A closing has several movements, and the sheet shows the relative rise of force
over them. Together they determine the final force as accurately as a calibrated sheet, independent
of wear and of the object's position on the sheet.

Gear friction without load has two parts. One depends on the position of the gear teeth, and is
measured with an empty hand that closes slowly. The other is constant within a movement and differs
between movements; its size is the scatter of many short movements.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.calibration import CurrentPairs
from palpate.errors import CalibrationError
from palpate.force.gain import MeasuredForce

#: Fewest readings under load in a calibration of the current, and their smallest range of force.
_FEWEST, _RANGE_N = 10, 2.0
#: Relative error common to all readings: the lag of the sheet is uncertain, and the object relaxes
#: slightly after the fingers stop.
_SHAPE_SD = 0.03
#: Relative change of torque per current with motor temperature, between sessions: copper and
#: magnets lose a few percent from cold to warm.
WARMTH_SD = 0.035
#: Typical threshold force of a sheet, newtons, and the smallest usable fraction of the final force.
_THRESHOLD_N, _MIN_FRACTION = 0.25, 0.3
#: Friction due to load, relative to the grip (guess for small geared servos: 0.05 to 0.25). Its
#: scatter is not measurable with an empty hand.
_LOAD_FRACTION = 0.15
#: Without an empty-hand calibration: relative scatter of friction between movements and along the
#: travel (guess for small geared servos: 0.1 to 0.25).
_TYPICAL_FRACTION = 0.15

#: Largest load-cell force without load, newtons.
_FREE_N = 0.1
#: Shortest travel of a movement that determines the friction along the travel, mm.
_LONG_MM = 5.0
#: Spacing and smoothing of the friction map, mm: finer than the teeth of a small servo's last gear.
_SPACING_MM, _SMOOTHING_MM = 0.5, 0.4
#: Fewest short movements for a measured scatter of friction. With fewer, this fraction of the
#: friction is assumed (guess for small geared servos: 0.1 to 0.25).
_FEWEST_MOVEMENTS, _TYPICAL_GEAR_FRACTION = 10, 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentLaw:
    """current = gears + slope * force, while closing."""

    #: Current without load.
    gears: GearFriction
    #: Slope of current over force.
    ma_per_n: float
    #: Scatter of a single reading.
    noise_ma: float

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> CurrentLaw:
        """Fit the law to readings on a load cell and, if available, without load.

        Raises `CalibrationError` if there are too few readings, or the current does not rise with
        the force.

        >>> force_n = np.linspace(0.0, 10.0, 40)
        >>> current_ma = 40.0 + 16.0 * force_n + np.tile([3.0, -3.0], 20)
        >>> law = CurrentLaw.fit(
        ...     CurrentPairs(force_n=tuple(force_n), current_ma=tuple(current_ma))
        ... )
        >>> round(law.gears.mean_ma), round(law.ma_per_n), round(law.noise_ma)
        (40, 16, 3)
        """
        force = np.array(pairs.force_n)
        range_n = float(np.ptp(force)) if force.size else 0.0
        if force.size < _FEWEST or range_n < _RANGE_N:
            raise CalibrationError(
                f"current calibration: {force.size} readings over {range_n:.1f} N; "
                f"at least {_FEWEST} readings over {_RANGE_N:g} N are needed"
            )
        gears = GearFriction.fit(pairs)
        slope, zero, noise_ma = _fit_line(pairs, gears)
        if slope <= 0:
            raise CalibrationError(
                "current calibration: the current must rise with the force; check that the servo "
                "reports its motor current, positive when closing"
            )
        if gears is None:
            usual_ma = _TYPICAL_FRACTION * abs(zero)
            gears = GearFriction(mean_ma=zero, mean_sd_ma=usual_ma, movement_ma=usual_ma)
        return cls(gears=gears, ma_per_n=slope, noise_ma=noise_ma)

    def measure(
        self,
        current_ma: ArrayLike,
        *,
        fraction: ArrayLike,
        width_mm: ArrayLike,
        movement: ArrayLike,
        tilt_sd: float = 0.0,
    ) -> MeasuredForce | None:
        """Estimate the force at the end of a closing; None without a reading under load.

        The sheet's threshold makes its fractions too small, especially the small ones:
        force = fraction * end + (1 - fraction) * threshold, with a threshold of some tenths of a
        newton. Readings of one movement have the same error of friction.

        `current_ma`, `width_mm`, shape (n,): current readings while closing, and their widths.
        `fraction`, shape (n,): force at each reading relative to the end, from the sheet.
        `movement`, shape (n,): equal for readings of one movement.
        `tilt_sd`: scatter of the sheet's exponent.

        >>> gears = GearFriction(mean_ma=40.0, mean_sd_ma=0.0, movement_ma=0.0)
        >>> law = CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0)
        >>> fraction = np.linspace(0.5, 1.0, 12)
        >>> found = law.measure(
        ...     40 + 80 * fraction, fraction=fraction, width_mm=30 - fraction, movement=[0] * 12
        ... )
        >>> abs(found.force_n - 5.0) < 0.1, round(found.sd_n, 2)
        (True, 0.15)
        """
        fraction = np.asarray(fraction, dtype=float)
        if not fraction.size or not fraction.max() > _MIN_FRACTION:
            return None
        gears_ma = self.gears.mean_current_ma(np.asarray(width_mm, dtype=float))
        force_n = (np.asarray(current_ma, dtype=float) - gears_ma) / self.ma_per_n
        noise_n, movement_n = self.noise_ma / self.ma_per_n, self.gears.movement_ma / self.ma_per_n
        movements = np.equal.outer(np.asarray(movement), np.unique(movement))
        design = np.column_stack([fraction, 1.0 - fraction])
        end_n = 0.0
        # Two iterations, because the scatter of friction depends on the force.
        for _ in range(2):
            moved_n = movement_n * (1.0 + self._load_fraction(end_n) * fraction)
            moved = movements * moved_n[:, np.newaxis]
            # Inverse of the covariance noise_n**2 * I + moved @ moved.T (Sherman-Morrison): a
            # solution with the matrix itself takes seconds for the readings of a long squeeze.
            shared = moved.T @ design / (noise_n**2 + np.sum(moved**2, axis=0))[:, np.newaxis]
            weighed = (design - moved @ shared) / noise_n**2
            covariance = np.linalg.inv(design.T @ weighed + np.diag([0.0, 1.0 / _THRESHOLD_N**2]))
            end_n = float((covariance @ (weighed.T @ force_n))[0])
        mean_sd_n = self.gears.mean_sd_ma / self.ma_per_n
        seen = fraction[fraction > _MIN_FRACTION]
        tilted = tilt_sd * float(np.average(np.log(seen), weights=seen**2))
        return MeasuredForce(
            force_n=end_n,
            sd_n=float(np.hypot(np.sqrt(covariance[0, 0]), mean_sd_n)),
            log_sd=float(np.linalg.norm([WARMTH_SD, _SHAPE_SD, tilted])),
        )

    def _load_fraction(self, force_n: float) -> float:
        """Return the relative increase of friction under a force."""
        free_ma = max(self.gears.mean_ma, 1e-9)
        return min(_LOAD_FRACTION * self.ma_per_n * max(force_n, 0.0) / free_ma, 2.0)


def _fit_line(pairs: CurrentPairs, gears: GearFriction | None) -> tuple[float, float, float]:
    """Return slope (mA/N), current without load, and scatter of readings (mA).

    Each movement has its own offset, so that different friction does not change the slope.
    """
    force, current = np.array(pairs.force_n), np.array(pairs.current_ma)
    number = np.array(pairs.movement or (0,) * force.size)
    if gears is not None:
        current = current - (gears.mean_current_ma(np.array(pairs.width_mm)) - gears.mean_ma)
    offsets = np.equal.outer(number, np.unique(number)).astype(float)
    design = np.column_stack([force, offsets])
    found = np.linalg.lstsq(design, current, rcond=None)[0]
    errors = current - design @ found
    freedom = max(force.size - found.size, 1)
    return float(found[0]), float(found[1:].mean()), float(np.sqrt(errors @ errors / freedom))


@dataclass(frozen=True, slots=True, kw_only=True)
class GearFriction:
    """Servo current of an empty closing hand."""

    #: Mean over the travel, and its uncertainty.
    mean_ma: float
    mean_sd_ma: float
    #: Scatter between movements.
    movement_ma: float
    #: Shape (n,). Deviation from the mean at increasing widths; empty without a long movement.
    along_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    along_ma: FloatArray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> GearFriction | None:
        """Fit to the readings without load; None if no movement has several of them.

        Two long and twelve short closings, with a friction of 40 mA, and 44 mA at 20 mm:

        >>> travel_mm = np.linspace(40.0, 10.0, 300)
        >>> gears_ma = lambda mm: 40.0 + 4.0 * np.exp(-(((mm - 20.0) / 2.0) ** 2))
        >>> width_mm = np.concatenate([travel_mm, travel_mm, travel_mm[:36]])
        >>> movement = np.repeat(np.arange(14), [300, 300] + 12 * [3])
        >>> found = GearFriction.fit(CurrentPairs(
        ...     force_n=(0.0,) * 636, current_ma=tuple(gears_ma(width_mm)),
        ...     width_mm=tuple(width_mm), movement=tuple(movement)))
        >>> round(found.mean_ma), found.mean_current_ma(np.array([12.0, 20.0])).round().tolist()
        (40, [40.0, 44.0])
        """
        free = np.array(pairs.force_n) < _FREE_N
        runs = _find_unloaded_movements(pairs, free) if pairs.movement else []
        if not runs:
            return None
        travels_mm = [float(np.ptp(width)) for width, _ in runs]
        long = [travel_mm > max(_LONG_MM, 0.5 * max(travels_mm)) for travel_mm in travels_mm]
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
            along_mm=at_mm,
            along_ma=mean_ma * (shape - 1.0),
        )

    def mean_current_ma(self, width_mm: FloatArray) -> FloatArray:
        """Return the mean friction current at each width, mA."""
        if not self.along_mm.size:
            return np.full_like(width_mm, self.mean_ma)
        return self.mean_ma + np.interp(width_mm, self.along_mm, self.along_ma)


def _find_unloaded_movements(
    pairs: CurrentPairs, free: NDArray[np.bool_]
) -> list[tuple[FloatArray, FloatArray]]:
    """Return widths and currents of each movement with several readings without load."""
    movement = np.where(free, pairs.movement, -1)
    width, current = np.array(pairs.width_mm), np.array(pairs.current_ma)
    numbers, counts = np.unique(movement[free], return_counts=True)
    return [(width[movement == one], current[movement == one]) for one in numbers[counts > 1]]


def _shape(runs: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return a grid of widths, and the smoothed relative friction at each width.

    Each current is divided by the mean current of its movement before the smoothing.
    """
    if not runs:
        return np.zeros(1), np.ones(1)
    width = np.concatenate([width for width, _ in runs])
    fraction = np.concatenate([current / current.mean() for _, current in runs])
    at_mm = np.arange(width.min(), width.max() + _SPACING_MM, _SPACING_MM)
    near = np.exp(-0.5 * ((at_mm[:, None] - width) / _SMOOTHING_MM) ** 2)
    return at_mm, np.asarray(near @ fraction / near.sum(axis=1))
