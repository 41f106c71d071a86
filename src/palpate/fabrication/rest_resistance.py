"""A pixel's expected resistance at rest: a rough figure, and labelled so."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.errors import InputError

#: Velostat / Linqstat as sold by the sheet: "volume resistivity < 500 ohm cm", 0.1 mm (4 mil).
#: An upper bound of the sheet alone, from sellers' data sheets (Adafruit 1361).
SHEET_OHM_CM = 500.0
SHEET_THICKNESS_MM = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class RestExpectation:
    """How the rest resistance of a pixel follows from the area between its copper lines."""

    #: Resistance times contact area.
    ohm_mm2: float
    #: Where the number comes from and what it leaves out.
    basis: str

    def rest_ohm(self, *, contact_mm2: float) -> float:
        """Return the expected resistance of a pixel of that contact area, ohm."""
        return self.ohm_mm2 / contact_mm2


def from_sheet(
    *, volume_ohm_cm: float = SHEET_OHM_CM, thickness_mm: float = SHEET_THICKNESS_MM
) -> RestExpectation:
    """Expect the sheet alone: resistivity x thickness / area.

    >>> from_sheet().rest_ohm(contact_mm2=25.0)
    20.0
    """
    _check(volume_ohm_cm, "resistivity")
    _check(thickness_mm, "thickness")
    return RestExpectation(
        ohm_mm2=volume_ohm_cm * 10.0 * thickness_mm,
        basis=f"sheet alone, {volume_ohm_cm:g} ohm cm and {thickness_mm:g} mm; without the contact "
        "between sheet and copper, which dominates at rest: a light touch reads hundreds of ohm to "
        "tens of kiloohm. Rough; measure one pixel and give it with --measured-ohm",
    )


def from_measurement(*, ohm: float, contact_mm2: float) -> RestExpectation:
    """Expect what a pixel of your own reads at rest, scaled by contact area.

    >>> from_measurement(ohm=9000.0, contact_mm2=25.0).rest_ohm(contact_mm2=50.0)
    4500.0
    """
    _check(ohm, "measured resistance")
    _check(contact_mm2, "measured contact area")
    return RestExpectation(
        ohm_mm2=ohm * contact_mm2,
        basis=f"scaled by area from a measured {ohm:g} ohm on {contact_mm2:g} mm2. Rough: pixels "
        "of one sheet differ by a factor of two and more",
    )


def _check(value: float, what: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} {value:g}: give a positive number")
