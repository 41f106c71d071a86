"""What is remembered: items, grasps with their measurements, and what was said of them.

Plain values; `Store` keeps them. Times are aware and in UTC.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from types import MappingProxyType
from typing import Literal, get_args

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.record_checks import (
    as_json_values,
    as_uuid,
    even_rows,
    finite,
    in_utc,
    known_measurement,
    printable,
)
from palpate.recording.contents import Origin

#: Names of the measurements of a grasp, each with its unit as `Measurement.unit` has it.
MEASURED = MappingProxyType(
    {
        "settled_percent": "percent",
        "size_mm": "mm",
        "force_n": "n",
        "stiffness_n_per_mm": "n_per_mm",
        "firmness_n_per_mm": "n_per_mm",
        "width_mm": "mm",
        "pressure_kpa": "kpa",
        "contact_mm": "mm",
        "shared_pixels": "pixels",
        "sheet_gain": "ratio",
    }
)
#: Relative change of each pixel at the answer, rows of columns; None for one out of use.
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
)


class About(StrEnum):
    """What a verdict is about."""

    RIPENESS = "ripeness"
    BRUISE = "bruise"
    IDENTITY = "identity"
    BIN = "bin"


class Source(StrEnum):
    """Who gave a verdict. What a person said is what the others are learned from."""

    PALPATE = "palpate"
    PERSON = "person"


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One piece of produce.

    Attributes
    ----------
    item_id : str
        What its sticker or the user calls it; unique in the store.
    kind : str or None
        What it is, where a person said so: ``"avocado"``.
    batch : str or None
        What it came with: a delivery, a crate, a tree.
    label : str or None
        A note for people.
    first_seen : datetime or None
        When it was met first; None to let the store say.

    Raises
    ------
    InputError
        If a text is empty, longer than 200 characters or not printable.

    Examples
    --------
    >>> Item(item_id="A17", kind="avocado", batch="Monday").kind
    'avocado'
    """

    item_id: str
    kind: str | None = None
    batch: str | None = None
    label: str | None = None
    first_seen: datetime | None = None

    def __post_init__(self) -> None:
        printable(self.item_id, what="item")
        for name in ("kind", "batch", "label"):
            if (text := getattr(self, name)) is not None:
                printable(text, what=name)
        if self.first_seen is not None:
            object.__setattr__(self, "first_seen", in_utc(self.first_seen, what="first_seen"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """One grasp of one item, with what it measured.

    Attributes
    ----------
    item_id : str
        Which item; one that the store does not know is added with the grasp.
    taken_at : datetime
        When; aware.
    rig : str
        Name or file of the rig.
    drive : {"width", "pressure"}
        Kind of gripper: rigid fingers or soft ones.
    origin : {"hardware", "firmware-simulated", "twin"}
        Where the frames came from; anything but `hardware` is simulated.
    outcome : Outcome
        How it ended.
    measurements : mapping of str to Measurement
        By name, see `MEASURED`. What could not be measured is left out.
    pixel_settled_percent : tuple of tuple or None
        Relative change of each pixel when the answer was given, shape (rows, cols).
    decision_time_s, peak_force_n : float or None
        From first contact to the answer; largest grip force read.
    angle_deg : float or None
        Which side of the item faced the first finger: its turn about the vertical, degrees.
    height_mm : float or None
        Where along its vertical axis it was held, from the middle upwards.
    temperature_c, humidity_percent : float or None
        Surroundings, where known.
    calibration_id : str or None
        As `Store.add_calibration` gave it.
    recording : str or None
        Where the raw frames are.
    grasp_id : str
        A UUID. The same grasp written twice is kept once.

    Raises
    ------
    InputError
        If a value is out of its kind, not finite, or a time has no zone.

    Examples
    --------
    >>> from datetime import UTC
    >>> felt = Measurement(value=2.1, low=1.7, high=2.6, unit="n_per_mm")
    >>> grasp = Grasp(
    ...     item_id="A17",
    ...     taken_at=datetime(2026, 5, 1, 8, tzinfo=UTC),
    ...     rig="sim-rigid",
    ...     drive="width",
    ...     origin="twin",
    ...     outcome=Outcome.HELD,
    ...     measurements={"stiffness_n_per_mm": felt},
    ... )
    >>> grasp.measurements["stiffness_n_per_mm"].value, grasp.simulated
    (2.1, True)
    """

    item_id: str
    taken_at: datetime
    rig: str
    drive: Drive
    origin: Origin
    outcome: Outcome
    measurements: Mapping[str, Measurement] = field(default_factory=lambda: MappingProxyType({}))
    pixel_settled_percent: PixelPercent | None = None
    decision_time_s: float | None = None
    peak_force_n: float | None = None
    angle_deg: float | None = None
    height_mm: float | None = None
    temperature_c: float | None = None
    humidity_percent: float | None = None
    calibration_id: str | None = None
    recording: str | None = None
    grasp_id: str = field(default_factory=lambda: str(uuid.uuid4()))

    def __post_init__(self) -> None:
        printable(self.item_id, what="item")
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
            known_measurement(name, measurement, units=MEASURED)
        for name in _NUMBERS:
            if (value := getattr(self, name)) is not None:
                finite(value, what=name)
                object.__setattr__(self, name, float(value))
        if self.pixel_settled_percent is not None:
            pixels = even_rows(self.pixel_settled_percent, what="pixel_settled_percent")
            object.__setattr__(self, "pixel_settled_percent", pixels)

    @property
    def simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Something said of an item, by palpate or by a person.

    Attributes
    ----------
    item_id : str
        Which item; it must be in the store.
    about : About
        Ripeness, bruise, identity or bin.
    text : str
        The verdict itself, short: ``"ripe"``, ``"bruised"``, ``"kiwi"``, ``"bin 2"``.
    given_at : datetime
        When; aware.
    probability : float or None
        That it is right, in [0, 1].
    explanation : str
        Why, in a sentence that a person can check.
    details : mapping of str to JSON values
        Numbers behind it: ``{"days_to_ripe": 2.1, "days_to_ripe_low": 1.2, ...}``,
        ``{"probabilities": {"kiwi": 0.9, ...}}``.
    grasp_id : str or None
        The grasp that it rests on, where it is one.
    source : Source
        `person` for a label, which the others learn from.
    verdict_id : str
        A UUID. The same verdict written twice is kept once.

    Raises
    ------
    InputError
        If a value is out of its kind, a detail is no JSON, or a time has no zone.

    Examples
    --------
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

    item_id: str
    about: About
    text: str
    given_at: datetime
    probability: float | None = None
    explanation: str = ""
    details: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    grasp_id: str | None = None
    source: Source = Source.PALPATE
    verdict_id: str = field(default_factory=lambda: str(uuid.uuid4()))

    def __post_init__(self) -> None:
        printable(self.item_id, what="item")
        printable(self.text, what="text")
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One measurement of an item's history, and how it was taken.

    Attributes
    ----------
    taken_at : datetime
        When.
    measurement : Measurement
        Value with its interval.
    grasp_id, rig, drive, origin
        Of the grasp it comes from.
    angle_deg : float or None
        Which side of the item was felt.
    """

    taken_at: datetime
    measurement: Measurement
    grasp_id: str
    rig: str
    drive: Drive
    origin: Origin
    angle_deg: float | None = None
