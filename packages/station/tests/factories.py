"""Records that many tests of the station need."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from palpate.grasp.result import Outcome
from palpate_station.records import Grasp

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


def make_grasp(item_id: str = "A17", **known: Any) -> Grasp:
    """Return the record of a simulated rigid grasp that held its item at noon."""
    usual = {"taken_at": NOON, "rig": "sim-rigid", "drive": "width", "origin": "twin"}
    return Grasp(item_id=item_id, **(usual | {"outcome": Outcome.HELD} | known))
