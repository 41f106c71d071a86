"""Table 4 and Figure 11c of the paper: force against relative change, and why slopes differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.line_law import LineForceLaw
from palpate_studies.equal_width import SEED, r_squared
from palpate_studies.misfit import Entry, missed, sentence
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.table4_causes import Pairs, cause_rows, force_window, transfer_rows
from palpate_studies.twin_session import LEVELS, Session, drawn, grasps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, Table 4: R^2, slope (N/%), intercept (N).
PUBLISHED = {
    "dragonskin-30": (0.917, -0.163, 1.81),
    "dragonskin-20": (0.986, -0.129, 1.42),
    "dragonskin-10": (0.983, -0.111, 2.45),
    "ecoflex-10": (0.985, -0.0953, 0.987),
}
#: A round face of the load cell, which the paper did not have: it changes the area of contact.
ROUND = "ball-44lbs"
CLOSURES_MM, REPEATS, SENSORS = (1.0, 1.75, 2.5, 3.25, 4.0), 10, 3


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Fit force to relative change for each simulated sheet, and find why the slopes differ.

    Example: palpate study table4 --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Make the grasps, fit the lines, and take their causes apart."""
    found = {
        level: [sensor_pairs(sensor, level=level, repeats=repeats) for sensor in range(sensors)]
        for level in LEVELS
    }
    causes = {level: cause_rows(found[level], sheets=tuple(PUBLISHED)) for level in LEVELS}
    transfers = {
        level: transfer_rows(found[level], sheets=tuple(PUBLISHED), round_face=ROUND)
        for level in LEVELS
    }
    lines = {level: {name: _lines(found[level], name) for name in PUBLISHED} for level in LEVELS}
    misfit = {level: missed(_entries(lines[level])) for level in LEVELS}
    return StudyReport(
        name="table4",
        title="Table 4: force against settled relative change, per silicone sheet",
        provenance=[
            *_provenance(sensors, repeats, found),
            *(sentence(misfit[level], of=f"Table 4 by the level {level}") for level in LEVELS),
        ],
        tables=[line_table(level, lines[level]) for level in LEVELS]
        + [
            Table(
                title="Why the slopes differ: largest slope over smallest among the four sheets",
                columns=("lines fitted to", *LEVELS),
                rows=[
                    [name, *(f"{causes[level][name]:.2f}" for level in LEVELS)]
                    for name in causes["lab"]
                ],
            ),
            Table(
                title="Force of a material that the law was not fitted to: median |error|, percent",
                columns=("law", "fitted to", "tested on", *LEVELS),
                rows=[
                    [*key, *(f"{transfers[level][key]:.1f}" for level in LEVELS)]
                    for key in transfers["lab"]
                ],
            ),
        ],
        payload={
            "study": "table4",
            "origin": "twin",
            "published": {name: list(values) for name, values in PUBLISHED.items()},
            "lines": {
                level: {name: values.tolist() for name, values in lines[level].items()}
                for level in LEVELS
            },
            "misfit": misfit,
            "intercepts": {level: _intercepts(lines[level]) for level in LEVELS},
            "slope_ratio": causes,
            "transfer_error_percent": {
                level: {" / ".join(key): value for key, value in transfers[level].items()}
                for level in LEVELS
            },
        },
        figures={"figure11c": lambda: draw(found)},
    )


def sensor_pairs(sensor: int, *, level: str, repeats: int) -> dict[str, Pairs]:
    """Return the pairs of each sheet, and of a round face, on one sensor."""
    pairs = {}
    for index, name in enumerate((*PUBLISHED, ROUND)):
        obj = drawn(name, seed=SEED)
        widths = [obj.size_mm - closure_mm for closure_mm in CLOSURES_MM]
        session = Session(sensor, level=level, trial=index)
        made = [
            reading
            for at_width in grasps(session, obj, widths_mm=widths, repeats=repeats)
            for reading in at_width
        ]
        pairs[name] = Pairs(
            force_n=np.array([reading.force_n for reading in made]),
            mean_percent=np.array([reading.mean_percent for reading in made]),
            pixel_percent=np.array([reading.change_percent.ravel() for reading in made]),
            excess=np.array([reading.excess for reading in made]),
        )
    return pairs


def _lines(sensors: list[dict[str, Pairs]], name: str) -> FloatArray:
    """Return R^2, slope, intercept and exponent of each sensor, shape (sensors, 4)."""
    rows = []
    for pairs in sensors:
        one = pairs[name]
        line = LineForceLaw.fit(one.mean_percent, force_n=one.force_n)
        power = PowerForceLaw.fit(one.excess, force_n=one.force_n)
        fit = r_squared(one.mean_percent, one.force_n)
        rows.append([fit, *line.coefficients, power.coefficients[1]])
    return np.array(rows)


def _entries(lines: dict[str, FloatArray]) -> list[Entry]:
    """Return R^2, slope and intercept of each sheet with the range over sensors; none was fitted.

    The range of forces was, and a sheet's slope and intercept with it in part.
    """
    return [
        Entry(published=value, low=float(column.min()), high=float(column.max()))
        for name, published in PUBLISHED.items()
        for value, column in zip(published, lines[name].T, strict=False)
    ]


def _intercepts(lines: dict[str, FloatArray]) -> dict[str, int]:
    """Count the fits, and those whose intercept has the other sign than the printed one."""
    values = np.concatenate([found[:, 2] for found in lines.values()])
    signs = np.repeat([np.sign(PUBLISHED[name][2]) for name in lines], len(values) // len(lines))
    return {"fits": len(values), "other_sign": int(np.sum(np.sign(values) != signs))}


def line_table(level: str, lines: dict[str, FloatArray]) -> Table:
    """Return the fits of each sheet, shape (sensors, 4), next to the published ones."""
    rows = []
    for name, published in PUBLISHED.items():
        values = lines[name]
        cells = [name]
        for column in range(3):
            low, high = values[:, column].min(), values[:, column].max()
            ours = f"{np.median(values[:, column]):.3g} ({low:.3g} to {high:.3g})"
            cells += [f"{published[column]:g}", ours]
        rows.append(cells)
    columns = ["sheet"]
    for label in ("R^2", "slope, N/%", "intercept, N"):
        columns += [f"{label}, published", f"{label}, twin"]
    return Table(
        title=f"Level {level}: median sensor (lowest to highest)", columns=tuple(columns), rows=rows
    )


def _provenance(sensors: int, repeats: int, found: dict[str, list[dict[str, Pairs]]]) -> list[str]:
    low, high = force_window(found["lab"][0], sheets=tuple(PUBLISHED))
    slopes = [abs(slope) for _, slope, _ in PUBLISHED.values()]
    max_slope, min_slope = max(slopes), min(slopes)
    return [
        f"Simulated: closures of {CLOSURES_MM[0]:g} to {CLOSURES_MM[-1]:g} mm, {repeats} grasps at "
        f"each, {sensors} sensors per level; force from the simulated load cell, change settled.",
        "Published: the paper's Table 4, one sensor. The force range of Tables 2 and 4 together "
        "(about 5 to 14 N) was an input to the twin's stiffnesses; slopes are predictions.",
        "A slope of -0.163 N/% means that resistance falls by 6.1 % per newton, -0.0953 N/% by "
        "10.5 %: by its numbers the stiffer sheet changes less per newton, against the paper's "
        "words under Table 4.",
        f"Slopes differ in the paper by a factor of {max_slope / min_slope:.2f}. Each sheet was "
        "gripped over other forces, and the change bends (it saturates at -100 %): where slopes "
        "agree at one force, it is that bend and not the material. Local slopes are at the middle "
        f"of the forces that all sheets reach ({low:.1f} to {high:.1f} N on the first sensor).",
    ]


def draw(found: dict[str, list[dict[str, Pairs]]]) -> Figure:
    """Draw force against change with lines (left), and against summed excess (right)."""
    from palpate.plots.style import AMBER, BLUE, GREEN, ORANGE, PURPLE, log_axis, new_figure

    looks = zip((*PUBLISHED, ROUND), (BLUE, ORANGE, GREEN, PURPLE, AMBER), strict=True)
    colours = dict(looks)
    with new_figure(rows=2, columns=2, width_in=9.0, height_in=6.8) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            for name, colour in colours.items():
                one = found[level][0][name]
                row[0].plot(one.mean_percent, one.force_n, ".", color=colour, alpha=0.5)
                line = np.polyfit(one.mean_percent, one.force_n, 1)
                ends = np.array([one.mean_percent.min(), one.mean_percent.max()])
                row[0].plot(ends, np.polyval(line, ends), color=colour, lw=1)
                row[1].plot(one.excess, one.force_n, ".", color=colour, alpha=0.6, label=name)
            row[0].set(
                xlabel="mean relative change (%)",
                ylabel="force (N)",
                title=f"Figure 11c, simulated, level {level}, one sensor",
            )
            row[1].set(
                xlabel="summed excess conductance, G/G₀ \N{MINUS SIGN} 1", ylabel="force (N)"
            )
            row[1].set_title("the same grasps")
            log_axis(row[1].xaxis)
            log_axis(row[1].yaxis)
        axes[0, 1].legend()
    return figure
