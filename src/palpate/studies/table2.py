"""Table 2 and Figure 8b of the paper: four silicone sheets grasped at one width."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.settling.result import FloatArray
from palpate.signal.relative import mean_change, relative_change_percent
from palpate.studies.equal_width import (
    CALIBRATION_INPUT,
    CLOSURE_MM,
    SEED,
    SENSORS,
    Settled,
    settled_readings,
)
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table
from palpate.studies.twin_session import GAP_MM, HOLD_S, LEVELS, STILL_S, Session, drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, Table 2: mean and standard deviation over 10 grasps, percent; Shore hardness.
PUBLISHED = {
    "ecoflex-10": (-46.0, 1.8, "00-10"),
    "dragonskin-10": (-54.7, 1.2, "A-10"),
    "dragonskin-20": (-66.9, 0.52, "A-20"),
    "dragonskin-30": (-71.5, 0.74, "A-30"),
}
#: The sheets are 40 mm thick, in their holder.
WIDTH_MM, REPEATS = 40.0 - CLOSURE_MM, 10
READING = "mean change"
#: Sensor and grasps drawn in Figure 8b.
SHOWN_SENSOR, SHOWN_GRASPS = 0, 5


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Grasp four simulated silicone sheets at one width and compare with the paper's Table 2.

    Example: palpate study table2 --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Make the grasps and put the changes beside the published ones."""
    names = tuple(PUBLISHED)
    found = settled_readings(
        [drawn(name, seed=SEED) for name in names],
        width_mm=WIDTH_MM,
        repeats=repeats,
        sensors=sensors,
    )
    rows = [
        [name, PUBLISHED[name][2], "{:g} ± {:g}".format(*PUBLISHED[name][:2])]
        + [found[level].cell(READING, index) for level in LEVELS]
        for index, name in enumerate(names)
    ]
    ordered = {level: _in_order(found[level]) for level in LEVELS}
    return StudyReport(
        name="table2",
        title="Table 2: settled relative change of four silicone sheets at one width",
        provenance=[
            f"Simulated: {repeats} grasps of each sheet at {WIDTH_MM:g} mm on each of {sensors} "
            "sensors per level; median sensor's mean ± sd over grasps (range of means).",
            "Published: the paper's Table 2, one sensor, 10 grasps, width not printed.",
            CALIBRATION_INPUT,
            "Sensors on which the four means stand in the order of hardness: "
            + ", ".join(f"{ordered[level]} of {sensors} ({level})" for level in LEVELS)
            + ".",
        ],
        tables=[
            Table(
                title="Settled relative change, percent",
                columns=("sheet", "Shore", "published", *LEVELS),
                rows=rows,
            )
        ],
        payload={
            "study": "table2",
            "origin": "twin",
            "width_mm": WIDTH_MM,
            "published": {name: list(values[:2]) for name, values in PUBLISHED.items()},
            "levels": {level: found[level].as_json(READING) for level in LEVELS},
            "sensors_in_order": ordered,
        },
        figures={"figure8b": draw},
    )


def _in_order(found: Settled) -> int:
    """Return on how many sensors a stiffer sheet changed more, for all four."""
    return int(np.sum(np.all(np.diff(found.means(READING), axis=0) < 0, axis=0)))


def _curves(name: str, level: str) -> tuple[FloatArray, FloatArray]:
    """Return times and mean relative change of a few grasps, shape (grasps, times)."""
    session, obj = Session(SHOWN_SENSOR, level=level), drawn(name, seed=SEED)
    session.place(obj)
    curves = []
    for _ in range(SHOWN_GRASPS):
        session.close_to(obj.size_mm + GAP_MM)
        session.world.clock.sleep_s(STILL_S)
        rest_ohm = session.mean_ohm()
        session.close_to(WIDTH_MM)
        ohm = session.read(HOLD_S)
        curves.append(mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm)))
        session.gripper.release()
        session.world.clock.sleep_s(HOLD_S)
    shortest = min(map(len, curves))
    time_s = np.arange(1, shortest + 1) / session.world.frame_rate_hz
    return time_s, np.array([curve[:shortest] for curve in curves])


def draw() -> Figure:
    """Draw mean and spread of a few grasps of each sheet over time, both levels."""
    from palpate.plots.style import BLUE, GREEN, ORANGE, PURPLE, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        for axis, level in zip(axes[0], LEVELS, strict=True):
            for name, colour in zip(PUBLISHED, (PURPLE, GREEN, ORANGE, BLUE), strict=True):
                time_s, curves = _curves(name, level)
                mean, sd = curves.mean(axis=0), curves.std(axis=0, ddof=1)
                axis.fill_between(time_s, mean - sd, mean + sd, color=colour, alpha=0.25, lw=0)
                axis.plot(time_s, mean, "--", color=colour, label=name)
            axis.set(
                xlabel="time from actuation (s)",
                ylabel="mean relative change (%)",
                title=f"Figure 8b, simulated, level {level}",
                ylim=(-102, 25),
            )
        axes[0, 0].legend(ncols=2, loc="upper right")
    return figure
