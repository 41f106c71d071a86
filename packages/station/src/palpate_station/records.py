"""Stored records: items, grasps with their measurements, and verdicts.

The records are plain values, stored by `Store`. Times have a time zone and are converted to UTC.
"""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from types import MappingProxyType
from typing import Literal, get_args

from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.recording.contents import Origin

#: Names of the measurements of a grasp, with the unit (`Measurement.unit`) of each.
MEASURED = MappingProxyType(
    {
        "settled_percent": "percent",
        "size_mm": "mm",
        "force_n": "n",
        "stiffness_n_per_mm": "n_per_mm",
        "firmness": "index",
        "width_mm": "mm",
        "pressure_kpa": "kpa",
        "contact_mm": "mm",
        "shared_pixels": "pixels",
    }
)
#: Columns of exports with the bin of a grasp: name, reason, probability, whether another grasp may
#: change it, and who decided.
BIN_COLUMNS = ("bin", "bin_why", "bin_probability", "bin_provisional", "bin_by")
#: Relative change of each pixel at the answer, in rows; None for a pixel out of use.
PixelPercent = tuple[tuple[float | None, ...], ...]
Drive = Literal["width", "pressure"]
#: Optional numbers of a grasp.
_NUMBERS = (
    "decision_time_s",
    "peak_force_n",
    "angle_deg",
    "height_mm",
    "temperature_c",
    "humidity_percent",
    "firmness_force_n",
)

_LONGEST = 200


class About(StrEnum):
    """The subject of a verdict."""

    RIPENESS = "ripeness"
    BRUISE = "bruise"
    IDENTITY = "identity"
    BIN = "bin"


class Source(StrEnum):
    """The author of a verdict. People's verdicts are the training labels."""

    PALPATE = "palpate"
    PERSON = "person"


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One piece of produce.

    Raises `InputError` if a text is empty, longer than 200 characters or not printable.

    >>> Item(item_id="A17", kind="avocado", batch="Monday").kind
    'avocado'
    """

    #: Name on the item's sticker, or given by the user; unique in the store.
    item_id: str
    #: Kind of produce, if a person stated it: ``"avocado"``.
    kind: str | None = None
    #: Delivery, crate or tree that the item belongs to.
    batch: str | None = None
    #: A note for people.
    label: str | None = None
    #: Time of the first record; None for the time of writing.
    first_seen: datetime | None = None

    def __post_init__(self) -> None:
        check_printable(self.item_id, what="item")
        for name in ("kind", "batch", "label"):
            if (text := getattr(self, name)) is not None:
                check_printable(text, what=name)
        if self.first_seen is not None:
            object.__setattr__(self, "first_seen", in_utc(self.first_seen, what="first_seen"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """One grasp of one item, with its measurements.

    Raises `InputError` if a value is not allowed or not finite, or a time has no time zone.

    >>> from datetime import UTC
    >>> stiffness = Measurement(value=2.1, low=1.7, high=2.6, unit="n_per_mm")
    >>> grasp = Grasp(
    ...     item_id="A17",
    ...     taken_at=datetime(2026, 5, 1, 8, tzinfo=UTC),
    ...     rig="sim-rigid",
    ...     drive="width",
    ...     origin="twin",
    ...     outcome=Outcome.HELD,
    ...     measurements={"stiffness_n_per_mm": stiffness},
    ... )
    >>> grasp.measurements["stiffness_n_per_mm"].value, grasp.is_simulated
    (2.1, True)
    """

    #: Name of the item; the store adds an unknown item with the grasp.
    item_id: str
    #: Time of the grasp, with time zone.
    taken_at: datetime
    #: Name or file of the rig.
    rig: str
    #: Kind of gripper: rigid fingers or soft ones.
    drive: Drive
    #: Source of the frames; every source except `hardware` is simulated.
    origin: Origin
    #: Outcome of the grasp.
    outcome: Outcome
    #: Measurements by name, see `MEASURED`, some of them only bounds. Missing ones are omitted.
    measurements: Mapping[str, Measurement] = field(default_factory=lambda: MappingProxyType({}))
    #: Relative change of each pixel at the answer, shape (rows, cols).
    pixel_settled_percent: PixelPercent | None = None
    #: Time from first contact to the answer; largest measured grip force.
    decision_time_s: float | None = None
    peak_force_n: float | None = None
    #: Side of the item at the first finger: rotation about the vertical axis, degrees.
    angle_deg: float | None = None
    #: Height of the grasp above the middle of the item.
    height_mm: float | None = None
    #: Ambient temperature and humidity; None if unknown.
    temperature_c: float | None = None
    humidity_percent: float | None = None
    #: Force at which the firmness counts; None in records before it was chosen.
    firmness_force_n: float | None = None
    #: ID returned by `Store.add_calibration`.
    calibration_id: str | None = None
    #: File of the raw frames.
    recording: str | None = None
    #: Name of the station that made the grasp; None if unknown.
    station: str | None = None
    #: A UUID. A grasp that is written twice is stored once.
    grasp_id: str = field(default_factory=lambda: str(uuid.uuid4()))

    def __post_init__(self) -> None:
        check_printable(self.item_id, what="item")
        if self.station is not None:
            check_printable(self.station, what="station")
        object.__setattr__(self, "grasp_id", as_uuid(self.grasp_id, what="grasp_id"))
        object.__setattr__(self, "taken_at", in_utc(self.taken_at, what="taken_at"))
        object.__setattr__(self, "outcome", Outcome(self.outcome))
        object.__setattr__(self, "measurements", MappingProxyType(dict(self.measurements)))
        for name, allowed in (("drive", get_args(Drive)), ("origin", get_args(Origin))):
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name} {getattr(self, name)!r}: must be one of {', '.join(allowed)}"
                )
        for name, measurement in self.measurements.items():
            check_measurement(name, measurement, units=MEASURED)
        for name in _NUMBERS:
            if (value := getattr(self, name)) is not None:
                check_finite(value, what=name)
                object.__setattr__(self, name, float(value))
        if self.pixel_settled_percent is not None:
            pixels = check_rows(self.pixel_settled_percent, what="pixel_settled_percent")
            object.__setattr__(self, "pixel_settled_percent", pixels)

    def find_value(self, name: str) -> Measurement | None:
        """Return a measurement; None if it is missing or only a bound."""
        found = self.measurements.get(name)
        return found if found is not None and found.has_value else None

    @property
    def is_simulated(self) -> bool:
        """Whether the grasp is simulated."""
        return self.origin != "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A verdict on an item, by palpate or by a person.

    Raises `InputError` if a value is not allowed, a detail is not JSON, or a time has no time zone.

    >>> from datetime import UTC
    >>> Verdict(
    ...     item_id="A17",
    ...     about=About.RIPENESS,
    ...     text="ripe",
    ...     given_at=datetime(2026, 5, 4, 8, tzinfo=UTC),
    ...     source=Source.PERSON,
    ... ).about.value
    'ripeness'
    """

    #: Name of the item, which must be in the store.
    item_id: str
    #: Ripeness, bruise, identity or bin.
    about: About
    #: The verdict itself, short: ``"ripe"``, ``"bruised"``, ``"kiwi"``, ``"bin 2"``.
    text: str
    #: Time of the verdict, with time zone.
    given_at: datetime
    #: Probability that the verdict is correct, in [0, 1].
    probability: float | None = None
    #: Reason, as a sentence that a person can check.
    explanation: str = ""
    #: Supporting numbers: ``{"days_to_ripe": 2.1, "days_to_ripe_low": 1.2, ...}``,
    #: ``{"probabilities": {"kiwi": 0.9, ...}}``.
    details: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    #: Grasp that the verdict is based on, if it is a single grasp.
    grasp_id: str | None = None
    #: Author; a verdict by `person` is a training label.
    source: Source = Source.PALPATE
    #: A UUID. A verdict that is written twice is stored once.
    verdict_id: str = field(default_factory=lambda: str(uuid.uuid4()))

    @property
    def giver(self) -> str:
        """Who gave the verdict: palpate, a person's name, or ``a person``."""
        is_person = self.source is Source.PERSON
        return str(self.details.get("by", "a person") if is_person else self.source)

    def __post_init__(self) -> None:
        check_printable(self.item_id, what="item")
        check_printable(self.text, what="text")
        object.__setattr__(self, "about", About(self.about))
        object.__setattr__(self, "source", Source(self.source))
        object.__setattr__(self, "given_at", in_utc(self.given_at, what="given_at"))
        object.__setattr__(self, "verdict_id", as_uuid(self.verdict_id, what="verdict_id"))
        object.__setattr__(self, "details", MappingProxyType(as_json_values(self.details)))
        if self.grasp_id is not None:
            object.__setattr__(self, "grasp_id", as_uuid(self.grasp_id, what="grasp_id"))
        if self.probability is not None:
            if not 0 <= self.probability <= 1:
                raise InputError(f"probability {self.probability:g}: must be within 0 and 1")
            object.__setattr__(self, "probability", float(self.probability))


def check_printable(text: str, *, what: str) -> None:
    """Refuse text that is empty, too long or not printable."""
    if not text.strip() or len(text) > _LONGEST or not text.isprintable():
        raise InputError(
            f"{what} {text[:40]!r}: must be 1 to {_LONGEST} printable characters, not all spaces"
        )


def in_utc(time: datetime, *, what: str) -> datetime:
    """Return a time in UTC; refuse one without a time zone."""
    if time.tzinfo is None:
        raise InputError(f"{what} {time.isoformat()}: has no time zone; give one, as in 08:00Z")
    return time.astimezone(UTC)


def as_uuid(text: str, *, what: str) -> str:
    """Return a UUID in canonical form."""
    try:
        return str(uuid.UUID(text))
    except ValueError as error:
        raise InputError(f"{what} {text[:40]!r}: not a UUID") from error


def as_json_values(details: Mapping[str, object]) -> dict[str, object]:
    """Return details after a JSON round trip, as the store returns them."""
    try:
        # JSON turns tuples into lists and keys into text.
        found: dict[str, object] = json.loads(json.dumps(dict(details), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"details can't be stored as JSON: {error}") from error
    return found


def check_finite(value: float, *, what: str) -> None:
    """Refuse infinities and NaN."""
    if not math.isfinite(value):
        raise InputError(f"{what} is {value}: must be finite; omit it if it is unknown")


def check_measurement(name: str, measurement: Measurement, *, units: Mapping[str, str]) -> None:
    """Refuse a measurement with an unknown name, a wrong unit or a non-finite number."""
    if name not in units:
        raise InputError(f"measurement {name!r}: must be one of {', '.join(units)}")
    if measurement.unit != units[name]:
        raise InputError(f"{name} in {measurement.unit!r}: its unit is {units[name]!r}")
    low, high = measurement.known_ends
    # The unknown limit of a bound may be infinite.
    for end, value in (("value", measurement.value), ("low", low), ("high", high)):
        if value is not None:
            check_finite(value, what=f"{name}.{end}")
    if math.isnan(measurement.low) or math.isnan(measurement.high):
        raise InputError(f"{name} has a limit that is not a number; omit the measurement")


def check_rows(
    rows: Sequence[Sequence[float | None]], *, what: str
) -> tuple[tuple[float | None, ...], ...]:
    """Return rows as tuples of float; refuse infinite values and rows of unequal length."""
    if len({len(row) for row in rows}) != 1:
        raise InputError(f"{what}: every row needs the same number of pixels")
    for row in rows:
        for value in row:
            if value is not None:
                check_finite(value, what=what)
    return tuple(tuple(None if v is None else float(v) for v in row) for row in rows)
