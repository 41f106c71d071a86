"""Table 2 and Figure 8b of the paper: four silicone sheets grasped at one width."""

from __future__ import annotations

import numpy as np

from palpate_studies.equal_width import (
    CALIBRATION_INPUT,
    CLOSURE_MM,
    SENSORS,
    draw_curves,
    format_cells,
    measure_settled_readings,
    summarise_sensors,
)
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import draw_named

#: Paper, Table 2: mean and standard deviation over 10 grasps, percent; Shore hardness.
PUBLISHED = {
    "ecoflex-10": (-46.0, 1.8, "00-10"),
    "dragonskin-10": (-54.7, 1.2, "A-10"),
    "dragonskin-20": (-66.9, 0.52, "A-20"),
    "dragonskin-30": (-71.5, 0.74, "A-30"),
}
#: The sheets with their holder are 40 mm thick.
WIDTH_MM, REPEATS = 40.0 - CLOSURE_MM, 10


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Grasp four simulated silicone sheets at one width and compare with the paper's Table 2.

    Example: palpate study table2 --out reports
    """
    names = tuple(PUBLISHED)
    found = measure_settled_readings(
        [draw_named(name) for name in names],
        reading="mean change",
        width_mm=WIDTH_MM,
        repeats=repeats,
        sensors=sensors,
    )
    rows = [
        [
            name,
            PUBLISHED[name][2],
            "{:g} ± {:g}".format(*PUBLISHED[name][:2]),
            *format_cells(found, index),
        ]
        for index, name in enumerate(names)
    ]
    # Sensors on which the change increases with the hardness over all four sheets.
    ordered = {
        level: int(np.sum(np.all(np.diff(found[level].mean(axis=2), axis=0) < 0, axis=0)))
        for level in LEVELS
    }
    return StudyReport(
        name="table2",
        title="Table 2: settled relative change of four silicone sheets at one width",
        provenance=[
            f"Simulated: {repeats} grasps of each sheet at {WIDTH_MM:g} mm on each of {sensors} "
            "sensors per level; median sensor's mean ± sd over grasps (range of means).",
            "Published: the paper's Table 2, one sensor, 10 grasps, width not printed.",
            CALIBRATION_INPUT,
            "Sensors on which the four means are in the order of hardness: "
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
            "origin": "twin",
            "width_mm": WIDTH_MM,
            "published": {name: list(values[:2]) for name, values in PUBLISHED.items()},
            "levels": summarise_sensors(found, names),
            "sensors_in_order": ordered,
        },
        figures={
            "figure8b": lambda: draw_curves(
                {name: draw_named(name) for name in names},
                width_mm=WIDTH_MM,
                title="Figure 8b",
                published={name: (mean, sd) for name, (mean, sd, _) in PUBLISHED.items()},
            )
        },
    )


command = as_command(report)
