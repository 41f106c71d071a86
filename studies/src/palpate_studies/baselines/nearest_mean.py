"""The nearest class mean in size and stiffness, which may call an item unknown.

Distances are in the spread that all kinds share. An item farther from every mean than all but a
twentieth of the taught items are from theirs is unknown: the same share as ours, chosen on the
taught items alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.produce.learning import FALSE_REJECT, UNKNOWN


class NearestMean:
    """Class means learned from points.

    Parameters
    ----------
    points : ndarray, shape (items, features)
        Logarithms of what was measured of each taught item.
    kinds : sequence of str, length items
        What each is.
    may_abstain : bool
        Whether it may answer `UNKNOWN`.

    Examples
    --------
    >>> points = np.array([[3.0, 0.0], [3.1, 0.1], [3.05, 0.0], [4.0, 2.0], [4.1, 2.1], [4.0, 2.1]])
    >>> known = NearestMean(points, 3 * ["grape"] + 3 * ["egg"], may_abstain=True)
    >>> known.name(np.array([4.05, 2.0])), known.name(np.array([9.0, 9.0]))
    ('egg', 'unknown')
    """

    def __init__(self, points: FloatArray, kinds: Sequence[str], *, may_abstain: bool) -> None:
        self.kinds = sorted(set(kinds))
        of = np.array([self.kinds.index(kind) for kind in kinds])
        self._means = np.array([points[of == k].mean(axis=0) for k in range(len(self.kinds))])
        self._spread = np.sqrt(np.mean((points - self._means[of]) ** 2, axis=0)) + 1e-9
        # Left out of its own mean, an item of n lies farther from it by n / (n - 1).
        count = np.bincount(of)[of]
        own = self._distances(points)[np.arange(len(of)), of] * count / np.maximum(count - 1, 1)
        self._limit = float(np.quantile(own, 1.0 - FALSE_REJECT)) if may_abstain else np.inf

    def name(self, point: FloatArray) -> str:
        """Return the kind, or `UNKNOWN`."""
        distances = self._distances(point[None])[0]
        best = int(np.argmin(distances))
        return UNKNOWN if distances[best] > self._limit else self.kinds[best]

    def _distances(self, points: FloatArray) -> FloatArray:
        off = (points[:, None, :] - self._means) / self._spread
        return np.asarray(np.sqrt(np.sum(off**2, axis=2)))
