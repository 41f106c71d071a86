"""Table 6 and Figure 17b of the paper: an apple before and after its fall."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.settling.predict import predict_settled
from palpate.signal.relative import mean_change
from palpate.twin.objects import TwinObject
from palpate_studies.equal_width import format_mean_and_range
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_apple import Apple, Bruise, Faces, draw_apple, find_first_touch
from palpate_studies.twin_session import HOLD_S, SETTLED_MEAN_S, Session, stack_holds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, Table 6: mean and standard deviation over 10 grasps, percent.
COLUMNS = ("before", "after", "only bruised")
PUBLISHED: dict[str, tuple[tuple[float, float], ...]] = {
    "exponential, 2.5 s": ((-24.9, 0.78), (-15.8, 1.3), (-5.89, 3.7)),
    "recorded, 20 s": ((-21.2, 1.9), (-13.0, 2.4), (-3.75, 1.6)),
}
SENSORS, REPEATS, FIRST_SENSOR = 3, 10, 70_000
#: The apple: round and of average firmness. The closure, which the paper doesn't print, was set to
#: the published change before the fall, and the depth of the fresh dent to the change after it
#: (-21.4 and -13.0 %: median of 16 other sensors, seeds 71000 to 71015, at level lab).
SIZE_MM, FIRMNESS_N, CLOSURE_MM = 66.0, 16.0, 1.2
DROPPED = Bruise(
    angle_deg=0.0, height_mm=0.0, diameter_mm=28.0, depth_mm=9.8, softness=0.35, dent_mm=0.22
)


#: Row -> method and cut-off; the last row is the mean of the last half second.
ROWS: dict[str, tuple[str, float]] = {
    "exponential, 2.5 s": ("exponential", 2.5),
    "ours, 2.5 s": ("relaxation", 2.5),
    "recorded, 20 s": ("recorded", 20.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """Traces of one sensor: column -> mean relative changes, shape (repeats, times).

    `support_n`: force of the support at 20 s, which balances the unequal finger forces.
    """

    time_s: FloatArray
    traces: Mapping[str, FloatArray]
    support_n: float = 0.0

    def values(self, column: str, method: str, cutoff_s: float) -> FloatArray:
        """Return the settled values of a column's grasps, percent, predicted at a cut-off."""
        traces = self.traces[column]
        if cutoff_s == HOLD_S:
            return np.asarray(traces[:, self.time_s > HOLD_S - SETTLED_MEAN_S].mean(axis=1))
        settled = predict_settled(
            self.time_s, traces, cutoff_s=cutoff_s, method=method, unit="percent"
        )
        return np.asarray(settled.value)


def drop_apple() -> Apple:
    """Return the apple after its fall."""
    drawn = draw_apple(np.random.default_rng(6), bruises=None)
    flesh = replace(drawn.flesh, size_mm=SIZE_MM, force_at_1mm_n=FIRMNESS_N)
    return replace(
        drawn, flesh=flesh, oval=0.0, lobes=0.0, firmer=0.0, leaning_mm=0.0, bruise=DROPPED
    )


def grasp_free(level: str, sensor: int, *, repeats: int = REPEATS) -> Traces:
    """Grasp the apple before and after its fall at one width, on the bruise."""
    session, apple = Session(sensor, level=level), drop_apple()
    before = _hold_repeatedly(session, replace(apple, bruise=None).facing(0.0), repeats=repeats)
    after = _hold_repeatedly(session, apple.facing(0.0), repeats=repeats)
    return _traces(session, before, after)


def grasp_supported(level: str, sensor: int, *, repeats: int = REPEATS) -> Traces:
    """Grasp the apple like `grasp_free`, but with a support that holds it in place.

    Each finger then deforms its side by the same travel, so the forces differ. Each side is
    simulated with a symmetric apple: bruised on both sides for the first finger, sound on both
    sides for the second.
    """
    session, apple = Session(sensor, level=level), drop_apple()
    sound = replace(apple, bruise=None).facing(0.0)
    before = _hold_repeatedly(session, sound, repeats=repeats)
    sound_n = session.world.truth().force_n
    bruised = _hold_repeatedly(session, _bruise_both_sides(apple), repeats=repeats)
    support_n = sound_n - session.world.truth().force_n
    other = _hold_repeatedly(session, sound, repeats=repeats)
    times = min(bruised.shape[1], other.shape[1])
    first = session.world.layout.finger_mask(0)
    after = np.where(first, bruised[:, :times], other[:, :times])
    return _traces(session, before, after, support_n=support_n)


def _traces(
    session: Session, before: FloatArray, after: FloatArray, *, support_n: float = 0.0
) -> Traces:
    times = min(before.shape[1], after.shape[1])
    first = session.world.layout.finger_mask(0)
    return Traces(
        time_s=np.arange(1, times + 1) / session.world.frame_rate_hz,
        traces={
            "before": mean_change(before)[:, :times],
            "after": mean_change(after)[:, :times],
            "only bruised": after[:, :times, first].mean(axis=2),
        },
        support_n=support_n,
    )


def _bruise_both_sides(apple: Apple) -> TwinObject:
    """Return the apple with its bruised side on both sides."""
    faces = apple.facing(0.0).faces
    assert isinstance(faces, Faces)
    bruised = faces.faces[0]
    alike = Faces(faces=(bruised, bruised), fruit_mm=faces.fruit_mm)
    return replace(
        apple.flesh,
        size_mm=SIZE_MM - 2.0 * find_first_touch(bruised)[0],
        force_at_1mm_n=apple.flesh.force_at_1mm_n * alike.stiffness,
        faces=alike,
    )


def _hold_repeatedly(session: Session, apple: TwinObject, *, repeats: int) -> FloatArray:
    """Hold the apple repeatedly; return changes, shape (repeats, times, rows, cols)."""
    holds = []
    for _ in range(repeats):
        session.place(apple)
        holds.append(session.hold(SIZE_MM, width_mm=SIZE_MM - CLOSURE_MM))
    return stack_holds(holds)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Grasp a simulated apple before and after its fall, free and in a support.

    Example: palpate study table6 --out reports
    """
    made = {
        variant: {
            level: [
                grasp(level, FIRST_SENSOR + sensor, repeats=repeats) for sensor in range(sensors)
            ]
            for level in LEVELS
        }
        for variant, grasp in {"free": grasp_free, "supported": grasp_supported}.items()
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
    met = _compare_published(entries)
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
            "Free: both fingers have the same force. Supported: a support holds the apple in "
            "place, so that each finger presses its own side. Inputs of the twin, set on other "
            "sensors with a free apple: the width, from 'before', and a dent of "
            f"{DROPPED.dent_mm:g} mm, from 'after'. Nothing was adjusted for the support.",
            "Force of the support: "
            + ", ".join(f"{support_n[level]:.1f} N ({level})" for level in LEVELS)
            + "; the friction of an apple of 200 g with a coefficient of 0.5 is 1 N.",
        ],
        tables=[
            Table.wide(
                "Mean relative change of an apple, percent",
                [{**one, "apple": f"{one['variant']}, {one['level']}"} for one in entries],
                {"row": "{row}", "column": "{column}", "published": _format_published},
                over="apple",
                form="{cell}",
            )
        ],
        payload={
            "origin": "twin",
            "support_n": support_n,
            "published": {row: [list(pair) for pair in pairs] for row, pairs in PUBLISHED.items()},
            "met": met,
        },
        figures={"figure17": lambda: draw({at: made["free"][at][0] for at in LEVELS})},
    )


command = as_command(report)


def summarise(made: list[Traces], row: str, column: str) -> dict[str, Any]:
    """Return mean and sd over the grasps of the median sensor, and the formatted cell."""
    values = [one.values(column, *ROWS[row]) for one in made]
    mean, sd = np.array([v.mean() for v in values]), np.array([v.std(ddof=1) for v in values])
    return {
        "mean": float(np.median(mean)),
        "sd": float(np.median(sd)),
        "cell": format_mean_and_range(mean, sd),
    }


def _format_published(entry: Any) -> str:
    row, column = entry["row"], entry["column"]
    if row not in PUBLISHED:
        return ""
    return "{:.3g} ± {:.2g}".format(*PUBLISHED[row][COLUMNS.index(column)])


def _compare_published(entries: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Compare the median sensor's mean with every published entry.

    `met`: the means differ by at most twice the published standard deviation.
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
    """Draw mean and standard deviation over time, as in the paper's Figure 17b, by level."""
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
