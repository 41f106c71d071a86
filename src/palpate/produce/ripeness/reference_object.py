"""Drift of the sensor, measured on an object that does not change.

A reference object (a rubber ball, springs between plates) is grasped like the fruit, several times
on each day. Its apparent change is the effect of wear and climate on the sensor, and is subtracted
from fruit of the same day.

Fingers driven by width press one object as hard at one width on all days. So where the width at
which the sensor reads 5 N has moved, the sensor has drifted; and a width is known to hundredths of
a millimetre, where the object's stiffness is known to a tenth. Fingers driven by pressure measure
firmness by how the load is shared, and the reference's apparent change of it is subtracted as it
is.
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
from palpate.produce.ripeness.firmness import (
    DAY_S,
    RIPENESS_N,
    by_day,
    firmness_of,
    pool_variance,
)

#: Drift is taken to wander by this much in the root of a day (sheets that break in lose 10 to 40 %
#: of their conductance in a few days) and to jump by this much from day to day with the climate; or
#: by any of these shares of that: a sensor that has broken in, or that a servo's current supports,
#: shows it by how little its reference moves beyond its scatter.
_WANDER, _WEATHER = 0.1, 0.05
_SHARES = np.geomspace(1 / 16, 2.0, 11)
#: Least fraction of the deformation read that is taken to be the fruit's.
_MIN_FRACTION = 0.2

#: Beyond this, wear is more than a correction should carry.
_ADVISED = 0.3

#: How much more steeply than by its secant a ball's force rises: between a spring and Hertz (1.5).
_STEEPER = 1.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Change of the sensor's reading since the reference object's first day."""

    #: Its first grasp.
    first_at: datetime
    #: Days since then with a grasp of it.
    days: tuple[float, ...]
    #: Width: ln of the force that is read over the true one. Pressure: change of -ln sharing.
    moved: tuple[float, ...]
    #: Of these two.
    drive: Drive
    #: Compliance of a width-driven gripper at the grip force, mm/N.
    compliance_mm_per_n: float = 0.0

    @classmethod
    def learn(
        cls, grasps: Sequence[Grasp], *, drive: Drive, compliance: Compliance | None = None
    ) -> Drift:
        """Learn from the grasps of the reference object by one kind of gripper.

        `grasps`: of the reference object.
        `drive` ("width" or "pressure"): which grasps to use.
        `compliance`: the gripper's compliance, from its calibration.
        Raises `InputError` if it was grasped on fewer than two days.
        """
        used = [grasp for grasp in grasps if grasp.drive == drive]
        compliance_mm_per_n = 0.0
        if drive == "width":
            if compliance is not None:
                around_mm = compliance.deflection_mm([0.9 * RIPENESS_N, 1.1 * RIPENESS_N])
                compliance_mm_per_n = float(np.diff(around_mm)[0] / (0.2 * RIPENESS_N))
            read = _log_force_errors(used, compliance_mm_per_n=compliance_mm_per_n)
        else:
            felt = ((grasp.taken_at, firmness_of(grasp)) for grasp in used)
            read = tuple((at, firmness) for at, firmness in felt if firmness is not None)
        days = by_day(read)
        if len(days) < 2:
            kept = " with its width kept" if drive == "width" else ""
            raise InputError(
                f"the reference object was grasped on {len(days)} day(s){kept} by a gripper driven "
                f"by {drive}; grasp it on every day with the fruit"
            )
        first, variance = days[0], pool_variance(days)
        moved = _expect_drift(
            np.array([day.day - first.day for day in days]),
            np.array([day.firmness - first.firmness for day in days]),
            variance=np.array([variance / day.grasps for day in days]),
        )
        return cls(
            first_at=min(at for at, _ in read),
            days=tuple(day.day for day in days),
            moved=tuple(moved.tolist()),
            drive=drive,
            compliance_mm_per_n=compliance_mm_per_n,
        )

    def at(self, when: datetime) -> float:
        """Return the change at a time: linear between days, constant outside them."""
        day = (when - self.first_at).total_seconds() / DAY_S
        return float(np.interp(day, self.days, self.moved))

    def correct(self, firmness: float, *, grasp: Grasp) -> float:
        """Return the firmness of a grasp, corrected to the sensor's first day.

        Compliances add: of what a hand closes at 5 N read, its own give is taken out as of 5 N.
        Where the true force is r times that, a round fruit (Hertz) of compliance C at 5 N reads as
        r^(2/3) C + c ln r, with c the gripper's give per newton.
        """
        moved = self.at(grasp.taken_at)
        if self.drive == "pressure":
            return firmness - moved
        read = math.exp(-firmness)
        # At least this much of what was read is fruit, however far the sensor has drifted.
        fruit = max(read + self.compliance_mm_per_n * moved, _MIN_FRACTION * read)
        return -math.log(fruit) - 2.0 / 3.0 * moved

    @property
    def advice(self) -> str:
        """The advice to the user; empty without any."""
        if abs(self.moved[-1]) <= _ADVISED:
            return ""
        return (
            f"the reference object reads {100 * math.expm1(self.moved[-1]):+.0f} % since its first "
            "day: calibrate force again"
        )


def _expect_drift(day: FloatArray, moved: FloatArray, *, variance: FloatArray) -> FloatArray:
    """Return the expected drift of each day, given the readings of all days.

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


def _log_force_errors(
    grasps: Sequence[Grasp], *, compliance_mm_per_n: float
) -> tuple[tuple[datetime, float], ...]:
    """Return ln of measured over true force in each grasp, up to a constant.

    From the width to which the hand would have closed for 5 N read; how steeply force rises over
    width follows from the gripper's give and the object's own firmness on its first day.
    """
    felt = [
        (grasp.taken_at, width.middle, force.middle, firmness)
        for grasp in sorted(grasps, key=lambda one: one.taken_at)
        if (width := grasp.measurements.get("width_mm")) is not None
        and (force := grasp.measurements.get("force_n")) is not None
        and (firmness := firmness_of(grasp)) is not None
    ]
    if not felt:
        return ()
    first = by_day((at, firmness) for at, _, _, firmness in felt)[0]
    way_mm_per_n = compliance_mm_per_n + math.exp(-first.firmness) / _STEEPER
    at_usual_mm = [width + way_mm_per_n * (force - RIPENESS_N) for _, width, force, _ in felt]
    off = (np.array(at_usual_mm) - at_usual_mm[0]) / (way_mm_per_n * RIPENESS_N)
    return tuple(zip((at for at, *_ in felt), off.tolist(), strict=True))
