"""Drift of the sensor told from softening of the fruit, by an object that does not change.

A reference object (a rubber ball, springs between plates) is grasped like the fruit, some times on
each day. What it seems to do is what wear and weather did to the sensor; fruit felt on the same day
is freed of it.

Fingers driven by width press one object as hard at one width on all days. So where the width at
which the sensor says 5 N has moved, the sensor has; and a width is told to hundredths of a
millimetre, where the object's stiffness is told to a tenth. Fingers driven by pressure tell
firmness by how the load is shared, and what their reference seems to do in this is taken away as it
is.

Its grasps also tell how far to believe a servo's current beside the sheet, and what its warming up
does to a morning (`palpate.produce.ripeness.reference_force`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.compliance import Compliance
from palpate.produce.records import Drive, Grasp
from palpate.produce.ripeness.firmness import RIPENESS_N, by_day, firmness_of
from palpate.produce.ripeness.reference_force import ForceRead

#: Drift is taken to wander by so much in the root of a day (sheets that break in lose 10 to 40 % of
#: their conductance in a few days) and to jump by so much from day to day with the weather; or by
#: any of these shares of that: a sensor that has broken in, or that a servo's current seconds,
#: shows it by how little its reference moves beyond its scatter.
_WANDER, _WEATHER = 0.1, 0.05
_SHARES = np.geomspace(1 / 16, 2.0, 11)
#: Least share of the deformation read that is taken to be the fruit's.
_LEAST_SHARE = 0.2

_DAY_S = 86_400.0
#: Beyond this, wear is more than a correction should carry, as in `palpate_studies.wear`.
_ADVISED = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """By how much the sensor seems to have moved since the reference object's first day."""

    #: Its first grasp.
    first_at: datetime
    #: Days since then on which it was felt.
    days: tuple[float, ...]
    #: Width: ln of the force that is read over the true one. Pressure: change of -ln sharing.
    moved: tuple[float, ...]
    #: Of these two.
    drive: Drive
    #: How far a hand driven by width gives way per newton at the grip force.
    give_mm_per_n: float = 0.0
    #: What the widths told of the forces read; None by a hand driven by pressure.
    force: ForceRead | None = None

    @classmethod
    def learn(
        cls, grasps: Sequence[Grasp], *, drive: Drive, give: Compliance | None = None
    ) -> Drift:
        """Learn from the grasps of the reference object by one kind of gripper.

        Parameters
        ----------
        grasps : sequence of Grasp
            Of the reference object.
        drive : {"width", "pressure"}
            Which grasps to use.
        give : Compliance, optional
            How far the gripper gives way, from its calibration.

        Raises
        ------
        InputError
            If it was felt on fewer than two days.
        """
        used = [grasp for grasp in grasps if grasp.drive == drive]
        give_mm_per_n = 0.0 if give is None else _slope_mm_per_n(give)
        force = (
            None if drive == "pressure" else ForceRead.by_width(used, give_mm_per_n=give_mm_per_n)
        )
        read = _firmness(used) if force is None else force.read
        days = by_day(read)
        if len(days) < 2:
            kept = " with its width kept" if drive == "width" else ""
            raise InputError(
                f"the reference object was felt on {len(days)} day(s){kept} by a gripper driven "
                f"by {drive}; grasp it on every day on which fruit is felt"
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
            first_at=min(at for at, _ in read),
            days=tuple(day.day for day in days),
            moved=tuple(moved.tolist()),
            drive=drive,
            give_mm_per_n=give_mm_per_n,
            force=force,
        )

    def at(self, when: datetime) -> float:
        """Return the change at a time: between days in a line, before and after them constant.

        Within a morning on which the reference was felt, what warms up is in it.
        """
        day = (when - self.first_at).total_seconds() / _DAY_S
        moved = float(np.interp(day, self.days, self.moved))
        since_h = 24.0 * min((day - one for one in self.days), key=abs)
        return moved if self.force is None else moved + self.force.warmed(since_h)

    def freed(self, firmness: float, *, grasp: Grasp) -> float:
        """Return the firmness of a grasp as the sensor would have read it on the first day.

        Compliances add: of what a hand closes at 5 N read, its own give is taken out as of 5 N.
        Where the true force is r times that, a round fruit (Hertz) of compliance C at 5 N reads as
        r^(2/3) C + c ln r, with c the gripper's give per newton.
        """
        moved = self.at(grasp.taken_at)
        if self.force is not None:
            moved += self.force.said_too_much(grasp)
        if self.drive == "pressure":
            return firmness - moved
        read = math.exp(-firmness)
        # So much of what was read is fruit at least, however far the sensor has drifted.
        fruit = max(read + self.give_mm_per_n * moved, _LEAST_SHARE * read)
        return -math.log(fruit) - 2.0 / 3.0 * moved

    @property
    def advice(self) -> str:
        """What to do, or nothing."""
        if abs(self.moved[-1]) <= _ADVISED:
            return ""
        return (
            f"the reference object reads {100 * math.expm1(self.moved[-1]):+.0f} % since its first "
            "day: calibrate force anew"
        )


def _firmness(grasps: Sequence[Grasp]) -> list[tuple[datetime, float]]:
    """Return the firmness of each grasp that tells one."""
    return [
        (grasp.taken_at, firmness)
        for grasp in grasps
        if (firmness := firmness_of(grasp)) is not None
    ]


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


def _slope_mm_per_n(give: Compliance) -> float:
    around = give.give_mm([0.9 * RIPENESS_N, 1.1 * RIPENESS_N])
    return float(np.diff(around)[0] / (0.2 * RIPENESS_N))
