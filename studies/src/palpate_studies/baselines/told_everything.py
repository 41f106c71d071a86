"""Learners given everything that a method of ours reads, as numbers; one setting each, not tuned.

A study describes each case by a row of numbers and asks for one number. Ridge regression and
boosted trees learn it on other sensors or specimens than those that they are scored on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import needing
from palpate_studies.protocol.parts import Learned

#: Rows of numbers, shape (cases, numbers) -> what is asked, shape (cases,).
Answer: TypeAlias = Callable[[FloatArray], FloatArray]
RIDGE, TREES = "ridge", "trees"
LEARNERS = {RIDGE: "ridge given everything", TREES: "boosted trees given everything"}
#: Penalties that the ridge chooses from by itself, on what it learns from.
_PENALTIES = np.geomspace(0.1, 1e3, 9)


def learned(name: str, rows: FloatArray, *, asked: ArrayLike, seen: Sequence[str]) -> Learned[Any]:
    """Learn `asked`, shape (cases,), from rows; what is found is an `Answer`.

    Parameters
    ----------
    name : {"ridge", "trees"}
        Which learner.
    rows : ndarray, shape (cases, numbers)
        What the method sees of each case.
    asked : array_like, shape (cases,)
        The truth.
    seen : sequence of str
        Specimens of the cases.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.

    Examples
    --------
    >>> rows = np.arange(80.0).reshape(40, 2)
    >>> found = learned("ridge", rows, asked=rows @ [1.0, 2.0], seen=["a"])
    >>> found.on(["b"])(np.array([[6.0, 7.0]])).round(0).tolist()
    [20.0]
    """
    with needing("a rival that learns", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingRegressor
        from sklearn.linear_model import RidgeCV
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    model = {
        RIDGE: lambda: make_pipeline(StandardScaler(), RidgeCV(_PENALTIES)),
        TREES: lambda: HistGradientBoostingRegressor(
            max_iter=300, learning_rate=0.05, max_leaf_nodes=15, random_state=0
        ),
    }[name]()
    return Learned(found=model.fit(rows, np.asarray(asked)).predict, seen=frozenset(seen))


def left_out(
    name: str, rows: FloatArray, *, asked: ArrayLike, specimens: Sequence[str]
) -> FloatArray:
    """Return what is answered for each row by what was learned on all other specimens.

    Shape (cases,); NaN where there is no other specimen.
    """
    of, truth = np.array(specimens), np.asarray(asked, dtype=float)
    found = np.full(truth.shape, np.nan)
    for one in dict.fromkeys(specimens):
        others = of != one
        if others.any():
            seen = of[others].tolist()
            answer = learned(name, rows[others], asked=truth[others], seen=seen).on([one])
            found[~others] = answer(rows[~others])
    return found
