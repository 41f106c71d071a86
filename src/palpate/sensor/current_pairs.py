"""Servo current beside a load cell while the fingers close slowly, as a calibration keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from palpate.errors import CalibrationError


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentPairs:
    """Readings of the servo's current while it closes, one entry per reading.

    At rest gears hold any part of their friction either way; in motion they take all of it.

    Attributes
    ----------
    force_n : tuple of float
        Reference: mean of the fingers' normal forces.
    current_ma : tuple of float
        What the servo reported at that moment.

    Raises
    ------
    CalibrationError
        If the columns differ in length, or hold what is no finite number.
    """

    force_n: tuple[float, ...]
    current_ma: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.force_n) != len(self.current_ma):
            raise CalibrationError(
                f"current: {len(self.force_n)} forces and {len(self.current_ma)} currents"
            )
        if not np.isfinite([*self.force_n, *self.current_ma]).all():
            raise CalibrationError("current: every entry must be a finite number")


def current_pairs_from_dict(stored: Mapping[str, Any]) -> CurrentPairs:
    """Return the pairs that a calibration file holds.

    Raises
    ------
    CalibrationError
        If a column is missing or unknown, or the data are refused.

    Examples
    --------
    >>> current_pairs_from_dict({"force_n": [0.0, 5.0], "current_ma": [30.0, 110.0]}).force_n
    (0.0, 5.0)
    """
    names = {one.name for one in fields(CurrentPairs)}
    if set(stored) != names:
        wrong = ", ".join(sorted(names ^ set(stored)))
        raise CalibrationError(f"current: missing or unknown: {wrong}; units are part of the names")
    return CurrentPairs(**{name: tuple(stored[name]) for name in names})
