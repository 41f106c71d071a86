"""Distribution of the load on two facing fingers, in eight numbers, and its contrasts.

A sound, round side spreads its load over the pixels of a finger nearly as a product of one factor
along and one across: its position moves the load, but alike on both fingers. A bruise moves it on
one finger only, and not as a product. So the logarithm of each pixel's excess conductance is
reduced to mean, slope along, slope across and the crossed term on each finger. A reference's
numbers are subtracted, which cancels gains of pixels and fingers, and the differences and means of
the two fingers' numbers are judged.

Nothing may depend on which finger, or which end of it, the bruise lies at. The judge's inputs are
therefore even: they stay as they are when the fingers change places, and under both mirrors.
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
from palpate.signal.relative import CONTACT_PERCENT

#: Excess conductance at the paper's contact threshold: well below it there is no load.
_TOUCH = 100.0 / (100.0 + CONTACT_PERCENT) - 1.0
#: Number of terms that describe a finger's pattern: mean, along, across, crossed.
MODES = 4
#: Change of sign of the eight numbers (four differences, four means) when the fingers change places
#: and under the mirrors along and across.
_SIGNS = np.array(
    [
        (swap, along, across)
        for swap in (-1, 1)
        for along, across in ((1, 1), (-1, 1), (1, -1), (-1, -1))
    ]
)
#: Index of the mean load: the only number that is even by itself.
_MEAN = MODES


#: Triples of the numbers, the mean load apart, whose product is even.
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

    #: Shape (2, 4). Mean, slope along, slope across and crossed term of log load on each finger.
    modes: FloatArray
    #: Width at contact; None if not known.
    width_mm: float | None = None

    @property
    def numbers(self) -> FloatArray:
        """Return differences and means of the two fingers' modes, shape (8,)."""
        first, second = self.modes
        return np.concatenate([first - second, (first + second) / 2.0])


def fit_load_shape(change_percent: ArrayLike, *, width_mm: float | None = None) -> LoadShape:
    """Describe one grasp.

    `change_percent`, shape (rows, cols): relative change of each pixel; the first half of the rows
        is on one finger, the second half on the other, facing it row by row and column by column.
        NaN where a pixel is out of use.
    `width_mm`: width at contact.
    Raises `InputError` if there are fewer than 2 x 2 pixels on a finger, or too many are out of
    use.

    >>> even = fit_load_shape([[-50.0, -50.0]] * 4)
    >>> np.abs(even.modes[0]).round(3).tolist()
    [0.105, 0.0, 0.0, 0.0]
    """
    change = np.asarray(change_percent, dtype=np.float64)
    rows = change.shape[0] // 2
    if change.ndim != 2 or change.shape[0] % 2 or min(rows, change.shape[1]) < 2:
        raise InputError(
            f"pixels of shape {change.shape}: bruises need two fingers with at least 2 x 2 pixels"
        )
    basis = _finger_basis(rows, change.shape[1]).reshape(MODES, -1)
    ratio = np.maximum(100.0 + change, 0.1) / 100.0
    load = np.log(np.maximum(1.0 / ratio - 1.0, 0.0) + _TOUCH).reshape(2, -1)
    modes = np.empty((2, MODES))
    for finger, values in enumerate(load):
        known = np.isfinite(values)
        if known.all():
            # The four are orthogonal on a whole finger.
            modes[finger] = basis @ values / np.sum(basis**2, axis=1)
            continue
        if np.linalg.matrix_rank(basis[:, known]) < MODES:
            raise InputError(
                f"finger {finger + 1}: only {known.sum()} of {known.size} pixels read; a bruise "
                "can't be distinguished from the fruit's position"
            )
        modes[finger] = np.linalg.lstsq(basis[:, known].T, values[known], rcond=None)[0]
    return LoadShape(modes=modes, width_mm=width_mm)


def median_shape(shapes: Sequence[LoadShape], *, with_width: bool) -> LoadShape:
    """Return the median of several grasps, as a reference.

    `shapes`: at least one.
    `with_width`: whether their widths are of one item, so that its width may be compared with them.
    """
    widths_mm = [shape.width_mm for shape in shapes if shape.width_mm is not None]
    return LoadShape(
        modes=np.median([shape.modes for shape in shapes], axis=0),
        width_mm=float(np.median(widths_mm)) if with_width and widths_mm else None,
    )


def contrast(shape: LoadShape, reference: LoadShape) -> FloatArray:
    """Return the features of a grasp against a reference, shape (17,).

    Mean load; the sizes of the eight numbers; cube roots of their even products of three; and by
    how much wider the item was at contact (0 where that is not known).

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
    """Return log load of each pixel against the one that it faces, shape (rows, cols)."""
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
