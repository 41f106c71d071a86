"""The tables of the real-holds study, as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate_studies.report import Table

Entry = Mapping[str, Any]


#: Key in the summary -> title of its table. Each is laid out as the paper's Table 1.
FIGURES = {
    "median_abs_error_percent": "median |error|, % of the settled value",
    "mean_abs_error_percent": "mean |error|, % of the settled value",
    "p90_abs_error_percent": "90th percentile of |error|, % of the settled value",
    "median_error_of_remaining_percent": "median |error|, % of the change still to come",
    "coverage": "share of holds inside their 90 % interval",
    "median_half_width_percent": "median half-width of the interval, % of the settled value",
}


def tables_of(
    files: Sequence[Entry],
    *,
    published: Mapping[str, Sequence[float]],
    cutoffs_s: Sequence[float],
    main_cutoff_s: float,
) -> list[Table]:
    """Return the tables of every file, and the published rows last."""
    headings = ("method", *(f"{cutoff_s:g} s" for cutoff_s in cutoffs_s))
    tables = []
    for file in files:
        tables += [_by_cutoff(file, name, headings) for name in FIGURES]
        tables += [_intervals(file, main_cutoff_s), _specimens(file), _worst(file), _limits(file)]
    tables.append(
        Table(
            title="Published (Table 1 of the paper, its own sensor): mean |error|, % of the "
            "settled relative change",
            columns=headings,
            rows=[[name, *map(_text, row)] for name, row in published.items()],
        )
    )
    return tables


def _by_cutoff(file: Entry, name: str, headings: tuple[str, ...]) -> Table:
    rows: dict[str, list[str]] = {}
    for entry in file["summary"]:
        rows.setdefault(entry["method"], [entry["method"]]).append(_text(entry[name]))
    return Table(
        title=f"{file['file']}: {FIGURES[name]}",
        columns=headings,
        rows=[row for row in rows.values() if set(row[1:]) != {"-"}],
    )


def _intervals(file: Entry, main_cutoff_s: float) -> Table:
    unit = file["left_out_unit"]
    return Table(
        title=f"{file['file']} at {main_cutoff_s:g} s: how sure the figures are (90 % bootstrap "
        f"over {unit}s; calibrated means on other {unit}s only)",
        columns=("method", "median |error| %", "coverage"),
        rows=[
            [
                entry["method"],
                _text(entry["median_abs_error_percent"])
                + _interval(entry["median_abs_error_percent_interval"]),
                _text(entry["coverage"]) + _interval(entry["coverage_interval"]),
            ]
            for entry in file["summary"]
            if entry["cutoff_s"] == main_cutoff_s
        ],
    )


def _specimens(file: Entry) -> Table:
    rows: dict[str, list[str]] = {}
    for entry in file["per_specimen"]:
        row = rows.setdefault(entry["specimen"], [entry["specimen"], str(entry["holds"])])
        row.append(_text(entry["median_abs_error_percent"]))
        if entry["coverage"] is not None:
            row[-1] += f" ({entry['coverage']:.2f})"
    methods = dict.fromkeys(entry["method"] for entry in file["per_specimen"])
    return Table(
        title=f"{file['file']}: each specimen at 2.5 s, median |error| % (coverage)",
        columns=("specimen", "holds", *methods),
        rows=list(rows.values()),
    )


def _worst(file: Entry) -> Table:
    return Table(
        title=f"{file['file']}: the {len(file['worst'])} holds that relaxation misses by most at "
        "2.5 s; rise and to come in % of the whole change",
        columns=("hold", "error %", "of rest %", "inside", "status", "rise", "to come"),
        rows=[
            [
                entry["hold_id"] + (f" {entry['channel']}" if entry["channel"] else ""),
                _text(entry["error_percent"]),
                _text(entry["error_of_remaining_percent"]),
                "yes" if entry["covered"] else "no",
                entry["status"],
                _text(entry["rise_percent"]),
                _text(entry["to_come_percent"]),
            ]
            for entry in file["worst"]
        ],
    )


def _limits(file: Entry) -> Table:
    found = file["limits"]
    return Table(
        title=f"{file['file']}: what the errors of relaxation at 2.5 s go with",
        columns=("what", "figure"),
        rows=[
            [
                "variance of the signed error that lies between specimens (the rest: hold to hold)",
                f"{_text(found['between_specimens_percent'])} %",
            ],
            [
                "rank correlation of |error| with a rise inside the window (bounce, new contact)",
                _text(found["rank_correlation_with_rise_percent"]),
            ],
            [
                "rank correlation of |error| with the share of the change still to come",
                _text(found["rank_correlation_with_to_come_percent"]),
            ],
        ],
    )


def _text(figure: float | None) -> str:
    return "-" if figure is None else f"{figure:.3g}"


def _interval(ends: Sequence[float | None]) -> str:
    return "" if None in ends else f" [{_text(ends[0])}, {_text(ends[1])}]"
