"""What error to expect of a law fitted to dead weights: each load left out once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.observer_sheet_fit import error_near


def held_out_of_pairs(excess: ArrayLike, *, force_n: ArrayLike) -> dict[str, float | None]:
    """Return the median error near 1, 5 and 10 N of loads left out of the fit, percent.

    All readings of one load are left out together; None where no load is near, or where the others
    can't carry a law.
    """
    x, y = np.asarray(excess, dtype=float), np.asarray(force_n, dtype=float)
    error = np.full(y.shape, np.nan)
    for load in np.unique(y):
        mine = y == load
        try:
            law = PowerForceLaw.fit(x[~mine], force_n=y[~mine])
        except CalibrationError:
            continue
        error[mine] = np.abs(law.force_n(x[mine]).value / load - 1.0)
    known = np.isfinite(error)
    return error_near(np.log(y[known]), error[known])
