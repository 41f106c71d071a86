"""What every record is checked for, so that nothing odd reaches the store."""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement

_LONGEST = 200


def printable(text: str, *, what: str) -> None:
    """Refuse text that is empty, too long or not for reading."""
    if not text.strip() or len(text) > _LONGEST or not text.isprintable():
        raise InputError(
            f"{what} {text[:40]!r}: must be 1 to {_LONGEST} printable characters, not all spaces"
        )


def in_utc(time: datetime, *, what: str) -> datetime:
    """Return a moment in UTC; refuse one whose zone is not known."""
    if time.tzinfo is None:
        raise InputError(f"{what} {time.isoformat()}: has no time zone; give one, as in 08:00Z")
    return time.astimezone(UTC)


def as_uuid(text: str, *, what: str) -> str:
    """Return a UUID in its one spelling."""
    try:
        return str(uuid.UUID(text))
    except ValueError as error:
        raise InputError(f"{what} {text[:40]!r}: not a UUID") from error


def as_json_values(details: Mapping[str, object]) -> dict[str, object]:
    """Return details as they will come back from the store."""
    try:
        # As it will come back: tuples are lists in JSON, keys are text.
        found: dict[str, object] = json.loads(json.dumps(dict(details), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"details can't be kept as JSON: {error}") from error
    return found


def finite(value: float, *, what: str) -> None:
    """Refuse infinities and NaN."""
    if not math.isfinite(value):
        raise InputError(f"{what} is {value}: must be finite; leave it out if it is not known")


def known_measurement(name: str, measurement: Measurement, *, units: Mapping[str, str]) -> None:
    """Refuse a measurement of another name, in another unit, or that is not finite."""
    if name not in units:
        raise InputError(f"measurement {name!r}: must be one of {', '.join(units)}")
    if measurement.unit != units[name]:
        raise InputError(f"{name} in {measurement.unit!r}: its unit is {units[name]!r}")
    for end in ("value", "low", "high"):
        finite(getattr(measurement, end), what=f"{name}.{end}")


def even_rows(
    rows: Sequence[Sequence[float | None]], *, what: str
) -> tuple[tuple[float | None, ...], ...]:
    """Return rows of one length as plain values; refuse others, and what is not finite."""
    if len({len(row) for row in rows}) != 1:
        raise InputError(f"{what}: every row needs the same number of pixels")
    for row in rows:
        for value in row:
            if value is not None:
                finite(value, what=what)
    return tuple(tuple(None if v is None else float(v) for v in row) for row in rows)
