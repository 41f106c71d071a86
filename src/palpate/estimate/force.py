"""Static force laws: newtons from a settled reading, with an interval and the range they hold in.

`PowerForceLaw` reads the excess conductance G/G0 - 1 summed over pixels, which hardly depends on
how the load spreads over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import CalibrationError
from palpate.estimate.power_law import PowerForceLaw

__all__ = [
    "ForceEstimate",
    "ForceLaw",
    "PowerForceLaw",
    "law_from_dict",
]

FloatArray: TypeAlias = NDArray[np.float64]
#: Fewer calibration pairs than this can't show their own scatter.
MIN_PAIRS = 4
#: A calibration whose largest load is less than this times its smallest says nothing of a slope.
MIN_LOAD_RATIO = 1.2


class ForceLaw(Protocol):
    """A calibrated law from one kind of reading to force."""

    #: Name in calibration files.
    name: ClassVar[str]
    #: What `force_n` reads: ``"excess"`` or ``"pixels"``.
    reads: ClassVar[str]

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest reading of the calibration."""
        ...

    @property
    def residual_sd(self) -> float:
        """Scatter of the calibration about the law, of ln force."""
        ...

    def force_n(self, reading: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force of each reading."""
        ...

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; `law_from_dict` reads them back."""
        ...


def law_from_dict(stored: Mapping[str, Any]) -> PowerForceLaw:
    """Return the law that `as_dict` wrote.

    Raises
    ------
    CalibrationError
        If the name is unknown or a value is missing.

    Examples
    --------
    >>> law = PowerForceLaw.fit([1.0, 4.0, 9.0, 16.0], force_n=[1.0, 2.1, 3, 4])
    >>> law_from_dict(law.as_dict()) == law
    True
    """
    if stored.get("law") != PowerForceLaw.name:
        raise CalibrationError(
            f"force law {stored.get('law')!r} is unknown; calibrate the force again"
        )
    numbers = {name: value for name, value in stored.items() if name != "law"}
    try:
        numbers["coefficients"] = tuple(stored["coefficients"])
        numbers["covariance"] = tuple(tuple(row) for row in stored["covariance"])
        numbers["range"] = (stored["range"][0], stored["range"][1])
        return PowerForceLaw(**numbers)
    except KeyError as error:
        raise CalibrationError(f"force law {stored['law']!r}: {error} is missing") from error
    except TypeError as error:
        raise CalibrationError(f"force law {stored['law']!r}: {error}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceEstimate:
    """Forces with intervals, newtons; arrays of the shape of the readings.

    Attributes
    ----------
    value, low, high : ndarray
        Force and the ends of its prediction interval, never below 0.
    in_range : ndarray of bool
        Whether the reading lies within those of the calibration. Outside, the value follows the law
        and carries no promise.
    level : float
        Probability that the interval is meant to cover.
    """

    value: FloatArray
    low: FloatArray
    high: FloatArray
    in_range: NDArray[np.bool_]
    level: float


def checked_pairs(reading: ArrayLike, force_n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return both as finite float arrays of one length."""
    x, y = np.asarray(reading, dtype=float), np.asarray(force_n, dtype=float)
    if x.ndim != 1 or x.shape != y.shape:
        raise ValueError(f"readings and forces must be of one length, not {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise CalibrationError("force calibration: a reading or force is not a finite number")
    return x, y


def enough_pairs(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the pairs as they are, or refuse too few of them or one load only."""
    if len(x) < MIN_PAIRS:
        raise CalibrationError(
            f"force calibration: {len(x)} usable pairs, at least {MIN_PAIRS} needed; add loads"
        )
    if y.max() < MIN_LOAD_RATIO * max(y.min(), 0.0) or np.ptp(y) == 0:
        raise CalibrationError(
            f"force calibration: the load hardly changes ({y.min():g} to {y.max():g} N); "
            "use loads over the whole range"
        )
    return x, y


def law_sd(gradient: FloatArray, *, covariance: ArrayLike, residual_sd: float) -> FloatArray:
    """Return the standard deviation of a law's prediction: of its coefficients, and its scatter.

    Parameters
    ----------
    gradient : ndarray, shape (..., coefficients)
        Of the prediction by the coefficients.
    covariance : array_like, shape (coefficients, coefficients)
        Of the coefficients.
    residual_sd : float
        Scatter of the calibration about the law.

    Examples
    --------
    >>> law_sd(np.array([[1.0, 2.0]]), covariance=np.eye(2), residual_sd=2.0).tolist()
    [3.0]
    """
    known = np.einsum("...i,ij,...j->...", gradient, np.asarray(covariance), gradient)
    return np.asarray(np.sqrt(residual_sd**2 + known))


def law_as_dict(law: Any) -> dict[str, Any]:
    """Return a law's name and numbers as plain values for a calibration file, as it reads back."""
    return {"law": law.name, **{name: _listed(value) for name, value in asdict(law).items()}}


def _listed(value: Any) -> Any:
    return [_listed(part) for part in value] if isinstance(value, tuple) else value
