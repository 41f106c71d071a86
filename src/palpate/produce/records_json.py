"""Records as one line of JSON each, and back: for what waits, and for programs that ask."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from typing import Any, TypeAlias

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.produce.records import Grasp, Item, Verdict
from palpate.settling.result import Status


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationText:
    """The text of a calibration file that grasps refer to."""

    content: str


StoreRecord: TypeAlias = Item | CalibrationText | Grasp | Verdict
_KINDS: Mapping[str, type[StoreRecord]] = {
    "item": Item,
    "calibration": CalibrationText,
    "grasp": Grasp,
    "verdict": Verdict,
}
_TIMES = ("first_seen", "taken_at", "given_at")


def record_as_dict(record: StoreRecord) -> dict[str, Any]:
    """Return a record as JSON values: its fields by name, times in ISO 8601.

    >>> record_as_dict(Item(item_id="A17", kind="kiwi"))["kind"]
    'kiwi'
    """
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    for name in _TIMES:
        if isinstance(values.get(name), datetime):
            values[name] = values[name].isoformat()
    if isinstance(record, Grasp):
        values["measurements"] = {
            name: measured.to_dict() for name, measured in record.measurements.items()
        }
    if isinstance(record, Verdict):
        values["details"] = dict(record.details)
    return values


def record_to_json(record: StoreRecord) -> str:
    """Return a record as one line.

    >>> record_from_json(record_to_json(Item(item_id="A17"))).item_id
    'A17'
    """
    kind = next(name for name, known in _KINDS.items() if isinstance(record, known))
    values = record_as_dict(record)
    if isinstance(record, Grasp):
        # People are not shown the middle of a bound; a record keeps it.
        values["measurements"] = {
            name: asdict(measured) for name, measured in record.measurements.items()
        }
    return json.dumps({kind: values}, allow_nan=False)


def record_from_json(text: str) -> StoreRecord:
    """Return the record of a line.

    Raises `InputError` if the line is none that `record_to_json` made.
    """
    try:
        ((kind, values),) = json.loads(text).items()
        for name in _TIMES:
            if values.get(name) is not None:
                values[name] = datetime.fromisoformat(values[name])
        if kind == "grasp":
            values["measurements"] = {
                name: Measurement(**{**measured, "status": Status(measured["status"])})
                for name, measured in values["measurements"].items()
            }
            if values["pixel_settled_percent"] is not None:
                values["pixel_settled_percent"] = tuple(map(tuple, values["pixel_settled_percent"]))
        return _KINDS[kind](**values)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"not a record of the store ({error}): {text[:60]}") from error
