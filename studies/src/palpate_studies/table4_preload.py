"""Table 4 of the paper with rest values taken under a preload: a source of its intercepts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.equal_width import SEED, r_squared
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.table4 import CLOSURES_MM, PUBLISHED
from palpate_studies.twin_session import Session, drawn, grasps

#: Closures at which the change under a small force is found, before those of Table 4.
SMALL_MM = (0.1, 0.2, 0.35, 0.5, 0.7)
#: Forces with which the pads press while rest values are taken, newtons.
PRELOADS_N = (0.0, 1.0, 2.0, 2.5, 3.0)
SENSORS, REPEATS = 3, 2


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Fit Table 4's lines to changes relative to rest values taken under a preload.

    Example: palpate study table4-preload --out reports
    """
    lines, summary = list[dict[str, Any]](), list[dict[str, Any]]()
    for level in LEVELS:
        found = {
            name: [
                closing(name, sensor=sensor, index=index, level=level, repeats=repeats)
                for sensor in range(sensors)
            ]
            for index, name in enumerate(PUBLISHED)
        }
        for preload_n in PRELOADS_N:
            key = {"level": level, "preload_n": preload_n}
            each = [
                {**key, "sheet": name, **scores(name, made, preload_n)}
                for name, made in found.items()
            ]
            lines += each
            summary.append({**key, **counts(each)})
    published = {"level": "published", "preload_n": None}
    shown = [
        {**published, "sheet": name, "slope": slope, "intercept_n": force_n}
        for name, (_, slope, force_n) in PUBLISHED.items()
    ]
    lead = {"level": "{level}", "preload, N": "{preload_n:g}"}
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
        tables=[
            Table.wide(
                "Slope (N/%) and intercept (N): median sensor",
                [*shown, *lines],
                lead,
                over="sheet",
                form="{slope:.3f}, {intercept_n:.2f}",
            ),
            Table.of(
                "Published entries within the range over sensors",
                summary,
                {
                    **lead,
                    "slopes": "{slopes_within} of {sheets}",
                    "intercepts": "{intercepts_within} of {sheets}",
                    "intercepts of the other sign": "{other_sign} of {fits}",
                },
            ),
        ],
        payload={"study": "table4-preload", "origin": "twin", "lines": lines, "summary": summary},
    )


command = as_command(report)


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


def counts(rows: Sequence[dict[str, Any]]) -> dict[str, int]:
    """Count the sheets whose published entries lie within the range over sensors."""
    keys = ("slope_within", "intercept_within", "fits", "other_sign")
    slopes, intercepts, fits, other = (sum(row[key] for row in rows) for key in keys)
    return {
        "sheets": len(rows),
        "slopes_within": slopes,
        "intercepts_within": intercepts,
        "fits": fits,
        "other_sign": other,
    }
