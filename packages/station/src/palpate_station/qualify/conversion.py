"""The line that converts grasps to the unit of a buyer's instrument, and its file."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate.files import atomic_path, load_json

if TYPE_CHECKING:
    from palpate_station.qualify.agreement import Agreement
    from palpate_station.qualify.readings import PairedReadings

#: Measurements of a grasp that can be converted.
CONVERTIBLE = ("firmness", "stiffness_n_per_mm", "settled_percent", "size_mm", "force_n")
_FORMAT = "palpate-reference-1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversion:
    """The result of a qualification: reference = offset + slope x measurement.

    >>> line = Conversion(
    ...     measurement="firmness", unit="lbf", slope=0.25, offset=1.0, half_width=1.5,
    ...     lowest=30.0, highest=70.0, items=40, simulated=False,
    ... )
    >>> line.convert(52.0)["value"], line.convert(52.0)["low"]
    (14.0, 12.5)
    >>> line.convert(80.0)["value"], line.convert(80.0)["reason"]
    (None, 'firmness 80 is outside of the qualified range, 30 to 70')
    """

    #: Name of the converted measurement of a grasp.
    measurement: str
    #: Unit of the reference.
    unit: str
    slope: float
    offset: float
    #: Limit of agreement: 95 % of the readings of the reference differ less from a converted grasp.
    half_width: float
    #: Range of the grasps of the qualification.
    lowest: float
    highest: float
    #: Number of items of the qualification.
    items: int
    #: Whether any of its grasps was simulated.
    simulated: bool

    @classmethod
    def from_agreement(
        cls,
        agreement: Agreement,
        pairs: PairedReadings,
        *,
        measurement: str,
        unit: str,
        simulated: bool,
    ) -> Conversion:
        """Return the line of an agreement, for the range of its grasps.

        `pairs`: the readings of the agreement, whose grasps are this `measurement`.
        """
        taken = pairs.grasp[pairs.has_both]
        return cls(
            measurement=measurement,
            unit=unit,
            slope=agreement.slope,
            offset=agreement.offset,
            half_width=agreement.figures["limit_of_agreement"].value,
            lowest=float(taken.min()),
            highest=float(taken.max()),
            items=pairs.items,
            simulated=simulated,
        )

    def convert(self, value: float | None) -> dict[str, object]:
        """Return a measurement in the unit of the reference, as `reference` in the JSON of a grasp.

        Numbers are null without a measurement, and outside of the range of the qualification, where
        the line is unproven.
        """
        found: dict[str, object] = {"unit": self.unit, "level": 0.95, "reason": None}
        if value is None:
            reason = f"{self.measurement} was not measured"
        elif not self.lowest <= value <= self.highest:
            reason = (
                f"{self.measurement} {value:.3g} is outside of the qualified range, "
                f"{self.lowest:.3g} to {self.highest:.3g}"
            )
        else:
            middle = self.offset + self.slope * value
            low, high = middle - self.half_width, middle + self.half_width
            return {"value": middle, "low": low, "high": high, **found}
        return {"value": None, "low": None, "high": None, **found, "reason": reason}

    def save(self, path: Path) -> None:
        """Write the file for `palpate serve --reference`."""
        with atomic_path(path) as partial:
            partial.write_text(json.dumps({"format": _FORMAT, **asdict(self)}, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path) -> Conversion:
        """Read a file of `save`.

        Raises `InputError` if the file can't be read or is not such a file.
        """
        try:
            values = load_json(path.read_text(encoding="utf-8"))
            is_ours = isinstance(values, dict) and values.pop("format", "") == _FORMAT
            if not is_ours or values.keys() != {one.name for one in fields(cls)}:
                raise ValueError("not a file of `palpate qualify --save`")
            found = cls(**values)
            numbers = (found.slope, found.offset, found.half_width, found.lowest, found.highest)
            if not all(math.isfinite(number) for number in numbers):
                raise ValueError("a number is not finite")
        except (OSError, ValueError, TypeError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise InputError(f"--reference {path}: {why}") from error
        if found.measurement not in CONVERTIBLE:
            raise InputError(f"--reference {path}: no measurement {found.measurement!r}")
        return found
