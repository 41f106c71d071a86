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
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.estimate.stiffness import Give
from palpate.produce.firmness import RIPENESS_N, by_day, firmness_of
from palpate.produce.records import Drive, Grasp

#: Drift is taken to wander by so much in the root of a day (sheets that break in lose 10 to 40 % of
#: their conductance in a few days, and a firm reference shows it about doubled) and to jump by so
#: much from day to day with the weather; or by any of these shares of that: a sensor that has
#: broken in shows it by how little its reference moves beyond its scatter.
_WANDER, _WEATHER = 0.1, 0.05
_SHARES = np.geomspace(1 / 16, 2.0, 11)
#: Least share of the deformation read that is taken to be the fruit's.
_LEAST_SHARE = 0.2
FloatArray = NDArray[np.float64]

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
        moved = _smoothed(
            np.array([day.day - first.day for day in days]),
            np.array([day.firmness - first.firmness for day in days]),
            variance=np.array([pooled / day.grasps for day in days]),
        )
        return cls(
            first_at=min(at for at, _ in felt),
            days=tuple(day.day for day in days),
            moved=tuple(moved.tolist()),
            stiffness_n_per_mm=math.exp(first.firmness) if drive == "width" else None,
            give_mm_per_n=0.0 if give is None else _slope_mm_per_n(give),
        )

    def at(self, when: datetime) -> float:
        """Return the change at a time: between days in a line, before and after them constant."""
        day = (when - self.first_at).total_seconds() / _DAY_S
        return float(np.interp(day, self.days, self.moved))

    def corrected(self, firmness: float, *, at: datetime) -> float:
        """Return a firmness as the sensor would have read it on the reference's first day.

        Compliances add. Where the sensor reads r times the true force, a linear reference of
        compliance 1 / k reads as 1 / (k r) + c (1 / r - 1), and a round fruit (Hertz) as
        r^(-2/3) / k + c (1 / r - 1), with c the gripper's give per newton.
        """
        moved = self.at(at)
        if self.stiffness_n_per_mm is None:
            return firmness - moved
        give, reference = self.give_mm_per_n, 1.0 / self.stiffness_n_per_mm
        more = (reference * math.exp(-moved) + give) / (reference + give)
        read = math.exp(-firmness)
        # So much of what was read is fruit at least, however far the sensor has drifted.
        fruit = max(read - give * (more - 1.0), _LEAST_SHARE * read)
        return -math.log(fruit) + 2.0 / 3.0 * math.log(more)

    @property
    def advice(self) -> str:
        """What to do, or nothing."""
        if abs(self.moved[-1]) <= _ADVISED:
            return ""
        return (
            f"the reference object reads {100 * math.expm1(self.moved[-1]):+.0f} % since its first "
            "day: calibrate force anew"
        )


def _smoothed(day: FloatArray, moved: FloatArray, *, variance: FloatArray) -> FloatArray:
    """Return the expected drift of each day, given what was read on all of them.

    The first day's scatter is in the change of every later one. How much of what is read is drift
    is weighed by how probable it makes all of it (marginal likelihood).
    """
    since, read = day[1:] - day[0], moved[1:]
    usual = _WANDER**2 * np.minimum.outer(since, since) + _WEATHER**2 * np.eye(since.size)
    scatter = np.diag(np.maximum(variance[1:], 1e-9)) + variance[0]
    drifts, log_weights = [], []
    for share in _SHARES:
        drift = share**2 * usual
        solved = np.linalg.solve(drift + scatter, read)
        log_weights.append(-0.5 * (read @ solved + np.linalg.slogdet(drift + scatter)[1]))
        drifts.append(drift @ solved)
    weight = np.exp(np.array(log_weights) - max(log_weights))
    return np.concatenate([[0.0], weight @ np.array(drifts) / weight.sum()])


def _slope_mm_per_n(give: Give) -> float:
    around = give.give_mm([0.9 * RIPENESS_N, 1.1 * RIPENESS_N])
    return float(np.diff(around)[0] / (0.2 * RIPENESS_N))
