"""Linear discriminant analysis with a background class: a few lines that may abstain.

Kinds are normal in the logarithms of size and stiffness, with one covariance in common. There is
one more class, the background: all that was taught, with twice its covariance. Intervals of the
measurements are not used, nor calibrations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import multivariate_normal

from palpate.arrays import FloatArray
from palpate.produce.identify.identifier import (
    FALSE_REJECT,
    UNKNOWN,
    FeaturePoint,
    Identifier,
    Identity,
    TaughtItem,
)

#: Covariance of the background, in those of all taught items together.
_WIDE = 2.0


class LdaBackground(Identifier):
    """Learned from the same items as ours, and asked in the same way.

    Parameters
    ----------
    taught : sequence of TaughtItem
        Items whose kind is known.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> def item(kind, ln_mm):
    ...     value = rng.normal((ln_mm, 1.0), 0.05)
    ...     touch = FeaturePoint(value=value, sd=np.ones(2), calibration="m")
    ...     return TaughtItem(kind=kind, touches=(touch,))
    >>> known = LdaBackground([item(*k) for k in 20 * [("egg", 3.8), ("grape", 2.9)]])
    >>> known.identify(item("?", 3.8).touches).kind, known.identify(item("?", 5.5).touches).kind
    ('egg', 'unknown')
    """

    def __init__(self, taught: Sequence[TaughtItem]) -> None:
        super().__init__(taught)
        seen = [item for item in taught if item.touches]
        points = np.array([_mean(item.touches) for item in seen])
        of = np.array([self.kinds.index(item.kind) for item in seen])
        self._means = np.array([points[of == k].mean(axis=0) for k in range(len(self.kinds))])
        left = points - self._means[of]
        self._shared = left.T @ left / (len(points) - len(self.kinds))
        self._wide = points.mean(axis=0), _WIDE * np.cov(points.T)
        # Chosen on the taught items alone: of them this share is called unknown, each judged by a
        # mean that it is left out of.
        without = self._means[of] - left / (np.bincount(of)[of] - 1)[:, None]
        unknown = [
            self._chances(point, np.where(np.arange(len(self.kinds))[:, None] == k, m, self._means))
            for point, k, m in zip(points, of, without, strict=True)
        ]
        self._limit = float(np.quantile([chance[-1] for chance in unknown], 1.0 - FALSE_REJECT))

    def identify(self, touches: Sequence[FeaturePoint]) -> Identity:
        """Identify an item from the mean of its grasps."""
        chance = self._chances(_mean(touches), self._means)
        rejected = bool(chance[-1] > self._limit)
        return Identity(
            kind=UNKNOWN if rejected else self.kinds[int(np.argmax(chance[:-1]))],
            probability=dict(zip((*self.kinds, UNKNOWN), chance.tolist(), strict=True)),
            usual=1.0 - float(chance[-1]),
            rejected=rejected,
            grasps=len(touches),
        )

    def _chances(self, point: FloatArray, means: FloatArray) -> FloatArray:
        log = [multivariate_normal.logpdf(point, mean, self._shared) for mean in means]
        log.append(multivariate_normal.logpdf(point, *self._wide))
        chance = np.exp(np.array(log) - max(log))
        return np.asarray(chance / chance.sum())


def _mean(touches: Sequence[FeaturePoint]) -> FloatArray:
    return np.asarray(np.mean([touch.value for touch in touches], axis=0))
