"""Correction for temperature and humidity, learned from a reference load at known conditions.

The relative change takes the drift of the rest value out (paper, Figure 3); what is left is the
drift of the gain. A user learns it by the same reference load (a weight, a block at one width) at
two conditions or more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError

#: Steps of temperature (K) and humidity (%) that count alike where the calibrations can't separate
#: the two, and how far beyond them the correction still holds.
_SCALE = np.array([10.0, 30.0])
_BEYOND = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Surroundings of a sensor."""

    temperature_c: float
    humidity_percent: float

    @property
    def scaled(self) -> FloatArray:
        """Both in steps that count alike."""
        return np.asarray(np.array([self.temperature_c, self.humidity_percent]) / _SCALE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionsCorrection:
    """ln gain as a plane over temperature and humidity, through the calibrations.

    Two calibrations give its slope along the line between them and none across; three that are not
    in line give the plane.
    """

    #: Where readings are corrected to: the first calibration.
    reference: Conditions
    #: Of ln excess conductance, per scaled step of temperature and of humidity.
    slope: tuple[float, float]
    #: The calibrations.
    seen: tuple[Conditions, ...]

    @classmethod
    def fit(cls, excess: ArrayLike, *, conditions: Sequence[Conditions]) -> ConditionsCorrection:
        """Learn from one reference load, read at each of the conditions.

        Parameters
        ----------
        excess : array_like, shape (calibrations,)
            Excess conductance of the reference load, settled; the rest taken at the same condition.
        conditions : sequence of Conditions
            At least two different ones; the first is what readings will be corrected to.

        Raises
        ------
        CalibrationError
            If there are fewer than two conditions, or a reading shows no load.

        Examples
        --------
        >>> cool, warm = (Conditions(temperature_c=t, humidity_percent=45) for t in (15, 25))
        >>> learned = ConditionsCorrection.fit([10.0, 12.0], conditions=[cool, warm])
        >>> learned.corrected(12.0, at=warm).round(6).item()
        10.0
        """
        values = np.asarray(excess, dtype=float)
        if len({(c.temperature_c, c.humidity_percent) for c in conditions}) < 2:
            raise CalibrationError(
                "conditions: the reference load was read at one condition only; repeat it where it "
                "is warmer, colder, drier or damper"
            )
        if values.shape != (len(conditions),):
            raise ValueError(f"{len(conditions)} conditions need as many readings")
        if not (np.isfinite(values) & (values > 0)).all():
            raise CalibrationError(
                "conditions: a reading of the reference load shows no load; is it on the sensor?"
            )
        reference = conditions[0]
        steps = np.array([one.scaled - reference.scaled for one in conditions])
        # The shortest solution: no slope in a direction that was never tried.
        slope = np.linalg.lstsq(steps[1:], np.log(values[1:] / values[0]), rcond=None)[0]
        return cls(
            reference=reference, slope=(float(slope[0]), float(slope[1])), seen=tuple(conditions)
        )

    def corrected(self, excess: ArrayLike, *, at: Conditions) -> FloatArray:
        """Return what an excess conductance would be at the reference, of any shape."""
        log_gain = float(np.array(self.slope) @ (at.scaled - self.reference.scaled))
        return np.asarray(np.asarray(excess, dtype=float) * np.exp(-log_gain))

    def corrected_percent(self, change_percent: ArrayLike, *, at: Conditions) -> FloatArray:
        """Return what a pixel's relative change would be at the reference, percent."""
        ratio = 1.0 + np.asarray(change_percent, dtype=float) / 100.0
        # A pixel that reads short has no ratio: it stays at -100 %.
        conductance = np.divide(1.0, ratio, out=np.full(ratio.shape, np.inf), where=ratio > 0)
        excess = self.corrected(conductance - 1.0, at=at)
        return 100.0 * (1.0 / (1.0 + excess) - 1.0)

    def reaches(self, at: Conditions) -> bool:
        """Return whether conditions lie within the calibrations, or half of their span beyond."""
        points = np.array([one.scaled for one in self.seen])
        low, high = points.min(axis=0), points.max(axis=0)
        # An axis that was not tried may differ by a tenth of a step.
        room = np.maximum(_BEYOND * (high - low), 0.1)
        return bool(np.all((at.scaled >= low - room) & (at.scaled <= high + room)))
