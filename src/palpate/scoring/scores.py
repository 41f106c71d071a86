"""How good predictions of the settled value are, against the value that the hold settled to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Predictions against settled values, hold by hold; NaN where a hold has no settled value."""

    #: Shape (n_holds,). (predicted - settled) / abs(settled).
    error_percent: FloatArray
    #: Shape (n_holds,). abs(predicted - settled) / abs(settled - recorded at the cut-off): what is
    #: still missing of the change that was still to come. It does not depend on unit or baseline.
    of_remaining_percent: FloatArray
    #: Shape (n_holds,). Half of the interval, in percent of abs(settled).
    half_width_percent: FloatArray
    #: Shape (n_holds,). 1 where the interval holds the settled value, 0 where not, NaN where either
    #: is unknown.
    covered: FloatArray


def score(
    predicted: ArrayLike,
    *,
    low: ArrayLike,
    high: ArrayLike,
    settled: ArrayLike,
    recorded: ArrayLike,
) -> Scores:
    """Score predictions, each of shape (n_holds,), against the values they were to predict.

    >>> scores = score([104.0], low=[98.0], high=[110.0], settled=[100.0], recorded=[120.0])
    >>> scores.error_percent.item(), scores.of_remaining_percent.item(), scores.covered.item()
    (4.0, 20.0, 1.0)
    """
    value, bottom, top, target, last = (
        np.asarray(array, dtype=np.float64) for array in (predicted, low, high, settled, recorded)
    )
    known = np.isfinite(bottom) & np.isfinite(top) & np.isfinite(target)
    return Scores(
        error_percent=_percent(value - target, np.abs(target)),
        of_remaining_percent=_percent(np.abs(value - target), np.abs(target - last)),
        half_width_percent=_percent((top - bottom) / 2, np.abs(target)),
        covered=np.where(known, (bottom <= target) & (target <= top), np.nan),
    )


def _percent(part: FloatArray, whole: FloatArray) -> FloatArray:
    share = np.full(part.shape, np.nan)
    np.divide(100 * part, whole, out=share, where=whole > 0)
    return share


def median(values: FloatArray) -> float:
    """Return the median of the finite values; NaN if there are none."""
    return quantile(values, 0.5)


def quantile(values: FloatArray, share: float) -> float:
    """Return a quantile of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, share)) if finite.size else float("nan")


def mean(values: FloatArray) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def summarise(scores: Scores) -> dict[str, float]:
    """Return the summary that `palpate settle --json` prints for one method and cut-off.

    A figure that no hold gives is NaN.
    """
    size = np.abs(scores.error_percent)
    return {
        "median_abs_error_percent": median(size),
        "mean_abs_error_percent": mean(size),
        "p90_abs_error_percent": quantile(size, 0.9),
        "median_error_of_remaining_percent": median(scores.of_remaining_percent),
        "coverage": mean(scores.covered),
        "median_half_width_percent": median(scores.half_width_percent),
    }
