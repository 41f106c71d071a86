"""How many posterior standard deviations an interval takes, by theory or by calibration holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from palpate.arrays import FloatArray

#: How much wider the interval is than the mixture gives, without calibration: no prior holds every
#: shape. Chosen on training holds, see `docs/prediction.md`.
WIDENING = 1.5
#: Calibration residuals count against this many imagined ones that follow the default.
PRIOR_RESIDUALS = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IntervalScale:
    """Half-widths of intervals in units of the predictor's own standard deviation."""

    #: Shape (n_windows,). Window lengths at which calibration residuals were taken, increasing;
    #: empty without.
    window_s: FloatArray
    #: For each window, the absolute residuals over the standard deviations, sorted.
    residuals: tuple[FloatArray, ...]

    def widening(self, window_s: float, *, level: float) -> float:
        """Return how much wider the interval is than the predictor's own quantiles.

        >>> UNCALIBRATED.widening(1.0, level=0.9)
        1.5
        """
        if self.window_s.size == 0:
            return WIDENING
        normal = float(ndtri((1 + level) / 2))
        known = [
            _shrunk_quantile(r, level=level, default=WIDENING * normal) for r in self.residuals
        ]
        log_window = np.log(max(window_s, self.window_s[0] / 10))
        return float(np.interp(log_window, np.log(self.window_s), known)) / normal


def _shrunk_quantile(residuals: FloatArray, *, level: float, default: float) -> float:
    """Return the residuals' quantile, drawn towards the default as if by imagined residuals."""
    n = residuals.size
    if n == 0:
        return default
    # The conformal rank: of n + 1 exchangeable residuals, the new one is as likely to be any.
    quantile = float(np.quantile(residuals, min(1.0, level * (n + 1) / n)))
    return (n * quantile + PRIOR_RESIDUALS * default) / (n + PRIOR_RESIDUALS)


UNCALIBRATED = IntervalScale(window_s=np.empty(0), residuals=())
