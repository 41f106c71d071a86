"""What identification is compared with: thresholds of size alone, and the nearest mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from palpate.errors import needing
from palpate.estimate.measurement import Measurement
from palpate_studies.identify_data import CrateItemGrasps

#: Names a kind from the measurements of one grasp; it never says "unknown".
Guess: TypeAlias = Callable[[Mapping[str, Measurement]], str]


def size_thresholds(taught: Sequence[CrateItemGrasps]) -> Guess:
    """Learn one mean size for each kind; the nearest wins, so thresholds lie halfway between."""
    kinds, means = _means(taught, ("size_mm",))

    def guess(measured: Mapping[str, Measurement]) -> str:
        return kinds[int(np.argmin(np.abs(means[:, 0] - measured["size_mm"].value)))]

    return guess


def nearest_mean(taught: Sequence[CrateItemGrasps]) -> Guess:
    """Learn the nearest class mean in size and stiffness, each scaled to unit spread.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """
    with needing("the nearest mean", extra="produce"):
        from sklearn.neighbors import NearestCentroid
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    names = ("size_mm", "stiffness_n_per_mm")
    points, kinds = _points(taught, names)
    model = make_pipeline(StandardScaler(), NearestCentroid()).fit(points, kinds)

    def guess(measured: Mapping[str, Measurement]) -> str:
        return str(model.predict([[measured[name].value for name in names]])[0])

    return guess


def _means(
    taught: Sequence[CrateItemGrasps], names: tuple[str, ...]
) -> tuple[list[str], np.ndarray]:
    points, kinds = _points(taught, names)
    known = sorted(set(kinds))
    return known, np.array([points[np.array(kinds) == kind].mean(axis=0) for kind in known])


def _points(
    taught: Sequence[CrateItemGrasps], names: tuple[str, ...]
) -> tuple[np.ndarray, list[str]]:
    found = [
        ([one.grasp.measurements[name].value for name in names], item.kind)
        for item in taught
        for one in item.grasps
        if all(name in one.grasp.measurements for name in names)
    ]
    return np.array([values for values, _ in found]), [kind for _, kind in found]
