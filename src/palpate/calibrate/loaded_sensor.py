"""Readings of a sensor with the loads that are known of them, and the options to read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from palpate.arrays import FloatArray
from palpate.holds.columns import TimeUnit
from palpate.holds.loads import LoadUnit
from palpate.holds.units import Unit
from palpate.signal.circuit import Divider


@dataclass(frozen=True, slots=True, kw_only=True)
class TableOptions:
    """The user's description of a table, as in `palpate.read_recording`."""

    time_column: str | None = None
    time_unit: TimeUnit | None = None
    value_columns: Sequence[str] = ()
    unit: Unit | None = None
    divider: Divider | None = None
    #: Resolution of counts whose reference resistor is unknown.
    adc_bits: int | None = None
    #: Supply of the divider of readings in volts.
    supply_v: float | None = None
    interval_s: float | None = None
    sheet: str | None = None
    decimal: Literal["point", "comma"] | None = None
    load_column: str | None = None
    load_unit: LoadUnit | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadedPart:
    """One recording, or the settled readings of a table.

    Attributes
    ----------
    name : str
        Name of the recording.
    time_s : ndarray, shape (n,)
        Seconds; row numbers of settled readings.
    values : ndarray, shape (n, columns)
        Readings as in the table; NaN where missing, infinity above the range of a meter.
    load_n : ndarray, shape (n,)
        Known loads, newtons; NaN where unknown.
    weighed : tuple of (float, float, float)
        Begin and end of the reading under each weight, seconds, and its newtons.
    """

    name: str
    time_s: FloatArray
    values: FloatArray
    load_n: FloatArray
    weighed: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadedSensor:
    """The readings of one sensor.

    Attributes
    ----------
    name : str
        Name of the file, and of the sensor if the file has several.
    columns : tuple of str
        Columns of its pixels.
    unit : str or None
        Unit of the readings.
    divider : Divider or None
        Circuit of counts.
    adc_bits : int or None
        Resolution of counts, if only that is known.
    parts : tuple of LoadedPart
        Recordings in the order of the table.
    is_settled : bool
        Whether each row is a settled reading, and not a moment of a recording.
    taken : list of str
        What was taken as what, one sentence each.
    remarks : list of str
        Omissions and assumptions of the reader.
    """

    name: str
    columns: tuple[str, ...]
    unit: Unit | None
    divider: Divider | None
    adc_bits: int | None
    parts: tuple[LoadedPart, ...]
    is_settled: bool
    taken: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
