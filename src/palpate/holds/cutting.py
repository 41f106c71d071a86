"""Cutting of holds out of a recording."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.contacts import find_contacts
from palpate.holds.gaps import split_at_open
from palpate.holds.hold import Hold
from palpate.holds.recordings import ReadingTable, read_recordings
from palpate.holds.units import Unit
from palpate.signal.circuit import Divider, resistance_ohm

#: Method of cutting: after contacts, at a time in seconds, or the whole recording as one hold.
CutAt: TypeAlias = Literal["auto", "none"] | float
#: A hold is rejected if more than this fraction of its readings is saturated.
_MAX_SATURATED_FRACTION = 0.05
_MIN_READINGS = 2
#: A loose wire occasionally reads 0. With more such readings, the column isn't a resistance.
MAX_NEGATIVE_FRACTION = 0.02
#: The number that a logger writes for an open circuit; a few of them are a loose wire.
_OVERRANGE = re.compile(r"9{4,}(\.9+)?")
#: Smallest and largest counts of converters with 8 to 16 bits.
_CONVERTER_ENDS = {0.0, *(2.0**bits - 1 for bits in range(8, 17))}


@dataclass(frozen=True, slots=True, kw_only=True)
class CutColumn:
    """One column of a recording and its holds."""

    #: Name of the column.
    column: str
    #: Shape (n_times,). Readings; NaN where there is none, or no usable one.
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    #: Unit of `values`, if known. With a divider, the holds are in ohm instead.
    unit: str | None
    #: Start and end of each of `holds`, seconds of the recording.
    spans: list[tuple[float, float]]
    #: Time 0 is the start of the hold.
    holds: list[Hold]
    #: The reason if no hold was found; else empty.
    reason: str = ""
    #: Assumptions and omissions, one sentence each.
    remarks: list[str] = field(default_factory=list)


def cut_holds(recording: Any, values: Any = None, *, cut: CutAt = "auto") -> list[Hold]:
    """Extract the holds of a recording, each from a contact to the opening after it.

    Parameters
    ----------
    recording : ReadingTable, or any source of `read_recording`
        If `values` is given: times in seconds, shape (n_times,).
    values : array_like, shape (n_times,), optional
        Readings at these times.
    cut : {"auto", "none"} or float
        Cut after each contact; use the whole recording as one hold; or start one hold at this time,
        seconds.

    Returns
    -------
    list of Hold
        Named ``NAME:COLUMN:N``; time 0 is the end of loading.

    Raises
    ------
    InputError
        If no column has a hold; the message contains the reason.

    Examples
    --------
    >>> time_s = np.arange(0, 9, 0.05)
    >>> values = np.where((time_s > 3) & (time_s < 6), 10.0, 50.0)
    >>> [(hold.hold_id, round(hold.time_s[-1])) for hold in cut_holds(time_s, values)]
    [('recording:value:1', 3)]
    """
    if values is not None:
        recording = {"time_s": recording, "value": values}
    parts = [recording] if isinstance(recording, ReadingTable) else read_recordings(recording)
    columns = [column for part in parts for column in cut_columns(part, cut=cut)]
    holds = [hold for column in columns for hold in column.holds]
    if not holds:
        raise InputError(explain_no_hold(parts[0].name, columns))
    return holds


def explain_no_hold(name: str, columns: list[CutColumn]) -> str:
    """Return a one-line explanation for a recording without holds."""
    first, *others = columns
    more = f" (likewise the other {len(others)} columns)" if others else ""
    return (
        f"{name}: {first.column}: {first.reason}{more}. `--cut SECONDS` sets the start of a hold, "
        "`--cut none` uses the whole recording as one hold"
    )


def cut_columns(readings: ReadingTable, *, cut: CutAt = "auto") -> list[CutColumn]:
    """Cut each column of a recording; parameters as in `cut_holds`."""
    if readings.is_hold and cut == "auto":
        cut = "none"
    return [_cut_column(readings, name, cut) for name in readings.columns]


def _cut_column(readings: ReadingTable, name: str, cut: CutAt) -> CutColumn:
    values, remarks = readings.columns[name], list[str]()
    unit, usable = _select_usable(values, readings.units[name], remarks=remarks)
    if unit == "counts" and readings.divider is None:
        remarks.append(
            "interpreted as counts; --adc-bits, --reference-ohm and --sensor-leg convert counts "
            "to ohm"
        )
    # A reading above the range is not used, but means that the sensor is open.
    known = np.where(usable | np.isposinf(values), values, np.nan)
    spans, reason = _find_spans(readings.time_s, known, unit=unit, cut=cut, remarks=remarks)
    shown = np.where(usable, values, np.nan)
    time_s, values = readings.time_s[usable], values[usable]
    divider, ends = _find_divider(readings, name, values)
    holds: list[Hold] = []
    hold_spans: list[tuple[float, float]] = []
    for begin_s, end_s in spans:
        rows = (time_s >= begin_s) & (time_s <= end_s)
        in_range = ~np.isin(values[rows], ends)
        if rows.sum() < _MIN_READINGS:
            reason = f"at {begin_s:.4g} s the hold has fewer than {_MIN_READINGS} readings"
            remarks.append(f"one hold was omitted: {reason}")
            continue
        if np.mean(~in_range) > _MAX_SATURATED_FRACTION or in_range.sum() < _MIN_READINGS:
            reason = (
                f"at {begin_s:.4g} s {np.mean(~in_range):.0%} of the readings are at the end of "
                "the converter's range; use another reference resistor"
            )
            remarks.append(f"one hold was omitted: {reason}")
            continue
        hold_values = values[rows][in_range]
        holds.append(
            Hold(
                hold_id=f"{readings.name}:{name}:{len(holds) + 1}",
                channel=None,
                # Otherwise a sample at 2.5 s may be a rounding error after a cut-off of 2.5 s.
                time_s=np.round(time_s[rows][in_range] - begin_s, 9),
                values=resistance_ohm(hold_values, divider=divider) if divider else hold_values,
                unit="ohm" if divider else unit,
            )
        )
        hold_spans.append((begin_s, end_s))
    return CutColumn(
        column=name,
        time_s=readings.time_s,
        values=shown,
        unit=unit,
        spans=hold_spans,
        holds=holds,
        reason="" if holds else reason,
        remarks=remarks,
    )


def _select_usable(
    values: NDArray[np.float64], unit: Unit | None, *, remarks: list[str]
) -> tuple[Unit | None, NDArray[np.bool_]]:
    """Return the unit (None if the values contradict it) and a mask of usable readings."""
    finite = np.isfinite(values)
    levels, counts = np.unique(values[finite], return_counts=True)
    if unit == "ohm" and levels.size > 1 and _OVERRANGE.fullmatch(f"{levels[-1]:.12g}"):
        over = int(counts[-1])
        if over <= MAX_NEGATIVE_FRACTION * finite.sum() and levels[-1] > 2.0 * levels[-2]:
            remarks.append(f"{over} readings of {levels[-1]:.12g} were omitted, as of a loose wire")
            finite &= values < levels[-1]
    below = int(np.sum(values[finite] <= 0))
    if unit != "ohm" or below == 0:
        return unit, finite
    if below > MAX_NEGATIVE_FRACTION * finite.sum():
        remarks.append(f"{below} readings are at or below 0, so the column is not in ohm")
        return None, finite
    remarks.append(f"{below} readings at or below 0 ohm are not resistances and were omitted")
    return unit, finite & (values > 0)


def _find_spans(
    time_s: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    unit: str | None,
    cut: CutAt,
    remarks: list[str],
) -> tuple[list[tuple[float, float]], str]:
    """Return start and end of each hold, and the reason if there is none.

    `values`, shape (n_times,): NaN where missing, infinity where above the range.
    """
    readable_s = time_s[np.isfinite(values)]
    if readable_s.size < _MIN_READINGS:
        return [], "fewer than two readings"
    if cut != "auto":
        begin_s = float(readable_s[0]) if cut == "none" else float(cut)
        remaining = int(np.sum(readable_s >= begin_s))
        spans = [(begin_s, float(readable_s[-1]))] if remaining >= _MIN_READINGS else []
        return spans, (
            f"fewer than {_MIN_READINGS} readings after {begin_s:g} s; the recording ends at "
            f"{readable_s[-1]:g} s"
        )
    pieces = split_at_open(time_s, values, unit=unit)
    if len(pieces) > 1 or pieces[0][0].size > readable_s.size:
        remarks.append("has no readings at rest; a gap is taken as no contact")
    found = [find_contacts(*piece, unit=unit) for piece in pieces]
    held = [contact for piece in found for contact in piece.holds]
    if any(piece.began_loaded for piece in found):
        remarks.append("the recording begins during a hold; that hold was omitted")
    if any(piece.rises for piece in found) and held and unit == "ohm":
        remarks.append(
            "resistance rises at contact: check --sensor-leg, and whether the recording begins "
            "under load"
        )
    # A gap at rest has no time of its own at which the reading changes.
    spans = [
        (
            float(readable_s[np.searchsorted(readable_s, one.start_s)]),
            float(readable_s[np.searchsorted(readable_s, one.end_s, side="right") - 1]),
        )
        if len(pieces) > 1 or pieces[0][0].size > readable_s.size
        else (one.start_s, one.end_s)
        for one in held
    ]
    return spans, found[0].reason()


def _find_divider(
    readings: ReadingTable, name: str, values: NDArray[np.float64]
) -> tuple[Divider | None, list[float]]:
    """Return the divider (None: no conversion) and the counts at the ends of its range."""
    unit, divider = readings.units[name], readings.divider
    if divider is None or unit not in ("counts", None):
        ends = {0.0, float(values.max(initial=0.0))} & _CONVERTER_ENDS
        return None, sorted(ends) if unit == "counts" else []
    top = divider.full_scale - 1
    if values.size and not (values.min() >= 0 and values.max() <= top):
        raise InputError(
            f"{readings.name}: {name} ranges from {values.min():g} to {values.max():g}, but "
            f"{divider.adc_bits} bits count from 0 to {top}; correct --adc-bits or --unit"
        )
    return divider, [0.0, top]
