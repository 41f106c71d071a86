"""How many posterior standard deviations an interval takes, by theory or by calibration holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from palpate.settling.result import FloatArray

#: Degrees of freedom of the interval without calibration: real residuals have heavier tails than a
#: Gaussian, because contact bounces and slips are in no prior.
DEFAULT_DEGREES = 5.0
#: Calibration residuals count against this many imagined ones that follow the default.
PRIOR_RESIDUALS = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IntervalScale:
    """Half-widths of intervals in units of the predictor's own standard deviation.

    Attributes
    ----------
    window_s : ndarray, shape (n_windows,)
        Window lengths at which calibration residuals were taken, increasing; empty without.
    residuals : tuple of ndarray
        For each window, the absolute residuals over the standard deviations, sorted.
    """

    window_s: FloatArray
    residuals: tuple[FloatArray, ...]

    def half_widths(self, window_s: FloatArray, *, level: float) -> FloatArray:
        """Return the multiple of the standard deviation for each window length.

        Parameters
        ----------
        window_s : ndarray, shape (n_holds,)
            Length of the stretch that each prediction rests on.
        level : float
            Probability to cover, in (0, 1).

        Returns
        -------
        ndarray, shape (n_holds,)

        Examples
        --------
        >>> UNCALIBRATED.half_widths(np.array([1.0]), level=0.9).round(3)
        array([2.015])
        """
        default = float(stdtrit(DEFAULT_DEGREES, (1 + level) / 2))
        if self.window_s.size == 0:
            return np.full(window_s.shape, default)
        known = np.array(
            [_shrunk_quantile(r, level=level, default=default) for r in self.residuals]
        )
        log_window = np.log(np.maximum(window_s, self.window_s[0] / 10))
        return np.asarray(np.interp(log_window, np.log(self.window_s), known))


def _shrunk_quantile(residuals: FloatArray, *, level: float, default: float) -> float:
    """Return the residuals' quantile, drawn towards the default as if by imagined residuals."""
    n = residuals.size
    if n == 0:
        return default
    # The conformal rank: of n + 1 exchangeable residuals, the new one is as likely to be any.
    quantile = float(np.quantile(residuals, min(1.0, level * (n + 1) / n)))
    return (n * quantile + PRIOR_RESIDUALS * default) / (n + PRIOR_RESIDUALS)


UNCALIBRATED = IntervalScale(window_s=np.empty(0), residuals=())
