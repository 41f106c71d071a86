"""Figure 10b of the paper: plates on two to eight springs, grasped at one width."""

from __future__ import annotations

from palpate.studies.equal_width import (
    CALIBRATION_INPUT,
    CLOSURE_MM,
    SEED,
    SENSORS,
    draw_lines,
    r_squared_payload,
    r_squared_table,
    settled_readings,
)
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table
from palpate.studies.twin_session import LEVELS, drawn

#: The twin's setups and their nominal stiffness, N/mm; the paper prints none.
SETUPS = {"springs-2": 2.0, "springs-4": 4.0, "springs-6": 6.0, "springs-8": 8.0}
#: Paper, section 3.2: of the line between stiffness and settled change, 4 setups, 10 grasps each.
PUBLISHED_R_SQUARED = 0.96
READING = "mean change"
SIZE_MM, REPEATS = 45.0, 10
#: The width is not printed, and R^2 depends on it.
CLOSURES_MM = (1.0, 2.0, CLOSURE_MM)


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Grasp simulated springs of four stiffnesses and compare R^2 with the paper's section 3.2.

    Example: palpate study springs --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Make the grasps and put R^2 beside the published one."""
    names, ratings = tuple(SETUPS), list(SETUPS.values())
    setups = [drawn(name, seed=SEED) for name in names]
    conditions = {
        f"closed by {closure_mm:g} mm": settled_readings(
            setups, width_mm=SIZE_MM - closure_mm, repeats=repeats, sensors=sensors
        )
        for closure_mm in CLOSURES_MM
    }
    last = conditions[f"closed by {CLOSURE_MM:g} mm"]
    return StudyReport(
        name="springs",
        title="Figure 10b: springs of four stiffnesses at one width",
        provenance=[
            f"Simulated: {repeats} grasps of each setup at one width on each of {sensors} "
            "sensors per level; median sensor's mean ± sd (range of means).",
            "Published: the R^2 of section 3.2; the paper prints neither changes, stiffnesses nor "
            "the width. The farther the closing, the more the change saturates and the lower R^2: "
            "3 mm was tried first, 1 and 2 mm added after seeing it; no one row is the answer.",
            CALIBRATION_INPUT,
        ],
        tables=[
            Table(
                title=f"Settled mean change, percent, closed by {CLOSURE_MM:g} mm",
                columns=("setup", "N/mm", *LEVELS),
                rows=[
                    [name, f"{SETUPS[name]:g}"]
                    + [last[level].cell(READING, index) for level in LEVELS]
                    for index, name in enumerate(names)
                ],
            ),
            r_squared_table(conditions, ratings, published=(READING, PUBLISHED_R_SQUARED)),
        ],
        payload={
            "study": "springs",
            "origin": "twin",
            "closures_mm": list(CLOSURES_MM),
            "published_r_squared": PUBLISHED_R_SQUARED,
            "stiffness_n_per_mm": SETUPS,
            "levels": {level: last[level].as_json(READING) for level in LEVELS},
            "r_squared": r_squared_payload(conditions, ratings),
        },
        figures={
            "figure10b": lambda: draw_lines(
                last,
                ratings,
                readings=(READING, "summed excess"),
                xlabel="stiffness (N/mm)",
            )
        },
    )
