"""Least absolute error by reweighting."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from palpate.estimate.creep import FloatArray

#: Errors of ln force below this are as good as none: keeps the absolute-error fit smooth.
GOOD_ENOUGH = 0.03


def least_absolute(
    design: FloatArray, target: FloatArray, weight: FloatArray, *, rising: slice = slice(0)
) -> FloatArray:
    """Solve for the least absolute error by reweighting, with a trace of ridge.

    Coefficients of the `rising` columns are kept at 0 or above.
    """
    ridge = 1e-3 * weight.sum() * np.eye(design.shape[1])
    solution = np.zeros(design.shape[1])
    now = weight
    for _ in range(10):
        scaled = design * now[:, None]
        solution = _solve(scaled.T @ design + ridge, scaled.T @ target, rising)
        now = weight / np.maximum(np.abs(target - design @ solution), GOOD_ENOUGH)
    return np.asarray(solution)


def _solve(matrix: FloatArray, right: FloatArray, rising: slice) -> FloatArray:
    """Solve a positive definite system, the `rising` unknowns not below 0."""
    free = np.setdiff1d(np.arange(len(right)), np.arange(len(right))[rising])
    if free.size == len(right):
        return np.asarray(np.linalg.solve(matrix, right))
    # A free unknown enters nnls twice, with either sign.
    both = np.concatenate([np.eye(len(right)), -np.eye(len(right))[free]])
    root = np.linalg.cholesky(matrix).T
    found = nnls(root @ both.T, np.linalg.solve(root.T, right))[0]
    return np.asarray(found @ both)
