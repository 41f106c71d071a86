"""Baselines of identification, each learned from the same taught items.

Guesses name one kind from one grasp. A discriminant analysis with a background class is asked in
the same way as ours, with as many grasps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate_studies.baselines.nearest_mean import NearestMean
from palpate_studies.identify_data import CrateItemGrasps

#: Names a kind, or unknown, from the measurements of one grasp.
Guess: TypeAlias = Callable[[Mapping[str, Measurement]], str]

_SIZE, _BOTH = ("size_mm",), ("size_mm", "stiffness_n_per_mm")


def guesses(taught: Sequence[CrateItemGrasps]) -> dict[str, Guess]:
    """Learn thresholds of size alone, and the nearest mean, which may call an item unknown."""
    return {
        "size thresholds": _nearest(taught, _SIZE, may_abstain=False),
        "nearest mean": _nearest(taught, _BOTH, may_abstain=False),
        "nearest mean, may abstain": _nearest(taught, _BOTH, may_abstain=True),
    }


def _nearest(
    taught: Sequence[CrateItemGrasps], names: tuple[str, ...], *, may_abstain: bool
) -> Guess:
    found = [
        ([np.log(one.grasp.measurements[name].middle) for name in names], item.kind)
        for item in taught
        for one in item.grasps
        if all(name in one.grasp.measurements for name in names)
    ]
    known = NearestMean(
        np.array([values for values, _ in found]),
        [kind for _, kind in found],
        may_abstain=may_abstain,
    )

    def guess(measured: Mapping[str, Measurement]) -> str:
        return known.name(np.log([measured[name].middle for name in names]))

    return guess
