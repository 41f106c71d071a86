"""Score the judgements of palpate and of baselines against the true stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate_station.learning import LabelLearner
from palpate_station.ripeness.firmness import DayFirmness
from palpate_station.ripeness.rule import judge_by_first_day, learn_stages
from palpate_station.ripeness.stages import RIPE, STAGES
from palpate_studies.baselines.ripeness_learners import STAGE_LEARNERS, learn_stage, list_day_inputs
from palpate_studies.protocol.paired import difference_of_pairs
from palpate_studies.ripeness_station import DAYS
from palpate_studies.station_records import (
    StationRecords,
    days_of,
    learn_rule,
    select_labelled,
)

#: Method -> description.
METHODS = {
    "ours": "discriminant of the day's firmness",
    "own first day": "softening since the item's first day, without labels",
    "settled change": "the paper's method: change at one width or pressure, learned thresholds",
    **STAGE_LEARNERS,
}
#: Daily means that are inputs of the learners, besides the firmness.
_MEASURED = ("stiffness_n_per_mm", "force_n", "settled_percent", "size_mm", "width_mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One fruit on one day, judged by every method; stages as numbers, firmest 0.

    Attributes
    ----------
    fruit : str
        Name of the fruit, including its sensor.
    truth : int
        True stage.
    stages : dict of str to int
        Method -> judged stage; -1 if the method is not applicable.
    wait_days : float
        True days until ripe; 0 or less for a ripe fruit.
    value_days, low_days, high_days : float
        palpate's estimate.
    day : int
        Number of the morning.
    grasps : int
        Grasps on that day.
    """

    fruit: str
    truth: int
    stages: dict[str, int]
    wait_days: float
    value_days: float
    low_days: float
    high_days: float
    day: int
    grasps: int


def judge_days(
    records: StationRecords, *, others: Sequence[StationRecords] = (), name: str = ""
) -> list[Judged]:
    """Judge every unlabelled fruit on every day from its days so far.

    Parameters
    ----------
    records : StationRecords
        Records of one station.
    others : sequence of StationRecords
        Other stations, whose labelled fruits are also training data of the learners.
    name : str
        Name of the station.
    """
    rule = learn_rule(records)
    published = _learn_published(records)
    learners = _learners([records, *others])
    found = []
    for number, fruit in enumerate(records.others):
        days = days_of(records, f"fruit-{number}")
        for count in range(1, len(days) + 1):
            day = round(days[count - 1].day)
            ours = rule.judge(days[:count])
            wait = ours.days_to_ripe
            if wait is None:
                raise InputError("the rule learned from labels gave no days to ripe")
            own = -1
            if records.grasps[0].drive == "width":
                own = STAGES.index(judge_by_first_day(days[:count]).stage)
            change = records.as_published[f"fruit-{number}", day]
            shown = _list_inputs(records, f"fruit-{number}", days[:count])
            found.append(
                Judged(
                    fruit=f"{name}/{number}",
                    truth=STAGES.index(fruit.stage(day)),
                    stages={
                        "ours": STAGES.index(ours.stage),
                        "own first day": own,
                        "settled change": STAGES.index(published.predict([[change]])[0]),
                        **{learner: stage(shown) for learner, stage in learners.items()},
                    },
                    wait_days=fruit.day_of(RIPE) - day,
                    value_days=wait.value,
                    low_days=wait.low,
                    high_days=wait.high,
                    day=day,
                    grasps=days[count - 1].grasps,
                )
            )
    return found


def scores(rows: Sequence[Judged]) -> dict[str, Any]:
    """Return each method's exact and within-one fractions, and its error in days to ripe."""
    found: dict[str, Any] = {"fruit_days": len(rows)}
    for method in METHODS:
        off = np.array(
            [abs(row.truth - row.stages[method]) for row in rows if row.stages[method] >= 0]
        )
        found[method] = (
            {"exact": float(np.mean(off == 0)), "within_one": float(np.mean(off <= 1))}
            if off.size
            else None
        )
    found["grasps_a_day"] = float(np.mean([row.grasps for row in rows]))
    waiting = [row for row in rows if row.wait_days > 0]
    found["days_to_ripe"] = {
        "fruit_days": len(waiting),
        "coverage": float(np.mean([r.low_days <= r.wait_days <= r.high_days for r in waiting])),
        "median_abs_error_days": float(
            np.median([abs(r.value_days - r.wait_days) for r in waiting])
        ),
        "median_width_days": float(np.median([r.high_days - r.low_days for r in waiting])),
    }
    return found


def compare_methods(rows: Sequence[Judged]) -> list[dict[str, Any]]:
    """Compare palpate's fraction of wrong stages with each other method's, by fruit."""
    wrong = {
        method: [float(row.stages[method] != row.truth) for row in rows]
        for method in METHODS
        if all(row.stages[method] >= 0 for row in rows)
    }
    return [
        {
            "rival": method,
            **difference_of_pairs(
                wrong["ours"], wrong[method], [row.fruit for row in rows], statistic=np.mean
            ).to_dict(),
        }
        for method in wrong
        if method != "ours"
    ]


def _learners(stations: Sequence[StationRecords]) -> dict[str, Callable[[Sequence[float]], int]]:
    """Train the learners on every labelled fruit and day of some stations."""
    rows, stages = list[list[float]](), list[int]()
    for records in stations:
        for number, (fruit, days) in enumerate(select_labelled(records)):
            for count in range(1, len(days) + 1):
                rows.append(_list_inputs(records, f"labelled-{number}", days[:count]))
                stages.append(STAGES.index(fruit.stage(round(days[count - 1].day))))
    return {learner: learn_stage(learner, rows, stages) for learner in STAGE_LEARNERS}


def _list_inputs(records: StationRecords, item_id: str, days: Sequence[DayFirmness]) -> list[float]:
    """Return a learner's inputs for one day.

    The inputs are the firmness, the day's means, and the settled change at one width or pressure.
    A missing mean is 0.
    """
    day = round(days[-1].day)
    first = min(grasp.taken_at for grasp in records.grasps if grasp.item_id == item_id).date()
    today = [
        grasp.measurements
        for grasp in records.grasps
        if grasp.item_id == item_id and (grasp.taken_at.date() - first).days == day
    ]
    means = [
        float(np.mean(values)) if values else 0.0
        for name in _MEASURED
        for values in [[one[name].middle for one in today if name in one]]
    ]
    change = records.as_published[item_id, day]
    return [*list_day_inputs(days), *means, change]


def _learn_published(records: StationRecords) -> LabelLearner:
    """Learn stages from the settled change, with the same labels as palpate.

    Under one pressure a ripe fruit may read more than a hard one, because it touches more pixels.
    """
    known = [
        (change, fruit.stage(day), str(number))
        for number, fruit in enumerate(records.labelled)
        for day in range(DAYS)
        if (change := records.as_published.get((f"labelled-{number}", day))) is not None
    ]
    changes, labels, items = zip(*known, strict=True)
    return learn_stages(changes, labels, items=items, stages=STAGES)
