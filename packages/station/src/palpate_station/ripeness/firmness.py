"""Firmness of an item from a grasp: one number that decreases as the item softens.

Fingers driven by width measure the item's stiffness. Fingers driven by pressure do not measure
deformation. Their firmness is calculated from the number of pixels that share the load: under the
same force a soft item touches more of the pad than a hard item (Hertz: the contact radius is
proportional to the square root of the deformation). Both quantities are logarithms, so halving the
quantity always causes the same change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike

from palpate.grasp.result import Outcome
from palpate.object.firmness import index_stiffness
from palpate.sensor.sample import excess_of_change
from palpate_station.records import Grasp

#: Grip force of the ripeness measurement, newtons. It deforms a hard fruit by a third of a
#: millimetre and does not bruise a ripe one (thumbs bruise avocados from about 10 N on).
RIPENESS_N = 5.0
#: Minimum fall of a pixel's resistance in the calculation; smaller falls are raised to this value.
_LEAST_PERCENT = 1.0
DAY_S = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DayFirmness:
    """Firmness of one item on one day."""

    #: Days since the item's first grasp, with a fractional part.
    day: float
    #: Mean of the day's grasps, on the scale of `firmness_of`. The average is taken over softness
    #: (compliance or loaded pixels), whose errors are symmetric.
    firmness: float
    #: Number of grasps.
    grasps: int
    #: Sample standard deviation of their firmness; NaN for a single grasp.
    spread: float


def firmness_of(grasp: Grasp) -> float | None:
    """Return the firmness from a grasp; None if the object was not held or measured.

    With fingers driven by width, the firmness is the ln of the stiffness in N/mm at 5 N. The
    stiffness of a round body is proportional to the cube root of the force. The stiffness is
    calculated from the firmness index, because a gentle squeeze often yields only a bound on it.
    The index counts at `firmness_force_n`, and in older records at the grip force.

    With fingers driven by pressure, the firmness is -ln of the number of pixels that share the
    load. If the closing measured the width, the number is corrected for size and force
    (`palpate_station.ripeness.shared_load`). The two scales are not comparable.

    >>> from datetime import UTC, datetime
    >>> from palpate.measurement import Measurement
    >>> measurements = {
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
    ...     measurements=measurements,
    ... )
    >>> round(math.exp(firmness_of(grasp)), 2)
    3.16
    """
    if grasp.outcome is not Outcome.HELD:
        return None
    if grasp.drive == "pressure":
        shared, pixels = grasp.find_value("shared_pixels"), grasp.pixel_settled_percent
        if shared is not None:
            return -math.log(shared.middle)
        return None if pixels is None else minus_log_sharing(np.array(pixels, dtype=float))
    index, force = grasp.find_value("firmness"), grasp.find_value("force_n")
    at_n = grasp.firmness_force_n
    if at_n is None and force is not None:
        at_n = force.middle
    if index is None or at_n is None or at_n <= 0:
        return None
    return math.log(index_stiffness(index.middle)) - math.log(at_n / RIPENESS_N) / 3.0


def minus_log_sharing(percent: ArrayLike) -> float | None:
    """Return -ln of the effective number of loaded pixels; None without load or two pixels.

    The effective number is (sum of excess conductance)^2 / sum of (excess conductance)^2.

    `percent`, shape (rows, cols): relative change of each pixel; NaN for a pixel out of use.

    >>> round(math.exp(-minus_log_sharing([[-50.0, -50.0], [-50.0, np.nan]])), 6)
    3.0
    """
    fallen = np.maximum(-np.array(percent, dtype=float), _LEAST_PERCENT)
    fallen = fallen[np.isfinite(fallen)]
    if fallen.size < 2 or fallen.max() <= 2 * _LEAST_PERCENT:
        return None
    excess = excess_of_change(-fallen)
    return -math.log(float(excess.sum() ** 2 / (excess**2).sum()))


def group_by_day(readings: Iterable[tuple[datetime, float]]) -> tuple[DayFirmness, ...]:
    """Group firmness readings into days of 24 h, oldest first.

    The mean is taken over softness, because the firmness of hard items has large outliers.

    >>> from datetime import UTC, datetime
    >>> first, later = datetime(2026, 5, 1, 8, tzinfo=UTC), datetime(2026, 5, 2, 10, tzinfo=UTC)
    >>> days = group_by_day([(later, 1.0), (first, 2.0), (first, 3.0)])
    >>> [(round(day.day, 3), round(day.firmness, 3)) for day in days]
    [(0.0, 2.38), (1.083, 1.0)]
    """
    ordered = sorted(readings)
    if not ordered:
        return ()
    elapsed_days = [(at - ordered[0][0]).total_seconds() / DAY_S for at, _ in ordered]
    # Days begin 6 h before the time of the first grasp, because mornings start at different hours.
    number = np.floor(np.array(elapsed_days) + 0.25).astype(int)
    days = []
    for one in np.unique(number):
        chosen = np.flatnonzero(number == one)
        values = [ordered[index][1] for index in chosen]
        days.append(
            DayFirmness(
                day=float(np.mean([elapsed_days[index] for index in chosen])),
                firmness=-float(np.log(np.mean(np.exp(-np.array(values))))),
                grasps=len(values),
                spread=float(np.std(values, ddof=1)) if len(values) > 1 else math.nan,
            )
        )
    return tuple(days)


def pool_variance(days: Sequence[DayFirmness]) -> float:
    """Return the pooled within-day variance between grasps; 0 if no day had two.

    >>> pool_variance([DayFirmness(day=0.0, firmness=1.0, grasps=3, spread=0.5)])
    0.25
    """
    repeated = [day for day in days if day.grasps > 1]
    freedom = sum(day.grasps - 1 for day in repeated)
    squared = sum((day.grasps - 1) * day.spread**2 for day in repeated)
    return squared / freedom if freedom else 0.0
