"""Figures 1b and 3 of the paper: suction and three climates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.sample import relative_change_percent
from palpate.signal.relative import mean_change
from palpate.twin.velostat import Environment
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import Session, draw_named, grasps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Temperatures, C, from section 2.1 of the paper; humidities, %, are assumed, as none is printed.
CLIMATES = {
    "indoors, 21.9 C": (21.9, 45.0),
    "outdoors, 14.8 C": (14.8, 70.0),
    "outdoors, 26.8 C": (26.8, 55.0),
}
OBJECT = "dragonskin-10"
CLOSURE_MM, REPEATS, SENSORS = 3.0, 5, 8
SUCTION_KPA = (0.0, 5.0, 10.0, 20.0, 30.0, 50.0)
#: Compared reading -> unit of its spread.
READING_UNITS = {"absolute resistance": "% of the mean", "relative change": "points"}


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Grasp on the twin in three climates, and apply suction to the sheet.

    Example: palpate study environment --out reports
    """
    found = {
        level: [read_climates(sensor, level=level, repeats=repeats) for sensor in range(sensors)]
        for level in LEVELS
    }
    spreads = {
        level: {
            name: np.array([_climate_spread(one[name], name) for one in found[level]])
            for name in READING_UNITS
        }
        for level in LEVELS
    }
    suction_percent = {level: measure_suction(sensors, level=level) for level in LEVELS}
    return StudyReport(
        name="environment",
        title="Figures 1b and 3: three climates and suction",
        provenance=[
            f"Simulated: {repeats} grasps of {OBJECT} in each of three climates on each of "
            f"{sensors} sensors per level. The paper prints temperatures (21.9, 14.8, 26.8 C), no "
            "humidities and no results in numbers; the twin's dependence on climate is a plausible "
            "range, not a measurement.",
            "The relative change uses the rest values of the same climate.",
        ],
        tables=[
            Table.of(
                "Spread over three climates (largest minus smallest), median sensor",
                [
                    {"reading": name, "unit": unit}
                    | {level: float(np.median(spreads[level][name])) for level in LEVELS}
                    for name, unit in READING_UNITS.items()
                ],
            ),
            Table.of(
                "Suction on a bare sheet: mean relative change, percent, median sensor",
                [
                    {"suction_kpa": kpa}
                    | {level: float(np.median(suction_percent[level][:, k])) for level in LEVELS}
                    for k, kpa in enumerate(SUCTION_KPA)
                ],
            ),
        ],
        payload={
            "origin": "twin",
            "climates": {name: list(at) for name, at in CLIMATES.items()},
            "spread": {
                level: {name: values.tolist() for name, values in spreads[level].items()}
                for level in LEVELS
            },
            "suction_kpa": list(SUCTION_KPA),
            "suction_change_percent": {level: suction_percent[level].tolist() for level in LEVELS},
        },
        figures={"figure3": lambda: draw(found), "figure1b": lambda: draw_suction(suction_percent)},
    )


command = as_command(report)


def read_climates(sensor: int, *, level: str, repeats: int) -> dict[str, FloatArray]:
    """Grasp in each climate; return each reading, shape (climates, repeats)."""
    rows: dict[str, list[list[float]]] = {name: [] for name in READING_UNITS}
    obj = draw_named(OBJECT)
    for celsius, humidity in CLIMATES.values():
        session = Session(
            sensor,
            level=level,
            trial=int(10 * celsius),
            environment=Environment(temperature_c=celsius, humidity_percent=humidity, cycles=2000),
        )
        readings = grasps(session, obj, widths_mm=[obj.size_mm - CLOSURE_MM], repeats=repeats)[0]
        rows["absolute resistance"].append([float(r.ohm.mean()) for r in readings])
        rows["relative change"].append([r.mean_percent for r in readings])
    return {name: np.array(values) for name, values in rows.items()}


def measure_suction(sensors: int, *, level: str) -> FloatArray:
    """Return the mean relative change of bare sheets under suction, shape (sensors, steps)."""
    changes = np.empty((sensors, len(SUCTION_KPA)))
    for sensor in range(sensors):
        session = Session(sensor, level=level)
        rest_ohm = session.mean_ohm()
        for index, kpa in enumerate(SUCTION_KPA):
            session.world.set_environment(Environment(suction_kpa=kpa))
            change = relative_change_percent(session.mean_ohm(), rest_ohm=rest_ohm)
            changes[sensor, index] = mean_change(change)
    return changes


def _climate_spread(values: FloatArray, name: str) -> float:
    """Return the range of the climates' means, in percent of their mean or in points."""
    means = values.mean(axis=1)
    unit = 1.0 if READING_UNITS[name] == "points" else abs(means.mean()) / 100.0
    return float(np.ptp(means) / unit)


def draw(found: dict[str, list[dict[str, FloatArray]]]) -> Figure:
    """Draw each climate's readings on every sensor: absolute and relative."""
    from palpate.plots.style import BLUE, GREY, ORANGE, new_figure

    shown = dict(zip(READING_UNITS, ("ohm", "%"), strict=True))
    with new_figure(rows=2, columns=2, width_in=7.2, height_in=5.6) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            for axis, (name, unit) in zip(row, shown.items(), strict=True):
                for climate, (label, colour) in enumerate(
                    zip(CLIMATES, (GREY, BLUE, ORANGE), strict=True)
                ):
                    each = np.array([one[name][climate] for one in found[level]])
                    places = np.arange(len(each)) + 0.2 * (climate - 1)
                    axis.plot(
                        np.repeat(places, each.shape[1]),
                        each.ravel(),
                        ".",
                        color=colour,
                        label=label.replace(" C", " °C"),
                    )
                axis.xaxis.get_major_locator().set_params(integer=True)
                axis.set(xlabel="sensor", ylabel=f"{name} ({unit})", title=f"simulated, {level}")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def draw_suction(suction_percent: dict[str, FloatArray]) -> Figure:
    """Draw the rise of resistance under suction."""
    from palpate.plots.style import BLUE, ORANGE, new_figure

    with new_figure(width_in=5.5, height_in=3.6) as (figure, axes):
        axis = axes[0, 0]
        styles = ((BLUE, "o-"), (ORANGE, "s--"))
        for (level, changes), (colour, style) in zip(suction_percent.items(), styles, strict=True):
            axis.plot(SUCTION_KPA, changes.T, color=colour, lw=0.6, alpha=0.4)
            axis.plot(SUCTION_KPA, np.median(changes, axis=0), style, color=colour, label=level)
        axis.set(
            xlabel="suction (kPa)",
            ylabel="mean relative change (%)",
            title="Figure 1b, simulated: negative pressure raises resistance",
        )
        axis.legend(title="median; thin: each sensor")
    return figure
