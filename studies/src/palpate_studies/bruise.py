"""How reliably bruised apples differ from sound ones, by every method on the same grasps."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import rankdata

from palpate.arrays import FloatArray
from palpate.files import atomic_path
from palpate.produce.bruise.model import (
    BRUISED,
    REFERENCES,
    BruiseModel,
    default_model,
    simulated_sides,
    table_sides,
)
from palpate.produce.learning import LabelledTable, make_pipeline
from palpate_studies.bruise_data import (
    EARLY_S,
    PLACED_WITHIN_MM,
    REFERENCE_APPLES,
    Examined,
    as_drawn,
    examine,
)
from palpate_studies.protocol.paired import Difference, IntArray, drawn_difference
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.fruit import corky, rotten
from palpate_studies.twin_apple import Apple

#: The way that needs no learning: the paper's mean over all pixels after 20 s.
SAME_WIDTH = "change of the 20 s mean since before, at one width (the paper's way)"
#: Pipelines in place of the shipped one, on the same contrasts -> their names in
#: `palpate.produce.learning.METHODS`.
LEARNERS = {"linear discriminant": "discriminant", "boosted trees": "trees"}
#: All references at once, by the shipped pipeline.
TOGETHER = f"logistic regression against all three references at once, {EARLY_S:g} s"
FALSE_ALARMS = 0.05
#: Digits of contrasts in the file of simulated sides.
_DIGITS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """Scores of one way on the test apples of a level; a higher one means bruised.

    Attributes
    ----------
    bruised : ndarray of bool, shape (apples,)
        The truth.
    score : ndarray, shape (apples,)
        One per apple.
    sensors : sequence of str
        On which sensor.
    """

    bruised: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    score: FloatArray
    sensors: Sequence[str]

    @property
    def auc(self) -> float:
        """Area under the ROC curve."""
        return area(self.bruised, self.score)

    def found(self) -> float:
        """Return the share of bruised sides that score above all but 5 % of sound ones."""
        limit = np.quantile(self.score[~self.bruised], 1.0 - FALSE_ALARMS)
        return float(np.mean(self.score[self.bruised] > limit))


def area(bruised: FloatArray | np.ndarray, score: FloatArray) -> float:
    """Return the area under the ROC curve: how often a bruised one scores above a sound one.

    Examples
    --------
    >>> area(np.array([False, True, True]), np.array([0.1, 0.9, 0.1]))
    0.75
    """
    truth = np.asarray(bruised, dtype=bool)
    many, rest = int(truth.sum()), int((~truth).sum())
    if not many or not rest:
        return float("nan")
    ranks = rankdata(score)
    return float((ranks[truth].sum() - many * (many + 1) / 2) / (many * rest))


def area_lost(ours: Scored, rival: Scored) -> Difference:
    """Return what ours lacks of a whole area under the ROC curve, less what a rival lacks."""

    def of(chosen: IntArray) -> np.floating:
        truth = ours.bruised[chosen]
        return np.float64(area(truth, rival.score[chosen]) - area(truth, ours.score[chosen]))

    return drawn_difference(of, ours.sensors)


def known_of(examined: Sequence[Examined]) -> dict[str, LabelledTable]:
    """Return the contrasts of sides to each reference, with the truth."""
    return table_sides(
        [(str(number), one.bruised, one.side(EARLY_S)) for number, one in enumerate(examined)]
    )


def score_all(
    tested: Sequence[Examined], model: BruiseModel, *, known: Mapping[str, LabelledTable]
) -> dict[str, Scored]:
    """Return the scores of every way on the test apples; way -> scores.

    `known`: the sides that the model, and the learners in its place, are learned from.
    """
    felt = known_of(tested)
    changes = [
        one.presses["same_width"].mean_percent - one.presses["before"].mean_percent
        for one in tested
    ]
    scores = {SAME_WIDTH: np.array(changes)}
    for name in REFERENCES:
        sides = [one.side(EARLY_S) for one in tested]
        scores[way("ours", name)] = np.array(
            [model.log_odds(replace(one, against={name: one.against[name]})) for one in sides]
        )
        scores |= {
            way(learner, name): _learned(method, [known[name]], [felt[name]])
            for learner, method in LEARNERS.items()
        }
    scores[TOGETHER] = _learned("logistic", list(known.values()), list(felt.values()))
    bruised = np.array([one.bruised for one in tested])
    sensors = [str(one.sensor) for one in tested]
    return {
        name: Scored(bruised=bruised, score=score, sensors=sensors)
        for name, score in scores.items()
    }


def compare_all(scores: Mapping[str, Scored]) -> list[dict[str, Any]]:
    """Return what ours lacks against each reference, less what each other way lacks."""
    return [
        {
            "reference": name,
            "rival": rival,
            **area_lost(scores[way("ours", name)], scores[rival]).to_dict(),
        }
        for name in REFERENCES
        for rival in (SAME_WIDTH, *(way(learner, name) for learner in LEARNERS), TOGETHER)
    ]


def _learned(
    method: str, known: Sequence[LabelledTable], felt: Sequence[LabelledTable]
) -> FloatArray:
    """Learn from known sides by another pipeline, and return a score for each tested one."""
    bruised = np.array(known[0].labels) == BRUISED
    pipeline = make_pipeline(method).fit(np.hstack([one.rows for one in known]), bruised)
    return np.asarray(pipeline.decision_function(np.hstack([one.rows for one in felt])))


def way(method: str, reference: str) -> str:
    """Return the name of a judgement against one reference."""
    return f"{method} against {reference}, {EARLY_S:g} s"


def report(
    *,
    apples: Annotated[
        int, typer.Option(help="Apples tested on each level; 500 for figures to rely on.", min=24)
    ] = 48,
    seed: Annotated[int, typer.Option(help="Seed of apples and sensors.", min=0)] = 1,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp many sound and bruised apples on the twin, and tell them apart in every way.

    With --out, the sides learned from at each level are written too. --second judges bruises of
    another shape, rot, and the same apples of the first, two dozen on a sensor, by what the sides
    that palpate ships teach.

    Example: palpate study bruise --apples 96 --out reports
    """
    if second:
        return second_report(range(seed, seed + apples // 24))
    purposes = {
        "learn": max(2 * apples // 24 * 24, 48),
        "test": apples,
    }
    return judge(examine(purposes, levels=LEVELS, seed=seed))


command = as_command(report)


def judge(examined: Sequence[Examined]) -> StudyReport:
    """Score everything and put it into tables."""
    levels = list(dict.fromkeys(one.level for one in examined))
    counts, ways, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
    known = {}
    for level in levels:
        of = {
            purpose: [one for one in examined if (one.purpose, one.level) == (purpose, level)]
            for purpose in dict.fromkeys(one.purpose for one in examined)
        }
        sensors = len({one.sensor for one in of["learn"]})
        learned_on = (
            f"{len(of['learn'])} simulated apples on {sensors} simulated sensors, level {level}"
        )
        known[level] = known_of(of["learn"]), learned_on
        model = BruiseModel.learn(known[level][0], learned_on=learned_on)
        scores = score_all(of["test"], model, known=known[level][0])
        counts[level] = {purpose: len(mine) for purpose, mine in of.items()}
        ways[level] = {name: {"auc": one.auc, "found": one.found()} for name, one in scores.items()}
        compared += [{"level": level, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruised and sound apples (simulated)",
        provenance=[
            f"Simulated, each level: {counts[levels[0]]['test']} apples tested and "
            f"{counts[levels[0]]['learn']} others, on other sensors, learned from, half of them "
            f"bruised, each with its bruise within {PLACED_WITHIN_MM:g} mm of the middle of either "
            "finger; grasped once at the side in question, closed by contact. They differ in size, "
            "firmness, roundness, firmer sides; bruises in diameter, depth, softness, dent and "
            "place (ranges: `palpate_studies.fruit_ranges`).",
            f"References: class, {REFERENCE_APPLES} other sound apples on the same sensor; item, "
            "one grasp a quarter turn on; history, one earlier grasp of the same side, sound then.",
        ],
        tables=[
            Table.wide(
                "Bruised or not, from one grasp of the side: area under the ROC curve, and percent "
                f"found at {100 * FALSE_ALARMS:g} % false alarms",
                [
                    {"level": level, "way": name, **one}
                    for level in levels
                    for name, one in ways[level].items()
                ],
                {"way": "{way}"},
                over="level",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={
            "study": "bruise",
            "origin": "twin",
            "apples": counts,
            "ways": ways,
            "compared": compared,
        },
        files={
            f"bruise-sides-{level}.json": partial(save_sides, *sides)
            for level, sides in known.items()
        },
    )


def second_report(seeds: Sequence[int]) -> StudyReport:
    """Judge the same apples, bruised in two ways or rotten, by the model that palpate ships."""
    remakes: dict[str, Callable[[Apple], Apple]] = {
        "first": as_drawn,
        "second": corky,
        "rot": rotten,
    }
    rows, ways = list[dict[str, Any]](), list[dict[str, Any]]()
    _, known = simulated_sides()
    for name, remade in remakes.items():
        found = [
            one
            for seed in seeds
            for one in examine({"test": 24}, levels=["lab"], seed=seed, remade=remade)
        ]
        scores = score_all(found, default_model(), known=known)
        counts = {"apples": len(found), "sensors": len({one.sensor for one in found})}
        ways += [
            {"generator": name, "way": way, **counts, "auc": one.auc, "found": one.found()}
            for way, one in scores.items()
        ]
        rows += [{"generator": name, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruises of another shape, and rot (simulated)",
        provenance=(
            "Simulated, at level lab. The second generator is described in "
            "`palpate_studies.second.fruit`, fixed before it was scored; the model that "
            "palpate ships was learned on the first.",
        ),
        tables=[
            Table.wide(
                "Bruised or sound: area under the ROC curve, and percent found at "
                f"{100 * FALSE_ALARMS:g} % false alarms",
                ways,
                {"way": "{way}"},
                over="generator",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={"study": "bruise", "simulated": True, "ways": ways, "compared": rows},
    )


def save_sides(known: Mapping[str, LabelledTable], learned_on: str, path: Path) -> None:
    """Write known sides as JSON, in the form of those that come with palpate."""
    document = {
        "learned_on": learned_on,
        "sides": {
            name: {"labels": table.labels, "contrasts": table.rows.round(_DIGITS).tolist()}
            for name, table in known.items()
        },
    }
    with atomic_path(path) as unfinished:
        unfinished.write_text(json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n")
