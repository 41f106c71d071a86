"""Table 6 and Figure 17b of the paper: an apple before and after its fall, free or supported."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate_studies.dropped_apple import (
    COLUMNS,
    DROPPED,
    FIRST_SENSOR,
    PUBLISHED,
    REPEATS,
    SENSORS,
    Traces,
    grasp_free,
    grasp_supported,
)
from palpate_studies.equal_width import mean_and_range
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Row -> method and cut-off; the last row is the mean of the last half second.
ROWS: dict[str, tuple[str, float]] = {
    "exponential, 2.5 s": ("exponential", 2.5),
    "ours, 2.5 s": ("relaxation", 2.5),
    "recorded, 20 s": ("recorded", 20.0),
}
#: Variants of what lies between the fingers.
VARIANTS = {"free": grasp_free, "supported": grasp_supported}


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Grasp a simulated apple before and after its fall, free and held in place by a support.

    Example: palpate study table6 --out reports
    """
    made = {
        variant: {
            level: [
                grasp(level, FIRST_SENSOR + sensor, repeats=repeats) for sensor in range(sensors)
            ]
            for level in LEVELS
        }
        for variant, grasp in VARIANTS.items()
    }
    entries = [
        {
            "variant": variant,
            "level": level,
            "row": row,
            "column": column,
            **summarise(each, row, column),
        }
        for variant, by_level in made.items()
        for row in ROWS
        for column in COLUMNS
        for level, each in by_level.items()
    ]
    met = _met(entries)
    support_n = {
        level: float(np.median([one.support_n for one in each]))
        for level, each in made["supported"].items()
    }
    return StudyReport(
        name="table6",
        title="Table 6: an apple before and after its fall",
        provenance=[
            f"Simulated: {repeats} grasps of one apple at one width on each of {sensors} sensors "
            "per level; median sensor's mean ± sd (range of means).",
            "Published: one apple, one sensor, 10 grasps; width not printed.",
            "Free: both fingers carry one force. Supported: what the apple rests on holds it in "
            "place, so that each finger presses its own side. Inputs of the twin, set on other "
            f"sensors with a free apple: the width, by 'before', and a dent of {DROPPED.dent_mm:g} "
            "mm, by 'after'; nothing was set again for the support.",
            "Force that the support has to take up: "
            + ", ".join(f"{support_n[level]:.1f} N ({level})" for level in LEVELS)
            + "; an apple of 200 g that slides at 0.5 takes up 1 N.",
        ],
        tables=[
            Table.wide(
                "Mean relative change of an apple, percent",
                [{**one, "apple": f"{one['variant']}, {one['level']}"} for one in entries],
                {"row": "{row}", "column": "{column}", "published": _published},
                over="apple",
                form="{cell}",
            )
        ],
        payload={
            "study": "table6",
            "origin": "twin",
            "support_n": support_n,
            "published": {row: [list(pair) for pair in pairs] for row, pairs in PUBLISHED.items()},
            "met": met,
        },
        figures={"figure17": lambda: draw({at: made["free"][at][0] for at in LEVELS})},
    )


command = as_command(report)


def summarise(made: list[Traces], row: str, column: str) -> dict[str, Any]:
    """Return mean and sd over the grasps of the median sensor, and both with their range."""
    values = [one.values(column, *ROWS[row]) for one in made]
    mean, sd = np.array([v.mean() for v in values]), np.array([v.std(ddof=1) for v in values])
    return {
        "mean": float(np.median(mean)),
        "sd": float(np.median(sd)),
        "cell": mean_and_range(mean, sd),
    }


def _published(entry: Any) -> str:
    row, column = entry["row"], entry["column"]
    if row not in PUBLISHED:
        return ""
    return "{:.3g} ± {:.2g}".format(*PUBLISHED[row][COLUMNS.index(column)])


def _met(entries: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return for every published entry the median sensor's mean, and whether it is met.

    It is met where the difference of the means is below twice the published sd.
    """
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for one in entries:
        if one["row"] in PUBLISHED:
            mean, sd = PUBLISHED[one["row"]][COLUMNS.index(one["column"])]
            of_level = found.setdefault(one["variant"], {}).setdefault(one["level"], {})
            of_level[f"{one['row']}, {one['column']}"] = {
                "mean": one["mean"],
                "sd": one["sd"],
                "published": mean,
                "met": abs(one["mean"] - mean) <= 2.0 * sd,
            }
    return found


def draw(shown: Mapping[str, Traces]) -> Figure:
    """Draw mean and standard deviation over grasps against time (paper, Figure 17b), by level."""
    from palpate.plots.style import BLUE, GREEN, ORANGE, legend_below, new_figure

    published = dict(zip(COLUMNS, PUBLISHED["recorded, 20 s"], strict=True))
    with new_figure(columns=len(shown), width_in=7.2, height_in=3.6) as (figure, axes):
        for axis, (level, one) in zip(axes[0], shown.items(), strict=True):
            for (name, traces), colour in zip(
                one.traces.items(), (BLUE, ORANGE, GREEN), strict=True
            ):
                mean, sd = traces.mean(axis=0), traces.std(axis=0, ddof=1)
                axis.fill_between(one.time_s, mean - sd, mean + sd, color=colour, alpha=0.2, lw=0)
                axis.plot(one.time_s, mean, "--", color=colour, label=name)
                label = f"{name}, published at 20 s"
                axis.errorbar(21.0, *published[name], fmt="o", color=colour, capsize=3, label=label)
            axis.set(
                xlabel="time from actuation (s)",
                title=f"Figure 17b, simulated, level {level}",
                xlim=(0, 22),
                xticks=range(0, 21, 5),
            )
            low, high = axis.get_ylim()
            axis.set_ylim(low, min(high, 15.0))
        axes[0, 0].set_ylabel("mean relative change (%)")
        legend_below(figure, axes, entry_in=2.3)
    return figure
