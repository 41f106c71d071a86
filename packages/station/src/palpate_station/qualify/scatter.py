"""Scatter of an instrument across items and sides, and the line relating two instruments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from palpate.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Standard deviations from a one-way analysis of variance (random effects, unequal groups).

    Attributes
    ----------
    between, within : float
        Standard deviation between items, and between readings of one item. `within` is NaN if no
        item has two readings, and `between` is then the total standard deviation.
    """

    between: float
    within: float

    @property
    def repeatability(self) -> float:
        """Intraclass correlation.

        It is the upper limit of R squared between single readings of this instrument and any other
        instrument, even an error-free one.
        """
        total = self.between**2 + self.within**2
        return self.between**2 / total if total > 0 else math.nan

    def fraction_within(self, tolerance: float) -> float:
        """Return the fraction of single readings within `tolerance` of the item's mean."""
        if not self.within > 0:
            return math.nan
        return float(2.0 * ndtr(tolerance / self.within) - 1.0)


def estimate_scatter(values: FloatArray, item: NDArray[np.intp]) -> Scatter:
    """Return the scatter of readings, ignoring NaN.

    Parameters
    ----------
    values : ndarray, shape (n_rows,)
        Readings of one instrument.
    item : ndarray of int, shape (n_rows,)
        Item of each reading.

    References
    ----------
    S. R. Searle, G. Casella, C. E. McCulloch, "Variance Components" (1992), section 3.6.

    Examples
    --------
    >>> random = np.random.default_rng(1)
    >>> item = np.repeat(np.arange(400), 2)
    >>> values = random.normal(0, 2.0, 400)[item] + random.normal(0, 1.0, 800)
    >>> scatter = estimate_scatter(values, item)
    >>> round(scatter.between, 1), round(scatter.within, 1)
    (1.8, 1.0)
    """
    is_read = np.isfinite(values)
    read, groups = values[is_read], item[is_read]
    present, group = np.unique(groups, return_inverse=True)
    count = np.bincount(group)
    n, k = read.size, present.size
    if k < 2 or n == k:
        spread = float(read.std(ddof=1)) if n > 1 else math.nan
        return Scatter(between=spread, within=math.nan)
    mean = np.bincount(group, weights=read) / count
    within_square = float(((read - mean[group]) ** 2).sum()) / (n - k)
    between_square = float((count * (mean - read.mean()) ** 2).sum()) / (k - 1)
    per_item = (n - float((count**2).sum()) / n) / (k - 1)
    return Scatter(
        between=math.sqrt(max(0.0, (between_square - within_square) / per_item)),
        within=math.sqrt(within_square),
    )


def deming_lines(
    x: FloatArray, y: FloatArray, *, ratio: float, leave_out: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return slope and offset of `y` over `x` from a Deming regression (errors in both).

    Parameters
    ----------
    x, y : ndarray, shape (n_items,)
        Mean of each instrument for each item.
    ratio : float
        Error variance of `y` divided by the error variance of `x`. For NaN or 0 the ratio of the
        total variances is used.
    leave_out : bool
        Whether to return, for each item, the line through all other items: two arrays of shape
        (n_items,).

    References
    ----------
    K. Linnet, "Evaluation of regression procedures for methods comparison studies", Clin. Chem. 39
    (1993) 424.

    Examples
    --------
    >>> slope, offset = deming_lines(np.arange(3.0), np.array([1.0, 3.0, 5.0]), ratio=1.0)
    >>> float(slope), float(offset)
    (2.0, 1.0)
    """
    terms = np.array([np.ones_like(x), x, y, x * x, y * y, x * y])
    n, sx, sy, xx, yy, xy = terms.sum(axis=1)[:, None] - terms if leave_out else terms.sum(axis=1)
    sxx = np.maximum(xx - sx * sx / n, 0.0)
    syy = np.maximum(yy - sy * sy / n, 0.0)
    sxy = xy - sx * sy / n
    with np.errstate(divide="ignore", invalid="ignore"):
        error_ratio = ratio if math.isfinite(ratio) and ratio > 0 else syy / sxx
        difference = syy - error_ratio * sxx
        slope = (difference + np.sqrt(difference**2 + 4.0 * error_ratio * sxy**2)) / (2.0 * sxy)
    # For equal items or uncorrelated readings the slope is 0.
    slope = np.where(np.isfinite(slope), slope, 0.0)
    return slope, (sy - slope * sx) / n


#: Default tolerance without repeated readings, as a fraction of the scatter between items (guess).
_TOLERANCE_FRACTION = 0.5


def default_tolerance(reference: Scatter) -> float:
    """Return the tolerance for a buyer who names none: the scatter of the reference itself.

    >>> default_tolerance(Scatter(between=3.0, within=0.5))
    0.5
    >>> default_tolerance(Scatter(between=3.0, within=math.nan))
    1.5
    """
    return reference.within if reference.within > 0 else _TOLERANCE_FRACTION * reference.between
