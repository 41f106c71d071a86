"""Statistics of a data set's columns, with LeRobot's names and shapes."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def statistics(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return statistics of each column, ignoring NaN; `count` is the number of rows.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, columns)
        One row per frame.

    Examples
    --------
    >>> found = statistics(np.array([[1.0, 5.0], [3.0, np.nan]]))
    >>> found["mean"], found["std"], found["max"], found["count"]
    ([2.0, 5.0], [1.0, 0.0], [3.0, 5.0], [2])
    """
    columns = np.asarray(values, float).reshape(len(values), -1)
    with warnings.catch_warnings():
        # The statistics of a pixel without readings are NaN.
        warnings.filterwarnings("ignore", "All-NaN|Mean of empty|Degrees of freedom")
        found = {
            "min": np.nanmin(columns, axis=0),
            "max": np.nanmax(columns, axis=0),
            "mean": np.nanmean(columns, axis=0),
            "std": np.nanstd(columns, axis=0),
            **{name: np.nanquantile(columns, q, axis=0) for name, q in _QUANTILES.items()},
        }
    return {name: row.tolist() for name, row in found.items()} | {"count": [len(columns)]}
