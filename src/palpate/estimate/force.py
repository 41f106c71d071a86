"""Static force laws: newtons from a settled reading, with an interval and the range they hold in.

`PowerForceLaw` reads the excess conductance G/G0 - 1 summed over pixels, which hardly depends on
how the load spreads over them; `LineForceLaw` is the paper's line in the mean relative change
(Table 4), good over a narrow span only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import CalibrationError
from palpate.estimate.force_pairs import FloatArray, ForceEstimate
from palpate.estimate.line_law import LineForceLaw
from palpate.estimate.power_law import PowerForceLaw

__all__ = [
    "ForceEstimate",
    "ForceLaw",
    "LawChoice",
    "LineForceLaw",
    "PowerForceLaw",
    "choose_law",
    "law_from_dict",
]


class ForceLaw(Protocol):
    """A calibrated law from one kind of reading to force."""

    #: Name in calibration files.
    name: ClassVar[str]
    #: What `force_n` reads: ``"excess"`` or ``"relative_percent"``.
    reads: ClassVar[str]

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest reading of the calibration."""
        ...

    @property
    def residual_sd(self) -> float:
        """Scatter of the calibration about the law: of ln force (power), of force in N (line)."""
        ...

    def force_n(self, reading: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force of each reading."""
        ...

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; `law_from_dict` reads them back."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class LawChoice:
    """The law with the smaller held-out error.

    Attributes
    ----------
    law : PowerForceLaw or LineForceLaw
        Fitted to every pair.
    held_out_log_error : mapping of str to float
        Name of each law -> median |ln(predicted / reference)| over pairs left out of the fit.
    """

    law: PowerForceLaw | LineForceLaw
    held_out_log_error: Mapping[str, float]


def choose_law(
    *,
    excess: ArrayLike,
    relative_percent: ArrayLike,
    force_n: ArrayLike,
    groups: Sequence[object] | None = None,
) -> LawChoice:
    """Fit both laws and keep the one that predicts pairs left out of its fit better.

    Parameters
    ----------
    excess, relative_percent, force_n : array_like, shape (n_pairs,)
        As in the laws' `fit`.
    groups : sequence, length n_pairs, optional
        Pairs of one group are left out together: passes up and down, days, materials. Without it,
        one pair at a time.

    Raises
    ------
    CalibrationError
        If no law can be fitted to the pairs.
    """
    force = np.asarray(force_n, dtype=float)
    names = list(range(len(force))) if groups is None else list(groups)
    folds = [np.array([other == name for other in names]) for name in dict.fromkeys(names)]
    readings = {"power": np.asarray(excess), "line": np.asarray(relative_percent)}
    errors = {
        name: _held_out_log_error(_KINDS[name], reading, force, folds=folds)
        for name, reading in readings.items()
    }
    best = min(errors, key=errors.__getitem__)
    return LawChoice(law=_KINDS[best].fit(readings[best], force_n=force), held_out_log_error=errors)


def law_from_dict(stored: Mapping[str, Any]) -> PowerForceLaw | LineForceLaw:
    """Return the law that `as_dict` wrote.

    Raises
    ------
    CalibrationError
        If the name is unknown or a value is missing.

    Examples
    --------
    >>> law = LineForceLaw.fit([-10.0, -20, -30, -41], force_n=[3.0, 4, 5, 6])
    >>> law_from_dict(law.as_dict()) == law
    True
    """
    if stored.get("law") not in _KINDS:
        raise CalibrationError(
            f"force law {stored.get('law')!r} is unknown; there are: power, line"
        )
    numbers = {name: value for name, value in stored.items() if name != "law"}
    try:
        numbers["coefficients"] = tuple(stored["coefficients"])
        numbers["covariance"] = tuple(tuple(row) for row in stored["covariance"])
        numbers["range"] = (stored["range"][0], stored["range"][1])
        return _KINDS[stored["law"]](**numbers)
    except KeyError as error:
        raise CalibrationError(f"force law {stored['law']!r}: {error} is missing") from error
    except TypeError as error:
        raise CalibrationError(f"force law {stored['law']!r}: {error}") from error


_KINDS: dict[str, type[PowerForceLaw] | type[LineForceLaw]] = {
    "power": PowerForceLaw,
    "line": LineForceLaw,
}


def _held_out_log_error(
    kind: type[PowerForceLaw] | type[LineForceLaw],
    reading: FloatArray,
    force: FloatArray,
    *,
    folds: Sequence[NDArray[np.bool_]],
) -> float:
    log_ratio: list[float] = []
    for fold in folds:
        law = kind.fit(reading[~fold], force_n=force[~fold])
        tested = fold & (force > 0)
        # The floor stands for "no force at all": a wrong answer, but not an infinite one.
        value = np.maximum(law.force_n(reading[tested]).value, 1e-3)
        log_ratio += np.abs(np.log(value / force[tested])).tolist()
    return float(np.median(log_ratio))
