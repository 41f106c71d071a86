"""Figure 10b of the paper: plates on two to eight springs, grasped at one width."""

from __future__ import annotations

from palpate_studies.equal_width import CLOSURE_MM, SENSORS, LineStudy, measure_settled_readings
from palpate_studies.report import StudyReport, as_command
from palpate_studies.twin_session import draw_named

#: The twin's setups and their nominal stiffness, N/mm; the paper prints none.
SETUPS = {"springs-2": 2.0, "springs-4": 4.0, "springs-6": 6.0, "springs-8": 8.0}
#: Line between stiffness and settled change (paper, section 3.2): 4 setups, 10 grasps each.
STUDY = LineStudy(
    name="springs",
    title="Figure 10b: springs of four stiffnesses at one width",
    figure="figure10b",
    reading="mean change",
    published_r_squared=0.96,
    ratings=SETUPS,
    rated="stiffness (N/mm)",
)
SIZE_MM, REPEATS = 45.0, 10
#: The paper does not print the width, on which R^2 depends.
CLOSURES_MM = (1.0, 2.0, CLOSURE_MM)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Grasp simulated springs of four stiffnesses and compare R^2 with the paper's section 3.2.

    Example: palpate study springs --out reports
    """
    setups = [draw_named(name) for name in SETUPS]
    conditions = {
        f"closed by {closure_mm:g} mm": measure_settled_readings(
            setups,
            reading=STUDY.reading,
            width_mm=SIZE_MM - closure_mm,
            repeats=repeats,
            sensors=sensors,
        )
        for closure_mm in CLOSURES_MM
    }
    return STUDY.report(
        conditions,
        main=f"closed by {CLOSURE_MM:g} mm",
        provenance=[
            f"Simulated: {repeats} grasps of each setup at one width on each of {sensors} "
            "sensors per level; median sensor's mean ± sd (range of means).",
            "Published: the R^2 of section 3.2. The paper prints neither changes, stiffnesses nor "
            "the width, so no single row corresponds to its protocol. With more closure the change "
            "saturates and R^2 falls. 3 mm was evaluated first; 1 and 2 mm were added after its "
            "result was known.",
        ],
        changes=(
            f"Settled mean change, percent, closed by {CLOSURE_MM:g} mm",
            ("setup", "N/mm"),
            [[name, f"{rating:g}"] for name, rating in SETUPS.items()],
        ),
        payload={"closures_mm": list(CLOSURES_MM), "stiffness_n_per_mm": SETUPS},
    )


command = as_command(report)
