"""Table 4 and Figure 11c of the paper: force over relative change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.force.line_law import LineForceLaw
from palpate.force.power_law import PowerForceLaw
from palpate_studies.equal_width import r_squared
from palpate_studies.misfit import Entry, count_missed, format_missed
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import Reading, Session, draw_named, grasps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, Table 4: R^2, slope (N/%), intercept (N).
PUBLISHED = {
    "dragonskin-30": (0.917, -0.163, 1.81),
    "dragonskin-20": (0.986, -0.129, 1.42),
    "dragonskin-10": (0.983, -0.111, 2.45),
    "ecoflex-10": (0.985, -0.0953, 0.987),
}
CLOSURES_MM, REPEATS, SENSORS = (1.0, 1.75, 2.5, 3.25, 4.0), 10, 3


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Fit force to relative change for each simulated sheet, and compare with the paper's lines.

    Example: palpate study table4 --out reports
    """
    found = {
        level: {
            name: [
                _measure_readings(name, index, sensor=sensor, level=level, repeats=repeats)
                for sensor in range(sensors)
            ]
            for index, name in enumerate(PUBLISHED)
        }
        for level in LEVELS
    }
    lines = {
        level: {
            name: np.array([_fit_line(readings) for readings in each])
            for name, each in sheets.items()
        }
        for level, sheets in found.items()
    }
    misfit = {level: count_missed(_list_entries(lines[level])) for level in LEVELS}
    return StudyReport(
        name="table4",
        title="Table 4: force over settled relative change, per silicone sheet",
        provenance=[
            f"Simulated: closures of {CLOSURES_MM[0]:g} to {CLOSURES_MM[-1]:g} mm, {repeats} "
            f"grasps at each, {sensors} sensors per level; force from the simulated load cell, "
            "change settled.",
            "Published: the paper's Table 4, one sensor. The force range of Tables 2 and 4 "
            "together (about 5 to 14 N) was an input to the twin's stiffnesses; slopes are "
            "predictions.",
            "A slope of -0.163 N/% corresponds to a fall of the resistance by 6.1 % per newton, "
            "-0.0953 N/% to 10.5 %: in the published numbers the stiffer sheet changes less per "
            "newton, contrary to the text below Table 4.",
            *(format_missed(misfit[level], of=f"Table 4 (level {level})") for level in LEVELS),
        ],
        tables=[
            Table.of(
                "Median sensor (lowest to highest), and the published entry",
                [
                    {"level": level, "sheet": name}
                    | {
                        label: f"{np.median(v):.3g} ({v.min():.3g} to {v.max():.3g}), {printed:g}"
                        for label, printed, v in zip(
                            ("R^2", "slope, N/%", "intercept, N"),
                            PUBLISHED[name],
                            each.T[:3],
                            strict=True,
                        )
                    }
                    for level in LEVELS
                    for name, each in lines[level].items()
                ],
            )
        ],
        payload={
            "origin": "twin",
            "published": {name: list(values) for name, values in PUBLISHED.items()},
            "lines": {
                level: {name: values.tolist() for name, values in lines[level].items()}
                for level in LEVELS
            },
            "misfit": misfit,
            "intercepts": {level: _count_intercepts(lines[level]) for level in LEVELS},
        },
        figures={"figure11c": lambda: draw({at: found[at] for at in LEVELS})},
    )


command = as_command(report)


def _measure_readings(
    name: str, index: int, *, sensor: int, level: str, repeats: int
) -> list[Reading]:
    """Grasp one sheet on one sensor at each closure; return all readings."""
    obj, session = draw_named(name), Session(sensor, level=level, trial=index)
    widths = [obj.size_mm - closure_mm for closure_mm in CLOSURES_MM]
    readings = grasps(session, obj, widths_mm=widths, repeats=repeats)
    return [reading for at_width in readings for reading in at_width]


def _pairs(readings: list[Reading]) -> tuple[FloatArray, FloatArray]:
    """Return mean change (percent) and force (N) of each grasp."""
    return np.array([r.mean_percent for r in readings]), np.array([r.force_n for r in readings])


def _fit_line(readings: list[Reading]) -> list[float]:
    """Fit R^2, slope and intercept of one sensor, and the exponent of the power law."""
    percent, force_n = _pairs(readings)
    line = LineForceLaw.fit(percent, force_n=force_n)
    power = PowerForceLaw.fit([reading.excess for reading in readings], force_n=force_n)
    return [r_squared(percent, force_n), *line.coefficients, power.coefficients[1]]


def _list_entries(lines: Mapping[str, FloatArray]) -> list[Entry]:
    """Return R^2, slope and intercept of each sheet with their ranges over sensors.

    No entry counts as fitted, although the range of forces was an input of the twin and partly
    determines slopes and intercepts.
    """
    return [
        Entry(published=value, low=float(column.min()), high=float(column.max()))
        for name, published in PUBLISHED.items()
        for value, column in zip(published, lines[name].T, strict=False)
    ]


def _count_intercepts(lines: Mapping[str, FloatArray]) -> dict[str, int]:
    """Count the fits, and the fits with the opposite sign of the published intercept."""
    signs = [np.sign(found[:, 2]) != np.sign(PUBLISHED[name][2]) for name, found in lines.items()]
    return {"fits": sum(map(len, signs)), "other_sign": int(np.sum(signs))}


def draw(found: Mapping[str, Mapping[str, list[list[Reading]]]]) -> Figure:
    """Draw force over change on the first sensor of each level, with each sheet's line."""
    from palpate.plots.style import BLUE, GREEN, ORANGE, PURPLE, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.6) as (figure, axes):
        for axis, (level, sheets) in zip(axes[0], found.items(), strict=True):
            for name, colour in zip(sheets, (BLUE, ORANGE, GREEN, PURPLE), strict=True):
                percent, force_n = _pairs(sheets[name][0])
                axis.plot(percent, force_n, ".", color=colour, alpha=0.5, label=name)
                ends = np.array([percent.min(), percent.max()])
                axis.plot(ends, np.polyval(np.polyfit(percent, force_n, 1), ends), color=colour)
            axis.set(
                xlabel="mean relative change (%)",
                ylabel="force (N)",
                title=f"Figure 11c, simulated, level {level}, one sensor",
            )
        axes[0, 1].legend()
    return figure
