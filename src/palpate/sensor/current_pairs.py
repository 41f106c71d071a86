"""Servo current beside a load cell while the fingers close slowly, as a calibration keeps it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.errors import CalibrationError


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentPairs:
    """Readings of the servo's current while it closes, one entry per reading.

    At rest gears hold any part of their friction either way; in motion they take all of it.

    Raises
    ------
    CalibrationError
        If the columns differ in length, or hold what is no finite number.
    """

    #: Reference: mean of the fingers' normal forces.
    force_n: tuple[float, ...]
    #: What the servo reported at that moment.
    current_ma: tuple[float, ...]
    #: Opening at that moment; empty in older files.
    width_mm: tuple[float, ...] = ()
    #: Number of the movement that the reading was taken in; empty in older files.
    movement: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if len(self.force_n) != len(self.current_ma):
            raise CalibrationError(
                f"current: {len(self.force_n)} forces and {len(self.current_ma)} currents"
            )
        for name in ("width_mm", "movement"):
            if len(getattr(self, name)) not in (0, len(self.force_n)):
                raise CalibrationError(
                    f"current: {len(self.force_n)} forces and {len(getattr(self, name))} {name}"
                )
        if bool(self.width_mm) != bool(self.movement):
            raise CalibrationError("current: width_mm and movement go together")
        if not np.isfinite([*self.force_n, *self.current_ma, *self.width_mm]).all():
            raise CalibrationError("current: every entry must be a finite number")


def joined(*parts: CurrentPairs) -> CurrentPairs:
    """Return the readings of several runs as one, their movements numbered through.

    Examples
    --------
    >>> one = CurrentPairs(force_n=(0.0,), current_ma=(40.0,), width_mm=(30.0,), movement=(0,))
    >>> joined(one, one).movement
    (0, 1)
    """
    numbers, first = list[int](), 0
    for part in parts:
        numbers += [first + number for number in part.movement]
        first += 1 + max(part.movement, default=-1)
    return CurrentPairs(
        force_n=tuple(value for part in parts for value in part.force_n),
        current_ma=tuple(value for part in parts for value in part.current_ma),
        width_mm=tuple(value for part in parts for value in part.width_mm),
        movement=tuple(numbers),
    )
