"""Boosted trees on the numbers that our judge of bruises reads, one setting, not tuned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import needing


def tree_scores(learned: FloatArray, bruised: Sequence[bool], *, tested: FloatArray) -> FloatArray:
    """Learn from sides, shape (sides, numbers), and return a score for each tested one.

    Examples
    --------
    >>> numbers = np.arange(80.0).reshape(80, 1)
    >>> low, high = tree_scores(numbers, [x > 40 for x in range(80)], tested=numbers[[5, 75]])
    >>> bool(low < 0 < high)
    True
    """
    with needing("the study of bruises", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingClassifier
    trees = HistGradientBoostingClassifier(
        max_iter=300, learning_rate=0.05, max_leaf_nodes=15, random_state=0
    )
    return np.asarray(trees.fit(learned, bruised).decision_function(tested))
