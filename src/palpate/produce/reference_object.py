"""Drift of the sensor told from softening of the fruit, by an object that does not change.

A reference object (a rubber ball, springs between plates) is grasped like the fruit, a few times on
each day. What its firmness seems to do is what wear and weather did to the sheet; fruit felt on the
same day is freed of it. How much of it reaches a fruit depends on what gives way in series: a sheet
that reads too little force makes the gripper's own give look like too little as well, and the less
a fruit gives, the more that matters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from palpate.errors import InputError
from palpate.estimate.stiffness import Give
from palpate.produce.firmness import RIPENESS_N, by_day, firmness_of
from palpate.produce.records import Drive, Grasp

#: Firmness of a reference drifts by about so much (sd) over weeks: sheets that break in lose 10 to
#: 40 % of their conductance. What its few grasps scatter more than that is believed less.
_USUAL_DRIFT = 0.15
_DAY_S = 86_400.0
#: Beyond this, wear is more than a correction should carry, as in `palpate.sensor.wear`.
_ADVISED = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """By how much the firmness of the reference object seemed to move since its first day.

    Attributes
    ----------
    first_at : datetime
        Its first grasp.
    days : tuple of float
        Days since then on which it was felt.
    moved : tuple of float
        Change of ln stiffness (width) or of -ln sharing (pressure).
    stiffness_n_per_mm : float or None
        Of the reference, where it is known in these units.
    give_mm_per_n : float
        How far the gripper gives way per newton at the grip force.
    """

    first_at: datetime
    days: tuple[float, ...]
    moved: tuple[float, ...]
    stiffness_n_per_mm: float | None
    give_mm_per_n: float = 0.0

    @classmethod
    def learn(cls, grasps: Sequence[Grasp], *, drive: Drive, give: Give | None = None) -> Drift:
        """Learn from the grasps of the reference object by one kind of gripper.

        Parameters
        ----------
        grasps : sequence of Grasp
            Of the reference object.
        drive : {"width", "pressure"}
            Which grasps to use.
        give : Give, optional
            How far the gripper gives way, from its calibration.

        Raises
        ------
        InputError
            If it was felt on fewer than two days.
        """
        felt = [
            (grasp.taken_at, firmness)
            for grasp in grasps
            if grasp.drive == drive and (firmness := firmness_of(grasp)) is not None
        ]
        days = by_day(felt)
        if len(days) < 2:
            raise InputError(
                f"the reference object was felt on {len(days)} day(s) by a gripper driven by "
                f"{drive}; grasp it on every day on which fruit is felt"
            )
        known = [(day.spread, day.grasps) for day in days if day.grasps > 1]
        freedom = sum(count - 1 for _, count in known)
        pooled = sum((count - 1) * spread**2 for spread, count in known) / freedom if known else 0.0
        first = days[0]
        moved = []
        for day in days:
            variance = pooled * (1.0 / day.grasps + 1.0 / first.grasps)
            believed = _USUAL_DRIFT**2 / (_USUAL_DRIFT**2 + variance)
            moved.append(believed * (day.firmness - first.firmness))
        return cls(
            first_at=min(at for at, _ in felt),
            days=tuple(day.day for day in days),
            moved=tuple(moved),
            stiffness_n_per_mm=math.exp(first.firmness) if drive == "width" else None,
            give_mm_per_n=0.0 if give is None else _slope_mm_per_n(give),
        )

    def at(self, when: datetime) -> float:
        """Return the change at a time: between days in a line, before and after them constant."""
        day = (when - self.first_at).total_seconds() / _DAY_S
        return float(np.interp(day, self.days, self.moved))

    def corrected(self, firmness: float, *, at: datetime) -> float:
        """Return a firmness as the sensor would have read it on the reference's first day.

        For stiffness k, drift of the force reading by ln r moves ln k by (2/3 + c k) ln r for a
        round fruit and by (1 + c k) ln r for a linear reference, with c the gripper's give.
        """
        moved = self.at(at)
        if self.stiffness_n_per_mm is None:
            return firmness - moved
        log_ratio = moved / (1.0 + self.give_mm_per_n * self.stiffness_n_per_mm)
        share = 2.0 / 3.0 + self.give_mm_per_n * math.exp(firmness)
        return firmness - share * log_ratio

    @property
    def advice(self) -> str:
        """What to do, or nothing."""
        if abs(self.moved[-1]) <= _ADVISED:
            return ""
        return (
            f"the reference object reads {100 * math.expm1(self.moved[-1]):+.0f} % since its first "
            "day: calibrate force anew"
        )


def _slope_mm_per_n(give: Give) -> float:
    around = give.give_mm([0.9 * RIPENESS_N, 1.1 * RIPENESS_N])
    return float(np.diff(around)[0] / (0.2 * RIPENESS_N))
