"""Table 4 of the paper with rest values taken under a preload: a source of its intercepts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate_studies.equal_width import SEED, r_squared
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.table4 import CLOSURES_MM, PUBLISHED
from palpate_studies.twin_session import LEVELS, Session, drawn, grasps

#: Closures at which the change under a small force is found, before those of Table 4.
SMALL_MM = (0.1, 0.2, 0.35, 0.5, 0.7)
#: Forces with which the pads press while rest values are taken, newtons.
PRELOADS_N = (0.0, 1.0, 2.0, 2.5, 3.0)
SENSORS, REPEATS = 3, 2


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Fit Table 4's lines to changes relative to rest values taken under a preload.

    Example: palpate study table4-preload --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Make the grasps and fit the lines for each preload."""
    rows = list[dict[str, Any]]()
    for level in LEVELS:
        found = {
            name: [
                closing(name, sensor=sensor, index=index, level=level, repeats=repeats)
                for sensor in range(sensors)
            ]
            for index, name in enumerate(PUBLISHED)
        }
        rows += [
            {"level": level, "preload_n": preload_n, "sheet": name, **scores(name, each, preload_n)}
            for preload_n in PRELOADS_N
            for name, each in found.items()
        ]
    summary = [
        {"level": level, "preload_n": preload_n, **counts(rows, level, preload_n)}
        for level in LEVELS
        for preload_n in PRELOADS_N
    ]
    return StudyReport(
        name="table4-preload",
        title="Table 4 with rest values taken under a preload",
        provenance=[
            f"Simulated: closures of Table 4 ({CLOSURES_MM[0]:g} to {CLOSURES_MM[-1]:g} mm), "
            f"{repeats} grasps at each, {sensors} sensors per level; change relative to what each "
            "pixel mean reads under the preload, force of the load cell as it is.",
            "Published: Table 4, one sensor. The preload is an input, chosen here by looking at "
            "these sheets; the paper mentions none.",
        ],
        tables=[_lines_table(rows), _counts_table(summary)],
        payload={"study": "table4-preload", "origin": "twin", "lines": rows, "summary": summary},
    )


def closing(
    name: str, *, sensor: int, index: int, level: str, repeats: int
) -> tuple[FloatArray, FloatArray]:
    """Return force and mean change of one sheet, shape (closures, repeats), small ones first."""
    obj = drawn(name, seed=SEED)
    session = Session(sensor, level=level, trial=index)
    widths = [obj.size_mm - closure_mm for closure_mm in (*SMALL_MM, *CLOSURES_MM)]
    made = grasps(session, obj, widths_mm=widths, repeats=repeats)
    force_n = np.array([[reading.force_n for reading in at_width] for at_width in made])
    percent = np.array([[reading.mean_percent for reading in at_width] for at_width in made])
    return force_n, percent


def preloaded_line(
    force_n: FloatArray, percent: FloatArray, *, preload_n: float
) -> tuple[float, float, float]:
    """Return R^2, slope (N/%) and intercept (N) of the line through the larger closures.

    Examples
    --------
    A change that is a line through zero has the preload as its intercept:

    >>> force_n = np.linspace(0.5, 10.0, 20)[:, None]
    >>> line = preloaded_line(force_n, -5.0 * force_n, preload_n=2.0)
    >>> [round(value, 3) for value in line]
    [1.0, -0.18, 2.0]
    """
    order = np.argsort(force_n, axis=None)
    forces, changes = force_n.ravel()[order], percent.ravel()[order]
    at_rest = np.interp(preload_n, [0.0, *forces], [0.0, *changes])
    large_n, large = (np.ravel(values[-len(CLOSURES_MM) :]) for values in (force_n, percent))
    change = 100.0 * ((1.0 + large / 100.0) / (1.0 + at_rest / 100.0) - 1.0)
    slope, intercept_n = np.polyfit(change, large_n, 1)
    return r_squared(change, large_n), float(slope), float(intercept_n)


def scores(
    name: str, sensors: Sequence[tuple[FloatArray, FloatArray]], preload_n: float
) -> dict[str, Any]:
    """Return slope and intercept of the median sensor and their ranges, and what lies in them."""
    lines = np.array([preloaded_line(*one, preload_n=preload_n) for one in sensors])
    _, slope, intercept_n = PUBLISHED[name]
    low, high = lines.min(axis=0), lines.max(axis=0)
    return {
        "slope": float(np.median(lines[:, 1])),
        "slope_range": [float(low[1]), float(high[1])],
        "slope_within": bool(low[1] <= slope <= high[1]),
        "intercept_n": float(np.median(lines[:, 2])),
        "intercept_range_n": [float(low[2]), float(high[2])],
        "intercept_within": bool(low[2] <= intercept_n <= high[2]),
        "other_sign": int(np.sum(np.sign(lines[:, 2]) != np.sign(intercept_n))),
        "fits": len(lines),
    }


def counts(rows: Sequence[Mapping[str, Any]], level: str, preload_n: float) -> dict[str, int]:
    """Count the sheets whose published entries lie within the range over sensors."""
    mine = [row for row in rows if row["level"] == level and row["preload_n"] == preload_n]
    return {
        "sheets": len(mine),
        "slopes_within": sum(row["slope_within"] for row in mine),
        "intercepts_within": sum(row["intercept_within"] for row in mine),
        "fits": sum(row["fits"] for row in mine),
        "other_sign": sum(row["other_sign"] for row in mine),
    }


def _lines_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    return Table(
        title="Slope (N/%) and intercept (N): median sensor",
        columns=("level", "preload, N", *PUBLISHED),
        rows=[
            [
                "published",
                "",
                *(f"{slope:g}, {force_n:g}" for _, slope, force_n in PUBLISHED.values()),
            ],
            *(
                [
                    level,
                    f"{preload_n:g}",
                    *(
                        f"{row['slope']:.3f}, {row['intercept_n']:.2f}"
                        for row in rows
                        if row["level"] == level and row["preload_n"] == preload_n
                    ),
                ]
                for level in LEVELS
                for preload_n in PRELOADS_N
            ),
        ],
    )


def _counts_table(summary: Sequence[Mapping[str, Any]]) -> Table:
    return Table(
        title="Published entries within the range over sensors",
        columns=("level", "preload, N", "slopes", "intercepts", "intercepts of the other sign"),
        rows=[
            [
                row["level"],
                f"{row['preload_n']:g}",
                f"{row['slopes_within']} of {row['sheets']}",
                f"{row['intercepts_within']} of {row['sheets']}",
                f"{row['other_sign']} of {row['fits']}",
            ]
            for row in summary
        ],
    )
