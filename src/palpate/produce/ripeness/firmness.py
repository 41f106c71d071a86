"""Firmness of an item by a grasp: one number that falls as it softens.

Fingers driven by width measure the item's stiffness. Fingers driven by pressure measure no
deformation; but a soft item lies against more of the pad than a hard one does under the same force
(Hertz: the radius of contact goes with the square root of the deformation), so the number of pixels
that share the load shows it. Both are compared as logarithms: a halving counts alike wherever it
happens.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike

from palpate.estimate.firmness import index_stiffness
from palpate.grasp.result import Outcome
from palpate.produce.records import Grasp

#: Grip force of the ripeness measurement: enough to deform a hard fruit by a third of a millimetre,
#: too little to bruise a ripe one (thumbs bruise avocados from about 10 N on).
RIPENESS_N = 5.0
#: A pixel that lost less than this fraction of its resistance carries nothing that can be counted.
_LEAST_PERCENT = 1.0
DAY_S = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DayFelt:
    """One item on one day."""

    #: Days since the item's first grasp, as a fraction.
    day: float
    #: Of the day's grasps, as `firmness_of` gives it; what is averaged is how soft they found the
    #: item (compliance, or pixels that share), because errors lie evenly about that.
    firmness: float
    #: How many they were.
    grasps: int
    #: Their sample standard deviation; NaN for a single one.
    spread: float


def firmness_of(grasp: Grasp) -> float | None:
    """Return the firmness by a grasp; None if the object was not held or measured.

    Fingers driven by width: ln of the stiffness in N/mm as it would be at 5 N (round bodies stiffen
    as the cube root of the force), from the firmness index of the answer, because a gentle squeeze
    only bounds many a stiffness. By pressure: -ln of the number of pixels that share the
    load, freed of size and force (`palpate.produce.ripeness.shared_load`) where the closing gave
    the width. The two are not comparable with each other.

    >>> from datetime import UTC, datetime
    >>> from palpate.estimate.measurement import Measurement
    >>> felt = {
    ...     "firmness": Measurement(value=50.0, low=48.0, high=52.0, unit="index"),
    ...     "force_n": Measurement(value=5.0, low=4.5, high=5.5, unit="n"),
    ... }
    >>> grasp = Grasp(
    ...     item_id="A17",
    ...     taken_at=datetime(2026, 5, 1, 8, tzinfo=UTC),
    ...     rig="sim-rigid",
    ...     drive="width",
    ...     origin="twin",
    ...     outcome=Outcome.HELD,
    ...     measurements=felt,
    ... )
    >>> round(math.exp(firmness_of(grasp)), 2)
    3.16
    """
    if grasp.outcome is not Outcome.HELD:
        return None
    if grasp.drive == "pressure":
        shared, pixels = grasp.measurements.get("shared_pixels"), grasp.pixel_settled_percent
        if shared is not None:
            return -math.log(shared.middle)
        return None if pixels is None else minus_log_sharing(np.array(pixels, dtype=float))
    index, force = grasp.measurements.get("firmness"), grasp.measurements.get("force_n")
    if index is None or force is None or force.middle <= 0:
        return None
    return math.log(index_stiffness(index.middle)) - math.log(force.middle / RIPENESS_N) / 3.0


def minus_log_sharing(percent: ArrayLike) -> float | None:
    """Return -ln of (sum of excess)^2 / sum of excess^2, the effective number of pixels.

    `percent`, shape (rows, cols): relative change of each pixel; NaN for one out of use.

    >>> round(math.exp(-minus_log_sharing([[-50.0, -50.0], [-50.0, np.nan]])), 6)
    3.0
    """
    fallen = np.clip(-np.array(percent, dtype=float), _LEAST_PERCENT, 99.9) / 100.0
    fallen = fallen[np.isfinite(fallen)]
    if fallen.size < 2 or fallen.max() <= 2 * _LEAST_PERCENT / 100.0:
        return None
    excess = fallen / (1.0 - fallen)
    return -math.log(float(excess.sum() ** 2 / (excess**2).sum()))


def by_day(felt: Iterable[tuple[datetime, float]]) -> tuple[DayFelt, ...]:
    """Gather times and firmness into days (24 h from the first grasp on), oldest first.

    Scatter of a hard item's grasps runs far off on the hard side; of softness it does not.

    >>> from datetime import UTC, datetime
    >>> first, later = datetime(2026, 5, 1, 8, tzinfo=UTC), datetime(2026, 5, 2, 10, tzinfo=UTC)
    >>> days = by_day([(later, 1.0), (first, 2.0), (first, 3.0)])
    >>> [(round(day.day, 3), round(day.firmness, 3)) for day in days]
    [(0.0, 2.38), (1.083, 1.0)]
    """
    ordered = sorted(felt)
    if not ordered:
        return ()
    since = [(at - ordered[0][0]).total_seconds() / DAY_S for at, _ in ordered]
    # Mornings differ by an hour or two; grasps of one morning must not fall on two days.
    number = np.floor(np.array(since) + 0.25).astype(int)
    days = []
    for one in np.unique(number):
        chosen = np.flatnonzero(number == one)
        values = [ordered[index][1] for index in chosen]
        days.append(
            DayFelt(
                day=float(np.mean([since[index] for index in chosen])),
                firmness=-float(np.log(np.mean(np.exp(-np.array(values))))),
                grasps=len(values),
                spread=float(np.std(values, ddof=1)) if len(values) > 1 else math.nan,
            )
        )
    return tuple(days)


def pool_variance(days: Sequence[DayFelt]) -> float:
    """Return the variance between grasps of one day; 0 where no day had two.

    >>> pool_variance([DayFelt(day=0.0, firmness=1.0, grasps=3, spread=0.5)])
    0.25
    """
    again = [day for day in days if day.grasps > 1]
    freedom = sum(day.grasps - 1 for day in again)
    squared = sum((day.grasps - 1) * day.spread**2 for day in again)
    return squared / freedom if freedom else 0.0
