"""Untuned learners with all inputs of palpate's method.

A study describes each case with a row of inputs and one target. Ridge regression and boosted trees
are trained on other sensors or specimens than those of the test.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate_studies.protocol.parts import Learned

#: From inputs, shape (cases, inputs), to predicted targets, shape (cases,).
Predictor: TypeAlias = Callable[[FloatArray], FloatArray]
RIDGE, TREES = "ridge", "trees"
#: Added to the spread of constant inputs.
_TINY = 1e-9
LEARNERS = {RIDGE: "ridge given everything", TREES: "boosted trees given everything"}


def make_trees(**settings: Any) -> Any:
    """Return an unfitted gradient boosting regressor.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    return HistGradientBoostingRegressor(random_state=0, **settings)


def make_ridge(penalty: float | None = None) -> Any:
    """Return an unfitted ridge on standardised inputs.

    `penalty`: chosen by cross-validation by default.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """
    from sklearn.linear_model import Ridge, RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    ridge = RidgeCV(np.geomspace(0.1, 1e3, 9)) if penalty is None else Ridge(penalty)
    return make_pipeline(StandardScaler(), ridge)


def fit_weighted_ridge(
    rows: FloatArray, truth: FloatArray, weight: FloatArray, penalty: float
) -> Predictor:
    """Fit a weighted ridge on standardised inputs.

    Examples
    --------
    >>> rows = np.arange(10.0).reshape(5, 2)
    >>> fit_weighted_ridge(rows, rows[:, 0], np.ones(5), 1e-6)(rows).round(3).tolist()
    [0.0, 2.0, 4.0, 6.0, 8.0]
    """
    fraction = weight / weight.sum()
    middle, level = fraction @ rows, float(fraction @ truth)
    spread = np.sqrt(fraction @ (rows - middle) ** 2) + _TINY
    unit = (rows - middle) / spread
    square = unit.T @ (fraction[:, None] * unit) + penalty * np.eye(unit.shape[1])
    slope = np.linalg.solve(square, unit.T @ (fraction * (truth - level)))
    return lambda some: np.asarray(level + ((some - middle) / spread) @ slope)


def learn(name: str, rows: FloatArray, *, targets: ArrayLike, seen: Sequence[str]) -> Learned[Any]:
    """Train a learner; `found` of the result is a `Predictor`.

    Parameters
    ----------
    name : {"ridge", "trees"}
        Name of the learner.
    rows : ndarray, shape (cases, inputs)
        Inputs.
    targets : array_like, shape (cases,)
        Values to predict.
    seen : sequence of str
        Specimens of the cases.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.

    Examples
    --------
    >>> rows = np.arange(80.0).reshape(40, 2)
    >>> found = learn("ridge", rows, targets=rows @ [1.0, 2.0], seen=["a"])
    >>> found.on(["b"])(np.array([[6.0, 7.0]])).round(0).tolist()
    [20.0]
    """
    model = (
        make_ridge()
        if name == RIDGE
        else make_trees(max_iter=300, learning_rate=0.05, max_leaf_nodes=15)
    )
    return Learned(found=model.fit(rows, np.asarray(targets)).predict, seen=frozenset(seen))


def predict_held_out(
    rows: FloatArray, *, targets: ArrayLike, specimens: Sequence[str]
) -> FloatArray:
    """Predict each row with trees trained on the other specimens.

    Returns shape (cases,); NaN with only one specimen.
    """
    of, truth = np.array(specimens), np.asarray(targets, dtype=float)
    found = np.full(truth.shape, np.nan)
    for one in dict.fromkeys(specimens):
        others = of != one
        if others.any():
            seen = of[others].tolist()
            predict = learn(TREES, rows[others], targets=truth[others], seen=seen).on([one])
            found[~others] = predict(rows[~others])
    return found
