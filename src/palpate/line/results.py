"""Flatten the measurements of a grasp document, in the same order for every protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from palpate.grasp.result import Outcome

#: Measurements in the order of the register map and of the OPC UA variables.
MEASUREMENTS = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent", "firmness")
#: Parts of each measurement.
PARTS = ("value", "low", "high")
#: Reason why a grasp without a name is not stored.
NO_ITEM = "no item"
#: Number of each outcome in the register map, from 1; 0 means no grasp yet.
OUTCOME_NUMBERS = {outcome.value: number for number, outcome in enumerate(Outcome, start=1)}


def list_measurements(document: Mapping[str, Any] | None) -> list[float]:
    """Return value, low and high of each measurement; NaN for unknown numbers.

    >>> values = list_measurements({"size_mm": {"value": 40.0, "low": 39.0, "high": None}})
    >>> values[:3], len(values)
    ([40.0, 39.0, nan], 15)
    """
    found = []
    for name in MEASUREMENTS:
        measured = (document or {}).get(name) or {}
        for part in PARTS:
            number = measured.get(part)
            found.append(math.nan if number is None else float(number))
    return found


def bin_of(document: Mapping[str, Any] | None) -> str:
    """Return the bin name of a grasp document, or an empty string if none."""
    found = (document or {}).get("bin") or {}
    return str(found.get("name") or "")


def is_bin_provisional(document: Mapping[str, Any] | None) -> bool:
    """Return whether the rules ask for another grasp of the same item."""
    return bool(((document or {}).get("bin") or {}).get("again"))


def not_stored_of(document: Mapping[str, Any] | None) -> str:
    """Return why a grasp was not stored; empty if it was, or without a grasp.

    >>> not_stored_of({"stored": False, "not_stored": "no item"}), not_stored_of(None)
    ('no item', '')
    """
    return str((document or {}).get("not_stored") or "")


def item_of(document: Mapping[str, Any] | None) -> str:
    """Return the item id of a grasp document, or an empty string if none."""
    document = document or {}
    return str(document.get("item_id") or (document.get("item") or {}).get("id") or "")
