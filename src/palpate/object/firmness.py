"""Firmness: an index from 0 to 100, available after every contact."""

from __future__ import annotations

import math
from dataclasses import replace

from palpate.measurement import Measurement, Status

#: Stiffness at index 0 and at index 100, N/mm: three decades, from foam to wood (a convention).
_SOFTEST, _FIRMEST = 0.1, 100.0
#: Widest interval of a firmness that is shown as a number, of 100. On the twin, wider intervals, as
#: of soft fingers after a gentle squeeze, do not rank objects by their stiffness.
_WIDEST = 60.0


def firmness_index(stiffness: Measurement) -> Measurement:
    """Convert the stiffness of an object to firmness.

    Parameters
    ----------
    stiffness : Measurement
        The object's secant stiffness at the grip force, N/mm; its value is the posterior median,
        even for a wide interval.

    Returns
    -------
    Measurement
        ``100 log10(stiffness / 0.1) / 3``, limited to 0 to 100: 1 N/mm is 33, 10 N/mm is 67. The
        logarithmic scale has a uniform error, so firmness and its interval are available even if a
        rigid hand bounds the stiffness from one side only.

    Examples
    --------
    >>> found = firmness_index(Measurement(value=10.0, low=1.0, high=400.0, unit="n_per_mm"))
    >>> round(found.value), round(found.low), round(found.high), found.unit
    (67, 33, 100, 'index')
    """
    status = Status.OK if stiffness.status is Status.SATURATED else stiffness.status
    return replace(stiffness.mapped(_index, unit="index"), status=status, reason="")


def _index(n_per_mm: float) -> float:
    index = 100.0 * math.log(n_per_mm / _SOFTEST) / math.log(_FIRMEST / _SOFTEST)
    return min(max(index, 0.0), 100.0)


def is_determined(firmness: Measurement) -> bool:
    """Return whether a firmness is known well enough to be shown as a number.

    >>> is_determined(Measurement(value=50.0, low=30.0, high=70.0, unit="index"))
    True
    >>> is_determined(Measurement(value=28.0, low=2.0, high=94.0, unit="index"))
    False
    """
    return firmness.high - firmness.low <= _WIDEST


def firmness_text(firmness: Measurement) -> str:
    """Return a firmness as a number, or as a range if it is not determined.

    >>> firmness_text(Measurement(value=28.0, low=2.0, high=94.0, unit="index"))
    '2 to 94'
    """
    if is_determined(firmness):
        return f"{firmness.middle:.0f}"
    return f"{firmness.low:.0f} to {firmness.high:.0f}"


def index_stiffness(index: float) -> float:
    """Convert a firmness index to stiffness, N/mm.

    >>> round(index_stiffness(200 / 3), 6)
    10.0
    """
    return _SOFTEST * math.pow(_FIRMEST / _SOFTEST, index / 100.0)
