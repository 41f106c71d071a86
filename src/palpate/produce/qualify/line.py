"""Deming regression: a line between two instruments that both have errors."""

from __future__ import annotations

import math

import numpy as np

from palpate.arrays import FloatArray


def deming_line(x: FloatArray, y: FloatArray, *, ratio: float) -> tuple[float, float]:
    """Return slope and offset of the line of `y` over `x`.

    Parameters
    ----------
    x, y : ndarray, shape (n_items,)
        Means of the two instruments on each item.
    ratio : float
        Variance of the errors of `y` over that of `x`; NaN or 0 where it is not known, and then
        the ratio of the whole variances.

    References
    ----------
    K. Linnet, "Evaluation of regression procedures for methods comparison studies", Clin. Chem. 39
    (1993) 424.

    Examples
    --------
    >>> deming_line(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]), ratio=1.0)
    (2.0, 1.0)
    """
    slopes, offsets = _lines(
        float(x.size), x.sum(), y.sum(), (x * x).sum(), (y * y).sum(), (x * y).sum(), ratio
    )
    return float(slopes), float(offsets)


def left_out_lines(x: FloatArray, y: FloatArray, *, ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return slope and offset of the line of all other items, for each item.

    `x`, `y`, `ratio`: as in `deming_line`. Two arrays of shape (n_items,).
    """
    return _lines(
        float(x.size - 1),
        x.sum() - x,
        y.sum() - y,
        (x * x).sum() - x * x,
        (y * y).sum() - y * y,
        (x * y).sum() - x * y,
        ratio,
    )


def _lines(
    n: float,
    x: FloatArray,
    y: FloatArray,
    xx: FloatArray,
    yy: FloatArray,
    xy: FloatArray,
    ratio: float,
) -> tuple[FloatArray, FloatArray]:
    """Return lines from sums over n items."""
    sxx = np.maximum(xx - x * x / n, 0.0)
    syy = np.maximum(yy - y * y / n, 0.0)
    sxy = xy - x * y / n
    with np.errstate(divide="ignore", invalid="ignore"):
        share = syy / sxx if not (math.isfinite(ratio) and ratio > 0) else np.full_like(sxx, ratio)
        lead = syy - share * sxx
        slope = (lead + np.sqrt(lead**2 + 4.0 * share * sxy**2)) / (2.0 * sxy)
    # Items all alike, or unrelated readings: the best line is level.
    slope = np.where(np.isfinite(slope), slope, 0.0)
    return slope, (y - slope * x) / n
