"""Load distribution on two facing fingers as eight numbers, and contrasts to a reference.

On a sound, round side the load on a finger is nearly a product of one factor along and one factor
across the finger. The item's position shifts the load equally on both fingers. A bruise changes the
load on one finger only, and not as a product. The logarithm of each pixel's excess conductance is
therefore reduced to mean, slope along, slope across and cross term for each finger. Subtracting the
numbers of a reference cancels the gains of pixels and fingers. The features are calculated from the
differences and means of the two fingers' numbers.

The result must not depend on the finger, or on the end of the finger, with the bruise. All features
are therefore even: exchanging the fingers and both mirror operations leave them unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.sensor.sample import excess_of_change
from palpate.signal.relative import CONTACT_PERCENT

#: Excess conductance at the paper's contact threshold; added before the logarithm.
_CONTACT_EXCESS = 100.0 / (100.0 + CONTACT_PERCENT) - 1.0
#: Number of terms for each finger: mean, slope along, slope across, cross term.
MODES = 4
#: Signs of the eight numbers (four differences, four means) after an exchange of the fingers and
#: after mirroring along and across.
_SIGNS = np.array(
    [
        (swap, along, across)
        for swap in (-1, 1)
        for along, across in ((1, 1), (-1, 1), (1, -1), (-1, -1))
    ]
)
#: Index of the mean load, the only even number among the eight.
_MEAN = MODES
#: Triples of the other numbers with an even product.
_EVEN = np.array(
    [
        chosen
        for chosen in combinations([index for index in range(2 * MODES) if index != _MEAN], 3)
        if np.prod(_SIGNS[list(chosen)], axis=0).min() == 1
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadShape:
    """Distribution of the load in one grasp."""

    #: Mean, slope along, slope across and cross term of the log load on each finger, shape (2, 4).
    modes: FloatArray
    #: Width at contact; None if unknown.
    width_mm: float | None = None

    @property
    def numbers(self) -> FloatArray:
        """Differences and means of the two fingers' modes, shape (8,)."""
        first, second = self.modes
        return np.concatenate([first - second, (first + second) / 2.0])


def fit_load_shape(change_percent: ArrayLike, *, width_mm: float | None = None) -> LoadShape:
    """Fit the load distribution of one grasp.

    `change_percent`, shape (rows, cols): relative change of each pixel. The first half of the rows
        is on one finger, the second half on the other. Pixels of equal row and column in the halves
        face each other. NaN for a pixel out of use.
    `width_mm`: width at contact.
    Raises `InputError` if a finger has fewer than 2 x 2 pixels, or too many pixels are out of use.

    >>> even = fit_load_shape([[-50.0, -50.0]] * 4)
    >>> np.abs(even.modes[0]).round(3).tolist()
    [0.105, 0.0, 0.0, 0.0]
    """
    change = np.asarray(change_percent, dtype=np.float64)
    rows = change.shape[0] // 2
    if change.ndim != 2 or change.shape[0] % 2 or min(rows, change.shape[1]) < 2:
        raise InputError(
            f"pixels of shape {change.shape}: bruise detection requires two fingers with at least "
            "2 x 2 pixels each"
        )
    basis = _finger_basis(rows, change.shape[1]).reshape(MODES, -1)
    excess = np.maximum(excess_of_change(change), 0.0)
    load = np.log(excess + _CONTACT_EXCESS).reshape(2, -1)
    modes = np.empty((2, MODES))
    for finger, values in enumerate(load):
        known = np.isfinite(values)
        if known.all():
            # The four modes are orthogonal if all pixels are in use.
            modes[finger] = basis @ values / np.sum(basis**2, axis=1)
            continue
        if np.linalg.matrix_rank(basis[:, known]) < MODES:
            raise InputError(
                f"finger {finger + 1}: only {known.sum()} of {known.size} pixels are in use; a "
                "bruise can't be distinguished from the item's position"
            )
        modes[finger] = np.linalg.lstsq(basis[:, known].T, values[known], rcond=None)[0]
    return LoadShape(modes=modes, width_mm=width_mm)


def median_shape(shapes: Sequence[LoadShape], *, with_width: bool) -> LoadShape:
    """Return the median of several grasps as a reference.

    `shapes`: at least one.
    `with_width`: whether to include the median width; only for grasps of a single item.
    """
    widths_mm = [shape.width_mm for shape in shapes if shape.width_mm is not None]
    return LoadShape(
        modes=np.median([shape.modes for shape in shapes], axis=0),
        width_mm=float(np.median(widths_mm)) if with_width and widths_mm else None,
    )


def contrast(shape: LoadShape, reference: LoadShape) -> FloatArray:
    """Return the features of a grasp relative to a reference, shape (17,).

    The features are the mean load, the absolute values of the eight numbers, the cube roots of
    their even triple products, and the increase of the width at contact (0 if unknown).

    >>> even = fit_load_shape([[-50.0, -50.0]] * 4, width_mm=66.0)
    >>> contrast(even, even).tolist() == [0.0] * 17
    True
    """
    numbers = shape.numbers - reference.numbers
    triples = np.cbrt(np.prod(numbers[_EVEN], axis=1))
    wider_mm = 0.0
    if shape.width_mm is not None and reference.width_mm is not None:
        wider_mm = shape.width_mm - reference.width_mm
    return np.concatenate([[numbers[_MEAN]], np.abs(numbers), triples, [wider_mm]])


def pixel_contrast(shape: LoadShape, reference: LoadShape, *, rows: int, cols: int) -> FloatArray:
    """Return each pixel's log load relative to the facing pixel, shape (rows, cols)."""
    basis = _finger_basis(rows // 2, cols)
    first = np.tensordot((shape.numbers - reference.numbers)[:MODES], basis, axes=1)
    return np.concatenate([first, -first])


@lru_cache(maxsize=8)
def _finger_basis(rows: int, cols: int) -> FloatArray:
    """Return the modes of a finger (mean, along, across, product), shape (4, rows, cols)."""
    along, across = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, cols), indexing="ij")
    basis = np.stack([np.ones_like(along), along, across, along * across])
    basis.flags.writeable = False
    return basis
