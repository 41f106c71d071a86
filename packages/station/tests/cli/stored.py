"""Grasps with measurements, for stores."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from packages.station.tests.factories import NOON, make_grasp

from palpate.measurement import Measurement, Status
from palpate_station.records import MEASURED, Grasp


def stored_grasp(
    item_id: str,
    values: Mapping[str, float],
    *,
    hours: float = 0.0,
    half: float | Mapping[str, float] = 1.0,
    status: Status = Status.OK,
    **known: Any,
) -> Grasp:
    """Return a grasp with measured values, each with an interval of twice the half-width."""
    halves = half if isinstance(half, Mapping) else dict.fromkeys(values, half)
    measured = {
        name: Measurement(
            value=value,
            low=value - halves[name],
            high=value + halves[name],
            unit=MEASURED[name],
            status=status,
        )
        for name, value in values.items()
    }
    taken_at = NOON + timedelta(hours=hours)
    return make_grasp(item_id, taken_at=taken_at, measurements=measured, **known)
