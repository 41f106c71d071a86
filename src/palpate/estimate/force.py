"""Static force laws: newtons from a settled reading, with an interval and the range they hold in.

`PowerForceLaw` reads the excess conductance G/G0 - 1 summed over pixels, which hardly depends on
how the load spreads over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from numpy.typing import ArrayLike

from palpate.errors import CalibrationError
from palpate.estimate.force_pairs import ForceEstimate
from palpate.estimate.power_law import PowerForceLaw

__all__ = [
    "ForceEstimate",
    "ForceLaw",
    "PowerForceLaw",
    "law_from_dict",
]


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
