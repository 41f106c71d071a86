"""How many readings come within a tolerance, how long they take, and how many items to test."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.stats import norm

from palpate.produce.qualify.agreement import Agreement, Demand


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """What a demand costs.

    Attributes
    ----------
    reference_readings, grasps : int or None
        Readings of an item whose mean is within the tolerance of what the item is; None where no
        number of them is.
    mismatch : float
        Standard deviation of what no repeat takes away: the two instruments feel different things.
    items_per_hour : float or None
        At that number of grasps.
    items_to_test : int
        Items that show each limit of agreement to within half the tolerance.
    """

    reference_readings: int | None
    grasps: int | None
    mismatch: float
    items_per_hour: float | None
    items_to_test: int


def effort_of(found: Agreement, demand: Demand, *, grasp_s: float, handling_s: float) -> Effort:
    """Return what a demand costs.

    Parameters
    ----------
    found : Agreement
        Of the readings.
    demand : Demand
        Tolerance and level.
    grasp_s, handling_s : float
        Seconds of each grasp, and of the handling of an item.

    References
    ----------
    J. M. Bland, D. G. Altman, Lancet 327 (1986) 307: a limit of agreement has the standard error
    sqrt(3 / n) times the standard deviation of the differences.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.produce.qualify.agreement import agreement_of
    >>> from palpate.produce.qualify.readings import PairedReadings
    >>> random = np.random.default_rng(3)
    >>> item = np.repeat(np.arange(60), 2)
    >>> firmness = random.normal(70, 6, 60)[item]
    >>> readings = PairedReadings(
    ...     item=item,
    ...     reference=firmness + random.normal(0, 3, 120),
    ...     grasp=firmness + random.normal(0, 1, 120),
    ... )
    >>> demand = Demand(tolerance=3.0)
    >>> effort = effort_of(agreement_of(readings, demand), demand, grasp_s=15, handling_s=5)
    >>> effort.reference_readings, effort.grasps, effort.items_per_hour
    (3, 1, 180.0)
    """
    reach = float(norm.ppf(0.5 + demand.level / 2.0))
    spread = float(found.difference.std(ddof=1))
    # The differences hold the scatter of both instruments and their mismatch.
    known = sum(s.within**2 for s in (found.reference, found.grasp) if math.isfinite(s.within))
    mismatch = math.sqrt(max(0.0, spread**2 - known))
    grasps = _readings(found.grasp.within, mismatch, reach=reach, tolerance=demand.tolerance)
    test = 3.0 * (reach * spread / (demand.tolerance / 2.0)) ** 2
    return Effort(
        reference_readings=_readings(
            found.reference.within, 0.0, reach=reach, tolerance=demand.tolerance
        ),
        grasps=grasps,
        mismatch=mismatch,
        items_per_hour=None if grasps is None else 3600.0 / (grasps * grasp_s + handling_s),
        items_to_test=math.ceil(test),
    )


def _readings(within: float, fixed: float, *, reach: float, tolerance: float) -> int | None:
    """Return how many readings of this scatter average to within the tolerance."""
    left = (tolerance / reach) ** 2 - fixed**2
    if left <= 0 or not math.isfinite(within):
        return None
    return max(1, math.ceil(within**2 / left))
