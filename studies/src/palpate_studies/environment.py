"""Figures 1b and 3 of the paper: suction, and three climates, before and after correction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.signal.relative import mean_change, relative_change_percent
from palpate.twin.velostat import Environment
from palpate_studies.conditions import Conditions, ConditionsCorrection
from palpate_studies.equal_width import SEED
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import LEVELS, Reading, Session, drawn, grasps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, section 2.1: indoors and twice outdoors; the humidities are ours, it prints none.
CLIMATES = {
    "indoors, 21.9 C": Conditions(temperature_c=21.9, humidity_percent=45.0),
    "outdoors, 14.8 C": Conditions(temperature_c=14.8, humidity_percent=70.0),
    "outdoors, 26.8 C": Conditions(temperature_c=26.8, humidity_percent=55.0),
}
#: Where the reference load is read; the third climate is never calibrated in.
CALIBRATED_IN = ("indoors, 21.9 C", "outdoors, 14.8 C")
REFERENCE, OBJECT = "springs-8", "dragonskin-10"
CLOSURE_MM, REPEATS, SENSORS = 3.0, 5, 8
SUCTION_KPA = (0.0, 5.0, 10.0, 20.0, 30.0, 50.0)
#: Expected range of three normal draws, in standard deviations.
_RANGE_OF_THREE = 1.693
#: What is compared -> unit.
READ = {
    "absolute resistance": "% of the mean",
    "relative change": "points",
    "summed excess": "% of the mean",
    "summed excess, scatter of grasps alone": "% of the mean",
    "summed excess, corrected": "% of the mean",
    "relative change, corrected": "points",
}


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Grasp in three climates on the twin, correct for them, and pull the sheet apart by suction.

    Example: palpate study environment --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Measure spreads over the three climates, sensor by sensor."""
    found = {
        level: [in_climates(sensor, level=level, repeats=repeats) for sensor in range(sensors)]
        for level in LEVELS
    }
    spreads = {
        level: {name: np.array([_spread(one[name], name) for one in found[level]]) for name in READ}
        for level in LEVELS
    }
    lifted = {level: suction(sensors, level=level) for level in LEVELS}
    rows = [
        [name, unit, *(_cell(spreads[level][name]) for level in LEVELS)]
        for name, unit in READ.items()
    ]
    return StudyReport(
        name="environment",
        title="Figures 1b and 3: three climates and suction",
        provenance=[
            f"Simulated: {repeats} grasps of {OBJECT} in each of three climates on each of "
            f"{sensors} sensors per level. The paper prints temperatures (21.9, 14.8, 26.8 C), no "
            "humidities and no results in numbers; the twin's dependence on climate is a plausible "
            "range, not a measurement.",
            f"Correction: the gain learned from {repeats} grasps of {REFERENCE} at "
            f"{' and '.join(CALIBRATED_IN)}; the third climate was never calibrated in, and its "
            "humidity lies off the line between the other two.",
            "Relative change and excess take the rest values of the same climate.",
        ],
        tables=[
            Table(
                title="Spread over three climates (largest less smallest): median sensor (worst)",
                columns=("reading", "unit", *LEVELS),
                rows=rows,
            ),
            Table(
                title="Suction on a bare sheet: mean relative change, percent (lowest to highest)",
                columns=("suction, kPa", *LEVELS),
                rows=[
                    [f"{kpa:g}", *(_range(lifted[level][:, index]) for level in LEVELS)]
                    for index, kpa in enumerate(SUCTION_KPA)
                ],
            ),
        ],
        payload={
            "study": "environment",
            "origin": "twin",
            "climates": {
                name: [at.temperature_c, at.humidity_percent] for name, at in CLIMATES.items()
            },
            "spread": {
                level: {name: values.tolist() for name, values in spreads[level].items()}
                for level in LEVELS
            },
            "suction_kpa": list(SUCTION_KPA),
            "suction_change_percent": {level: lifted[level].tolist() for level in LEVELS},
        },
        figures={"figure3": lambda: draw(found), "figure1b": lambda: draw_suction(lifted)},
    )


def in_climates(sensor: int, *, level: str, repeats: int) -> dict[str, FloatArray]:
    """Return each reading of the object, shape (climates, repeats)."""
    made = {name: _grasps(sensor, OBJECT, at, level, repeats) for name, at in CLIMATES.items()}
    reference = [_grasps(sensor, REFERENCE, CLIMATES[n], level, repeats) for n in CALIBRATED_IN]
    learned = ConditionsCorrection.fit(
        [float(np.exp(np.mean([np.log(r.excess) for r in one]))) for one in reference],
        conditions=[CLIMATES[name] for name in CALIBRATED_IN],
    )
    rows: dict[str, list[list[float]]] = {name: [] for name in READ}
    for name, at in CLIMATES.items():
        corrected = [learned.corrected_percent(r.change_percent, at=at) for r in made[name]]
        excess = [r.excess for r in made[name]]
        rows["absolute resistance"].append([float(r.ohm.mean()) for r in made[name]])
        rows["relative change"].append([r.mean_percent for r in made[name]])
        rows["summed excess"].append(excess)
        rows["summed excess, scatter of grasps alone"].append(excess)
        rows["summed excess, corrected"].append(learned.corrected(excess, at=at).tolist())
        rows["relative change, corrected"].append([float(mean_change(c)) for c in corrected])
    return {name: np.array(values) for name, values in rows.items()}


def _grasps(sensor: int, name: str, at: Conditions, level: str, repeats: int) -> list[Reading]:
    obj = drawn(name, seed=SEED)
    surroundings = Environment(
        temperature_c=at.temperature_c, humidity_percent=at.humidity_percent, cycles=2000
    )
    session = Session(
        sensor, level=level, trial=int(10 * at.temperature_c), environment=surroundings
    )
    return grasps(session, obj, widths_mm=[obj.size_mm - CLOSURE_MM], repeats=repeats)[0]


def suction(sensors: int, *, level: str) -> FloatArray:
    """Return the mean relative change of bare sheets under suction, shape (sensors, steps)."""
    changes = np.empty((sensors, len(SUCTION_KPA)))
    for sensor in range(sensors):
        session = Session(sensor, level=level)
        rest_ohm = session.mean_ohm()
        for index, kpa in enumerate(SUCTION_KPA):
            session.world.surround(Environment(suction_kpa=kpa))
            change = relative_change_percent(session.mean_ohm(), rest_ohm=rest_ohm)
            changes[sensor, index] = mean_change(change)
    return changes


def _spread(values: FloatArray, name: str) -> float:
    """Return largest less smallest of the climates' means, in percent of their mean or points."""
    means = values.mean(axis=1)
    if "scatter" in name:
        # The expected range of three means of such scatter, were all climates alike.
        sd = np.sqrt(np.mean(values.var(axis=1, ddof=1)) / values.shape[1])
        return float(_RANGE_OF_THREE * sd / abs(means.mean()) * 100.0)
    whole = 1.0 if "change" in name else abs(means.mean()) / 100.0
    return float(np.ptp(means) / whole)


def _cell(values: FloatArray) -> str:
    return f"{np.median(values):.2g} ({values.max():.2g})"


def _range(values: FloatArray) -> str:
    return f"{np.median(values):+.1f} ({values.min():+.1f} to {values.max():+.1f})"


def draw(found: dict[str, list[dict[str, FloatArray]]]) -> Figure:
    """Draw each climate's readings on every sensor: absolute, relative, corrected."""
    from palpate.plots.style import BLUE, GREY, ORANGE, new_figure

    shown = ("absolute resistance", "relative change", "relative change, corrected")
    with new_figure(rows=2, columns=3, width_in=10.5, height_in=5.6) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            for axis, name in zip(row, shown, strict=True):
                _draw_panel(axis, [one[name] for one in found[level]], (GREY, BLUE, ORANGE))
                unit = "ohm" if name == "absolute resistance" else "%"
                axis.xaxis.get_major_locator().set_params(integer=True)
                axis.set(xlabel="sensor", ylabel=f"{name} ({unit})", title=f"simulated, {level}")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _draw_panel(axis: Any, sensors: list[FloatArray], colours: tuple[str, ...]) -> None:
    for climate, (name, colour) in enumerate(zip(CLIMATES, colours, strict=True)):
        x = np.concatenate(
            [
                np.full(one.shape[1], place + 0.2 * (climate - 1))
                for place, one in enumerate(sensors)
            ]
        )
        axis.plot(
            x,
            np.concatenate([one[climate] for one in sensors]),
            ".",
            color=colour,
            label=name.replace(" C", " °C"),
        )


def draw_suction(lifted: dict[str, FloatArray]) -> Figure:
    """Draw the rise of resistance under suction."""
    from palpate.plots.style import BLUE, ORANGE, new_figure

    with new_figure(width_in=5.5, height_in=3.6) as (figure, axes):
        axis = axes[0, 0]
        looks = ((BLUE, "o-"), (ORANGE, "s--"))
        for (level, changes), (colour, look) in zip(lifted.items(), looks, strict=True):
            axis.plot(SUCTION_KPA, changes.T, color=colour, lw=0.6, alpha=0.4)
            axis.plot(SUCTION_KPA, np.median(changes, axis=0), look, color=colour, label=level)
        axis.set(
            xlabel="suction (kPa)",
            ylabel="mean relative change (%)",
            title="Figure 1b, simulated: negative pressure raises resistance",
        )
        axis.legend(title="median; thin: each sensor")
    return figure
