"""Flatten the measurements of a grasp document, in the same order for every protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from palpate.grasp.document import GraspDocument
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement

#: Measurements in the order of the register map and of the OPC UA variables.
MEASUREMENTS = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent", "firmness")
#: Parts of each measurement.
PARTS = ("value", "low", "high")
#: Reason why a grasp without a name is not stored.
NO_ITEM = "no item"
#: Number of each outcome in the register map, from 1; 0 means no grasp yet.
OUTCOME_NUMBERS = {outcome.value: number for number, outcome in enumerate(Outcome, start=1)}


def list_measurements(document: GraspDocument | None) -> list[float]:
    """Return value, low and high of each measurement; NaN for unknown numbers.

    >>> from palpate.grasp.result import GraspResult
    >>> size = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    >>> held = GraspDocument(result=GraspResult(outcome=Outcome.HELD, size_mm=size))
    >>> list_measurements(held)[:4], len(list_measurements(None))
    ([40.0, 39.0, 41.0, nan], 15)
    """
    found = []
    for name in MEASUREMENTS:
        measured: Measurement | None = None if document is None else getattr(document.result, name)
        parts = (None,) * 3 if measured is None else (measured.value, *measured.known_ends)
        found += [math.nan if number is None else number for number in parts]
    return found


def list_reference(reference: Mapping[str, Any] | None) -> list[float]:
    """Return value, low and high of an answer in the buyer's unit; NaN for unknown numbers."""
    numbers = [(reference or {}).get(part) for part in PARTS]
    return [math.nan if number is None else number for number in numbers]


def list_held(held: Mapping[str, Any] | None) -> list[float]:
    """Return value, low and high of each measurement of the held object, from the state document.

    >>> size = {"value": 40.0, "low": 39.0, "high": None}
    >>> list_held({"size_mm": size, "force_n": None})[:4], len(list_held(None))
    ([40.0, 39.0, nan, nan], 15)
    """
    measured = [(held or {}).get(name) or {} for name in MEASUREMENTS]
    numbers = [one.get(part) for one in measured for part in PARTS]
    return [math.nan if number is None else number for number in numbers]
