"""Force from the servo's current while the fingers close: a second witness beside the sheet.

While a servo closes, the friction of its gears adds to the grip in full, so current is a line in
force. At rest it is not: there friction holds any part of itself either way. One reading is coarse
(some tenths of a newton), but a closing has many, and the sheet tells how the force rose from one
to the next. What they say together of the force at the end is as good as a calibrated sheet, and
knows nothing of wear or of where on the sheet the object lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import CalibrationError
from palpate.estimate.gain import MeasuredForce
from palpate.estimate.sheet_current import WARMTH_SD
from palpate.sensor.current_pairs import CurrentPairs

#: A calibration of the current needs so many readings under load, and this range of force.
_FEWEST, _RANGE_N = 10, 2.0
#: How the force rose is told by a sheet that lags, and the thing relaxes a little once the fingers
#: stand: a few percent off, the same for all readings.
_SHAPE_SD = 0.05
#: What a sheet may not show of a force (threshold of its pixels, typical), newtons, and the least
#: share of the final force that a reading must have to say anything of it.
_BLIND_N, _LEAST_SHARE = 0.25, 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentLaw:
    """current = zero + slope * force, while closing.

    Attributes
    ----------
    zero_ma, ma_per_n : float
        The line.
    zero_sd_ma, noise_ma : float
        Doubt of its zero, and scatter of a single reading.
    """

    zero_ma: float
    ma_per_n: float
    zero_sd_ma: float
    noise_ma: float

    @classmethod
    def fit(cls, pairs: CurrentPairs) -> CurrentLaw:
        """Fit the line.

        Raises
        ------
        CalibrationError
            If the readings are too few, or the current does not rise with the force.

        Examples
        --------
        >>> force_n = np.linspace(0.0, 10.0, 40)
        >>> current_ma = 40.0 + 16.0 * force_n + np.tile([3.0, -3.0], 20)
        >>> law = CurrentLaw.fit(
        ...     CurrentPairs(force_n=tuple(force_n), current_ma=tuple(current_ma))
        ... )
        >>> round(law.zero_ma), round(law.ma_per_n), round(law.noise_ma)
        (40, 16, 3)
        """
        force, current = np.array(pairs.force_n), np.array(pairs.current_ma)
        reach_n = float(np.ptp(force)) if force.size else 0.0
        if force.size < _FEWEST or reach_n < _RANGE_N:
            raise CalibrationError(
                f"current calibration: {force.size} readings over {reach_n:.1f} N; "
                f"at least {_FEWEST} over {_RANGE_N:g} N are needed"
            )
        (slope, zero), covariance = np.polyfit(force, current, 1, cov=True)
        if slope <= 0:
            raise CalibrationError(
                "current calibration: the current must rise with the force; does the servo report "
                "the current of the fingers' drive, with the sign of closing?"
            )
        left = current - zero - slope * force
        return cls(
            zero_ma=float(zero),
            ma_per_n=float(slope),
            zero_sd_ma=float(np.sqrt(covariance[1, 1])),
            noise_ma=float(np.sqrt(left @ left / (force.size - 2))),
        )

    def measured(self, current_ma: ArrayLike, *, share: ArrayLike) -> MeasuredForce | None:
        """Return the force at the end of a closing; None if no reading is of a grip.

        A sheet that is blind to faint forces tells shares that are too small, the more so the
        smaller they are: force = share * end + (1 - share) * blind, `blind` some tenths of a
        newton.

        Parameters
        ----------
        current_ma : array_like, shape (n,)
            Readings while closing.
        share : array_like, shape (n,)
            Force at each, as a share of that at the end, by the sheet.

        Examples
        --------
        >>> law = CurrentLaw(zero_ma=40.0, ma_per_n=16.0, zero_sd_ma=0.0, noise_ma=6.0)
        >>> share = np.linspace(0.5, 1.0, 12)
        >>> found = law.measured(40 + 16 * 5.0 * share, share=share)
        >>> abs(found.force_n - 5.0) < 0.1, round(found.sd_n, 2)
        (True, 0.15)
        """
        share = np.asarray(share, dtype=float)
        if not share.size or not share.max() > _LEAST_SHARE:
            return None
        force_n = (np.asarray(current_ma, dtype=float) - self.zero_ma) / self.ma_per_n
        noise_n = self.noise_ma / self.ma_per_n
        design = np.column_stack([share, 1.0 - share]) / noise_n
        precision = design.T @ design + np.diag([0.0, 1.0 / _BLIND_N**2])
        covariance = np.linalg.inv(precision)
        end_n = float((covariance @ (design.T @ force_n))[0] / noise_n)
        return MeasuredForce(
            force_n=end_n,
            sd_n=float(np.hypot(np.sqrt(covariance[0, 0]), self.zero_sd_ma / self.ma_per_n)),
            log_sd=float(np.hypot(WARMTH_SD, _SHAPE_SD)),
        )
