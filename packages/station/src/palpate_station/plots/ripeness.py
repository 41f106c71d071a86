"""Figure of an item's ripeness over days, with its possible courses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.plots.style import BLUE, GREY, ORANGE, log_axis, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate_station.records import Drive
    from palpate_station.ripeness.history import FirmnessHistory
    from palpate_station.ripeness.rule import Ripeness, RipenessRule

#: Range of the axis after the last grasp, days.
_AHEAD_DAYS = 3.0


def item_figure(
    history: FirmnessHistory, ripeness: Ripeness, *, rule: RipenessRule | None
) -> Figure:
    """Draw the grasps of one item, 90 % of its possible courses, and the stages.

    Parameters
    ----------
    history : FirmnessHistory
        The item's grasps.
    ripeness : Ripeness
        The judged ripeness.
    rule : RipenessRule, optional
        Course and stages; without a rule only the grasps are drawn.
    """
    with new_figure(width_in=6.4, height_in=4.0) as (figure, axes):
        axis = axes[0][0]
        grasp_days = np.array([history.day_of(grasp.taken_at) for grasp in history.grasps])
        end = float(grasp_days.max()) + (_AHEAD_DAYS if rule is not None else 0.5)
        if rule is not None:
            _draw_courses(axis, history, rule=rule, end=end)
        readings = _convert_firmness(history.firmness, drive=history.drive)
        axis.plot(grasp_days, readings, ".", color=GREY, label="grasps")
        days = [day.day for day in history.days]
        means = _convert_firmness([day.firmness for day in history.days], drive=history.drive)
        axis.plot(days, means, "o", color=BLUE, label="mean of the day")
        log_axis(axis.yaxis)
        axis.set(
            xlabel="days since the first grasp", xlim=(-0.2, end), title=_title(history, ripeness)
        )
        axis.tick_params(axis="y", which="minor", labelsize=7)
        if history.drive == "width":
            axis.set_ylabel("stiffness at 5 N (N/mm)")
        else:
            axis.set_ylabel("number of loaded pixels")
            axis.invert_yaxis()
        axis.legend(loc="lower left", fontsize=7)
    return figure


def _draw_courses(axis: Any, history: FirmnessHistory, *, rule: RipenessRule, end: float) -> None:
    day = np.linspace(-0.2, end, 80)
    courses = rule.course.weigh_courses(history.days)
    firmness = courses.firmness(day)
    low, middle, high = np.array(
        [courses.quantile(firmness[:, k], [0.05, 0.5, 0.95]) for k in range(day.size)]
    ).T
    low, middle, high = (
        _convert_firmness(values, drive=history.drive) for values in (low, middle, high)
    )
    axis.fill_between(day, low, high, color=BLUE, alpha=0.15, label="90 % of courses")
    axis.plot(day, middle, color=BLUE, lw=1)
    for stage in rule.stages[1:]:
        level = float(_convert_firmness(rule.find_boundary(stage), drive=history.drive))
        axis.axhline(level, color=ORANGE, lw=0.8, ls="--")
        axis.annotate(
            f"{stage} below" if history.drive == "width" else f"{stage} above",
            (end, level),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
            color=ORANGE,
        )


def _convert_firmness(firmness: ArrayLike, *, drive: Drive) -> NDArray[np.float64]:
    """Return the stiffness in N/mm, or the number of loaded pixels."""
    values = np.asarray(firmness, dtype=float)
    return np.asarray(np.exp(values if drive == "width" else -values))


def _title(history: FirmnessHistory, ripeness: Ripeness) -> str:
    simulated = ", simulated" if any(grasp.is_simulated for grasp in history.grasps) else ""
    percent = 100 * ripeness.probabilities[ripeness.stage]
    title = f"{history.item_id}{simulated}: {ripeness.stage} ({percent:.0f} %)"
    days = ripeness.days_to_ripe
    if days is not None and np.isfinite([days.low, days.high]).all() and days.high > 0:
        title += f", days to ripe: {days.text}"
    return title
