"""Tables, files and JSON of `palpate force`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.calibrate.held_out import HeldOut
from palpate.calibrate.loaded_sensor import LoadedSensor
from palpate.calibrate.recorded_force import FittedForce, ForceTrace
from palpate.cli.output import finite_or_none
from palpate.plots.force_trace import DrawnForce
from palpate.terminal_table import make_console, print_table

#: Most lines of the printed table.
_SHOWN = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceReport:
    """A sensor, its law, and the newtons of its readings."""

    sensor: LoadedSensor
    fitted: FittedForce
    traces: list[ForceTrace]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield a row for each reading; None where a number is unknown."""
        for trace in self.traces:
            columns = (trace.time_s, trace.force_n, trace.low_n, trace.high_n, trace.load_n)
            for time_s, *numbers in zip(*(one.tolist() for one in columns), strict=True):
                force_n, low_n, high_n, load_n = map(finite_or_none, numbers)
                yield {
                    "sensor": self.sensor.name,
                    "recording": trace.name,
                    "row" if self.sensor.is_settled else "time_s": (
                        round(time_s) + 1 if self.sensor.is_settled else time_s
                    ),
                    "force_n": force_n,
                    "low_n": low_n,
                    "high_n": high_n,
                    "load_n": load_n,
                }

    def contacts(self) -> list[dict[str, Any]]:
        """Return the largest force of each stretch whose interval is above 0."""
        found = []
        for trace in self.traces:
            known = np.isfinite(trace.high_n) | (np.nan_to_num(trace.low_n) > 0)
            # A missing reading neither begins nor ends a contact.
            newest = np.maximum.accumulate(np.where(known, np.arange(known.size), 0))
            loaded = np.nan_to_num(trace.low_n)[newest] > 0
            edges = np.flatnonzero(np.diff(np.r_[False, loaded, False].astype(int)))
            for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                peak = begin + int(np.nanargmax(trace.low_n[begin:end]))
                # A weight is known for a part of its hold, which may be without the peak.
                loads = trace.load_n[begin:end][np.isfinite(trace.load_n[begin:end])]
                load_n = float(trace.load_n[peak])
                if np.isnan(load_n) and loads.size:
                    load_n = float(loads.max())
                found.append(
                    {
                        "recording": trace.name,
                        "begin_s": float(trace.time_s[begin]),
                        "end_s": float(trace.time_s[end - 1]),
                        "peak_n": finite_or_none(float(trace.force_n[peak])),
                        "low_n": finite_or_none(float(trace.low_n[peak])),
                        "high_n": finite_or_none(float(trace.high_n[peak])),
                        "load_n": finite_or_none(load_n),
                    }
                )
        return found

    def drawn(self) -> DrawnForce:
        """Return what the plot shows."""
        return DrawnForce(
            title=self.sensor.name, traces=self.traces, is_settled=self.sensor.is_settled
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document of the sensor."""
        held_out = self.fitted.held_out
        settled = self.sensor.is_settled
        return {
            "sensor": self.sensor.name,
            "law_from": self.fitted.kind,
            "taken": self.fitted.taken,
            "remarks": self.sensor.remarks,
            "held_out": None if held_out is None else asdict(held_out),
            "settled": [
                {key: one[key] for key in ("row", "force_n", "low_n", "high_n", "load_n")}
                for one in self.rows()
            ]
            if settled
            else None,
            "contacts": None if settled else self.contacts(),
        }


def print_report(found: Sequence[ForceReport], *, written: Sequence[Path]) -> None:
    """Print what was taken as what, the held-out errors, and the newtons."""
    console = make_console()
    for one in found:
        console.print(one.sensor.name, style="bold", markup=False, soft_wrap=True)
        for text in one.fitted.taken:
            console.print(f"  {text}", markup=False, soft_wrap=True)
        if one.fitted.held_out is not None:
            _print_held_out(one.fitted.held_out, console=console)
        elif one.fitted.kind != "calibration":
            console.print("  too few loads to hold one out: the error is not known")
        _print_forces(one, console=console)
        if one.fitted.kind != "calibration":
            console.print(
                "The law is fitted to these loads: beside them, its newtons are not held out."
            )
    for path in written:
        console.print(f"Written: {path}", markup=False, soft_wrap=True)


def _print_held_out(held_out: HeldOut, *, console: Any) -> None:
    console.print(
        f"Held out: {held_out.what}, {held_out.readings} readings; 90 % intervals", markup=False
    )
    rows = [
        (
            "palpate",
            _percent(held_out.median_abs_log_error),
            f"{100 * held_out.coverage:.0f} %",
        )
    ]
    power, coverage = held_out.power_median_abs_log_error, held_out.power_coverage
    if power is not None and coverage is not None:
        rows.append(("power law", _percent(power), f"{100 * coverage:.0f} %"))
    print_table(["law", ">median error", ">loads in the interval"], rows, console=console)


def _percent(log_error: float) -> str:
    return f"{100 * math.expm1(log_error):.0f} %"


def _print_forces(one: ForceReport, *, console: Any) -> None:
    if one.sensor.is_settled:
        rows = [
            (str(row["row"]), *_newtons(row, "force_n"), _number(row["load_n"]))
            for row in one.rows()
        ]
        head = [">row", ">force (N)", ">90 % interval", ">load (N)"]
    else:
        rows = [
            (
                f"{row['begin_s']:.4g} to {row['end_s']:.4g}",
                *_newtons(row, "peak_n"),
                _number(row["load_n"]),
            )
            for row in one.contacts()
        ]
        head = [">time (s)", ">peak (N)", ">90 % interval", ">load then (N)"]
    if not rows:
        console.print("No contact: no force is above 0 with certainty.")
        return
    print_table(head, rows[:_SHOWN], console=console)
    if len(rows) > _SHOWN:
        console.print(f"... {len(rows) - _SHOWN} more; --output FILE has all readings")


def _newtons(row: dict[str, Any], name: str) -> tuple[str, str]:
    return _number(row[name]), f"{_number(row['low_n'])} to {_number(row['high_n'])}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
