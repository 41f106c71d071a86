"""Paired differences between two methods on the same cases, with intervals over specimens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate_studies.bootstrap import bootstrap_interval

LEVEL, DRAWS, SEED = 0.9, 2000, 20
WIN, LOSS, TIE = "ours", "rival", "undecided"
IntArray: TypeAlias = NDArray[np.int_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A loss of palpate minus that of a baseline; negative values favour palpate.

    Attributes
    ----------
    value, low, high : float
        Difference and its interval; the limits are NaN with one specimen.
    cases, specimens : int
        Numbers of cases and specimens.
    """

    value: float
    low: float
    high: float
    cases: int
    specimens: int

    @property
    def verdict(self) -> str:
        """``ours`` or ``rival`` if the interval excludes zero, else ``undecided``."""
        if self.high < 0:
            return WIN
        return LOSS if self.low > 0 else TIE

    def to_dict(self) -> dict[str, Any]:
        """Return a mapping for JSON; unknown limits are null."""
        return {
            "difference": self.value,
            "low": self.low if np.isfinite(self.low) else None,
            "high": self.high if np.isfinite(self.high) else None,
            "cases": self.cases,
            "specimens": self.specimens,
            "verdict": self.verdict,
        }


def rms(errors: FloatArray) -> np.floating[Any]:
    """Return the root mean square, a statistic for `difference_of_pairs`.

    Examples
    --------
    >>> float(rms(np.array([3.0, -4.0, 0.0, 0.0])))
    2.5
    """
    return np.float64(np.sqrt(np.mean(errors**2)))


def difference_of_pairs(
    ours: ArrayLike,
    baseline: ArrayLike,
    specimens: Sequence[str],
    *,
    statistic: Callable[[FloatArray], np.floating[Any]] = np.median,
) -> Difference:
    """Return the statistic of palpate's losses minus that of a baseline's, on the same cases.

    Whole specimens are resampled with replacement, and both methods are scored on the same sample.
    The difficulty of a specimen for both methods then cancels.

    Parameters
    ----------
    ours, baseline : array_like, shape (cases,)
        Losses of both methods, case by case.
    specimens : sequence of str, length cases
        Sensor, specimen or fruit of each case.
    statistic : callable
        `np.median`, `np.mean` or `rms` of the losses.

    Raises
    ------
    ValueError
        If the lengths differ or a loss is not finite. A study must assign a loss to abstentions.

    References
    ----------
    A. C. Davison and D. V. Hinkley, "Bootstrap Methods and their Application" (1997), section 3.8.

    Examples
    --------
    >>> found = difference_of_pairs([1.0, 1, 1, 1], [2.0, 3, 2, 2], ["a", "a", "b", "c"])
    >>> found.value, found.verdict
    (-1.0, 'ours')
    """
    a, b = np.asarray(ours, dtype=float), np.asarray(baseline, dtype=float)
    if a.shape != b.shape or a.shape != (len(specimens),):
        raise ValueError(
            f"losses of shapes {a.shape} and {b.shape} for {len(specimens)} cases; give one loss "
            "per case and method"
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("a loss is not finite; give every case a finite loss")

    return bootstrap_difference(
        lambda chosen: np.float64(statistic(a[chosen]) - statistic(b[chosen])), specimens
    )


def compare(
    losses: Mapping[str, ArrayLike],
    specimens: Sequence[str],
    *,
    ours: str = "ours",
    statistic: Callable[[FloatArray], np.floating[Any]] = np.median,
    **named: Any,
) -> list[dict[str, Any]]:
    """Return a row per baseline: the reference method minus the baseline on the same cases.

    Parameters
    ----------
    losses : mapping of str to array_like, shape (cases,)
        Method -> losses.
    specimens, statistic
        As in `difference_of_pairs`.
    ours : str
        Reference method.
    named
        Additional entries at the start of each row.

    Examples
    --------
    >>> rows = compare({"ours": [1.0, 1], "static": [2.0, 3]}, ["a", "b"], level="lab")
    >>> [(row["level"], row["rival"], row["difference"]) for row in rows]
    [('lab', 'static', -1.5)]
    """
    return [
        {
            **named,
            "rival": baseline,
            **difference_of_pairs(losses[ours], lost, specimens, statistic=statistic).to_dict(),
        }
        for baseline, lost in losses.items()
        if baseline != ours
    ]


def bootstrap_difference(
    of: Callable[[IntArray], np.floating[Any]], specimens: Sequence[str]
) -> Difference:
    """Return a difference of losses over all cases, such as ROC areas, with its interval.

    Parameters
    ----------
    of : callable
        From indices of drawn cases to palpate's loss minus a baseline's on these cases.
    specimens : sequence of str, length cases
        Specimen of each case.

    Examples
    --------
    >>> worse = np.array([0.1, 0.2, 0.1, 0.4])
    >>> bootstrap_difference(lambda chosen: worse[chosen].max(), ["a", "a", "b", "c"]).value
    0.4
    """
    every = np.arange(len(specimens))
    low, high = bootstrap_interval(
        every.astype(float),
        specimens,
        statistic=lambda drawn: of(drawn.astype(int)),
        level=LEVEL,
        draws=DRAWS,
        seed=SEED,
    )
    return Difference(
        value=float(of(every)),
        low=low,
        high=high,
        cases=len(every),
        specimens=len(set(specimens)),
    )
