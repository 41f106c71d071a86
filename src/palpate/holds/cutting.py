"""From a recording to its holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import Unit
from palpate.holds.contacts import find_contacts
from palpate.holds.hold import Hold
from palpate.holds.recordings import Readings, read_recordings
from palpate.signal.circuit import Divider, resistance_ohm

#: How holds are found: after contacts, at a time in seconds, or the whole recording as one.
CutAt: TypeAlias = Literal["auto", "none"] | float
#: More readings than this share at the end of the converter's range, and it isn't a hold of these.
_SATURATED_SHARE = 0.05
_FEWEST = 2
#: A wire that comes loose reads 0 now and then; with more than this it isn't a resistance.
MOST_BELOW_SHARE = 0.02
#: The largest counts of converters of 8 to 16 bits, and the smallest.
_CONVERTER_ENDS = {0.0, *(2.0**bits - 1 for bits in range(8, 17))}


@dataclass(frozen=True, slots=True, kw_only=True)
class CutColumn:
    """One sensor of a recording, and where its holds are."""

    #: Its name.
    column: str
    #: Shape (n_times,). Its readings, missing ones left out.
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    #: Unit of these readings, where it is known; holds are in ohm where a divider made them so.
    unit: str | None
    #: Beginning and end of each hold, seconds of the recording; as many as `holds`.
    spans: list[tuple[float, float]]
    #: Time 0 is where the hold begins.
    holds: list[Hold]
    #: Why there is no hold; empty if there is one.
    reason: str = ""
    #: What should be known about them.
    remarks: list[str] = field(default_factory=list)


def cut_holds(recording: Any, values: Any = None, *, cut: CutAt = "auto") -> list[Hold]:
    """Cut the holds out of a recording: what follows each contact, until it is opened.

    Parameters
    ----------
    recording : Readings, whatever `read_recording` takes, or times
        With `values`: times in seconds, shape (n_times,).
    values : array_like, shape (n_times,), optional
        Readings at these times.
    cut : {"auto", "none"} or float
        After each contact; the whole recording as one hold; or from this moment on, seconds.

    Returns
    -------
    list of Hold
        Named ``NAME:COLUMN:N``, with time 0 where loading ended.

    Raises
    ------
    InputError
        If no column has a hold; the message explains why.

    Examples
    --------
    >>> time_s = np.arange(0, 9, 0.05)
    >>> values = np.where((time_s > 3) & (time_s < 6), 10.0, 50.0)
    >>> [(hold.hold_id, round(hold.time_s[-1])) for hold in cut_holds(time_s, values)]
    [('recording:value:1', 3)]
    """
    if values is not None:
        recording = {"time_s": recording, "value": values}
    parts = [recording] if isinstance(recording, Readings) else read_recordings(recording)
    columns = [column for part in parts for column in cut_columns(part, cut=cut)]
    holds = [hold for column in columns for hold in column.holds]
    if not holds:
        raise InputError(explain_no_hold(parts[0].name, columns))
    return holds


def explain_no_hold(name: str, columns: list[CutColumn]) -> str:
    """Return the one line that explains why a recording has no hold."""
    first, *others = columns
    more = f" (likewise the other {len(others)} columns)" if others else ""
    return (
        f"{name}: {first.column}: {first.reason}{more}. `--cut SECONDS` sets where a hold begins, "
        "`--cut none` takes the whole recording as one"
    )


def cut_columns(readings: Readings, *, cut: CutAt = "auto") -> list[CutColumn]:
    """Cut each column; the parameters are those of `cut_holds`."""
    if readings.is_hold and cut == "auto":
        cut = "none"
    return [_cut_column(readings, name, cut) for name in readings.columns]


def _cut_column(readings: Readings, name: str, cut: CutAt) -> CutColumn:
    values, remarks = readings.columns[name], list[str]()
    unit, usable = _select_usable(values, readings.units[name], remarks=remarks)
    if unit == "counts" and readings.divider is None:
        remarks.append(
            "taken as counts; --adc-bits, --reference-ohm and --sensor-leg make ohm of them"
        )
    time_s, values = readings.time_s[usable], values[usable]
    spans, reason = _spans(time_s, values, unit=unit, cut=cut, remarks=remarks)
    divider, ends = _converter(readings, name, values)
    holds: list[Hold] = []
    held: list[tuple[float, float]] = []
    for begin_s, end_s in spans:
        rows = (time_s >= begin_s) & (time_s <= end_s)
        sound = ~np.isin(values[rows], ends)
        if np.mean(~sound) > _SATURATED_SHARE or sound.sum() < _FEWEST:
            reason = (
                f"at {begin_s:.4g} s {np.mean(~sound):.0%} of the readings are at the end of the "
                "converter's range; another reference resistor is needed"
            )
            remarks.append(f"a hold is left out: {reason}")
            continue
        kept = values[rows][sound]
        holds.append(
            Hold(
                hold_id=f"{readings.name}:{name}:{len(holds) + 1}",
                channel=None,
                time_s=time_s[rows][sound] - begin_s,
                values=resistance_ohm(kept, divider=divider) if divider else kept,
                unit="ohm" if divider else unit,
            )
        )
        held.append((begin_s, end_s))
    return CutColumn(
        column=name,
        time_s=time_s,
        values=values,
        unit=unit,
        spans=held,
        holds=holds,
        reason="" if holds else reason,
        remarks=remarks,
    )


def _select_usable(
    values: NDArray[np.float64], unit: Unit | None, *, remarks: list[str]
) -> tuple[Unit | None, NDArray[np.bool_]]:
    """Return the unit, None where the readings can't have it, and the usable readings."""
    finite = np.isfinite(values)
    below = int(np.sum(values[finite] <= 0))
    if unit != "ohm" or below == 0:
        return unit, finite
    if below > MOST_BELOW_SHARE * finite.sum():
        remarks.append(f"{below} readings are at or below 0, so they are not taken as ohm")
        return None, finite
    remarks.append(f"{below} readings at or below 0 ohm are no resistances; left out")
    return unit, finite & (values > 0)


def _spans(
    time_s: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    unit: str | None,
    cut: CutAt,
    remarks: list[str],
) -> tuple[list[tuple[float, float]], str]:
    """Return beginning and end of each hold, and the reason if there is none."""
    if time_s.size < _FEWEST:
        return [], "fewer than two readings"
    if cut != "auto":
        begin_s = float(time_s[0]) if cut == "none" else float(cut)
        left = int(np.sum(time_s >= begin_s))
        spans = [(begin_s, float(time_s[-1]))] if left >= _FEWEST else []
        return spans, f"no reading after {begin_s:g} s; it ends at {time_s[-1]:g} s"
    found = find_contacts(time_s, values, unit=unit)
    if found.began_loaded:
        remarks.append("it begins in the middle of a hold, whose contact isn't in it; left out")
    if found.rises and found.holds and unit == "ohm":
        remarks.append(
            "resistance rises at contact: is it the other sensor leg, or does the recording begin "
            "under load?"
        )
    return [(contact.start_s, contact.end_s) for contact in found.holds], found.reason()


def _converter(
    readings: Readings, name: str, values: NDArray[np.float64]
) -> tuple[Divider | None, list[float]]:
    """Return the conversion of counts to ohm, and the saturated ends of its range.

    Without a divider, counts stay as they are.
    """
    unit, divider = readings.units[name], readings.divider
    if divider is None or unit not in ("counts", None):
        ends = {0.0, float(values.max(initial=0.0))} & _CONVERTER_ENDS
        return None, sorted(ends) if unit == "counts" else []
    top = divider.full_scale - 1
    if values.size and not (values.min() >= 0 and values.max() <= top):
        raise InputError(
            f"{readings.name}: {name} goes from {values.min():g} to {values.max():g}, and "
            f"{divider.adc_bits} bits count from 0 to {top}; give other --adc-bits, or --unit"
        )
    return divider, [0.0, top]
