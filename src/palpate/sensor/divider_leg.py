"""Whether the pixels are in the other part of the voltage divider than the layout says.

With the wrong part each resistance R is read as R_ref^2 / R: a press raises it, and at rest it is
small. Every number that follows from it is wrong too, such as a better reference resistor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.sensor.findings import Finding, Severity
from palpate.sensor.reference_resistor import ResistorFit, fit_reference

#: A press raises the resistance by at least this; climate and recovery by less in minutes, percent.
_RISE_PERCENT = 50.0
#: No pixel falls by this, percent: twice the paper's contact threshold.
_FALL_PERCENT = -20.0
#: Frames of a rise; fewer are spikes.
_FEWEST_RISEN = 3


def is_risen(change_percent: FloatArray) -> bool:
    """Return whether pixels only rise; `change_percent`, shape (rows, cols), NaN if unknown.

    >>> is_risen(np.array([[150.0, np.nan]])), is_risen(np.array([[150.0, -30.0]]))
    (True, False)
    """
    low = float(np.nanmin(change_percent, initial=0.0))
    return float(np.nanmax(change_percent, initial=0.0)) >= _RISE_PERCENT and low > _FALL_PERCENT


def find_wrong_leg(
    change_percent: FloatArray, *, fit: ResistorFit | None, layout: ArrayLayout
) -> Finding | None:
    """Return a fault if presses raise the resistance, advice if the values at rest suggest it.

    `change_percent`, shape (frames, pixels): of working pixels, from rest.
    `fit`: check of the reference resistor with the present leg.
    """
    leg = layout.divider.taxel_leg
    risen = sum(is_risen(frame) for frame in change_percent)
    if risen >= _FEWEST_RISEN and float(np.min(change_percent, initial=0.0)) > _FALL_PERCENT:
        most = float(np.max(change_percent))
        other = "lower" if leg == "upper" else "upper"
        text = f'a press raises the resistance (by up to {most:.0f} %): the leg is "{other}"'
        return Finding("leg", text, f'taxel_leg "{leg}"')
    if fit is None or fit.is_adequate or fit.high_ohm >= fit.present_ohm:
        return None
    swapped = replace(layout.divider, taxel_leg="lower" if leg == "upper" else "upper")
    low_ohm, high_ohm = (fit.present_ohm**2 / end for end in (fit.high_ohm, fit.low_ohm))
    # At rest the lower end is that under load, which is as far below.
    span = high_ohm / low_ohm
    if not fit_reference(low_ohm=low_ohm / span, high_ohm=low_ohm, divider=swapped).is_adequate:
        return None
    return Finding(
        "leg",
        f"at rest the pixels read {fit.high_ohm:.0f} ohm, which does not suit the "
        f"{fit.present_ohm:g} ohm resistor; in the other part of the divider they would be "
        f"{low_ohm:.0f} ohm, which does",
        f'taxel_leg "{leg}"',
        Severity.ADVICE,
    )
