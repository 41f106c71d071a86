"""How well bruised sides are distinguished from sound ones: every way on the same grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import rankdata

from palpate.arrays import FloatArray
from palpate.produce.bruise.model import BRUISED, REFERENCES, BruiseModel, table_sides
from palpate.produce.learning import LabelledTable, make_pipeline
from palpate_studies.bootstrap import bootstrap_interval
from palpate_studies.bruise_data import EARLY_S, Examined
from palpate_studies.protocol.paired import Difference, IntArray, drawn_difference

#: The way that needs no learning: the paper's mean over all pixels after 20 s.
SAME_WIDTH = "change of the 20 s mean since before, at one width (the paper's way)"
#: Pipelines in place of the shipped one, on the same contrasts -> their names in
#: `palpate.produce.learning.METHODS`.
LEARNERS = {"linear discriminant": "discriminant", "boosted trees": "trees"}
#: All references at once, by the shipped pipeline.
TOGETHER = f"logistic regression against all three references at once, {EARLY_S:g} s"
FALSE_ALARMS = 0.05


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

    def interval(self) -> tuple[float, float] | None:
        """Return its 90 % interval, drawing whole sensors; None where there is only one."""
        if len(set(self.sensors)) < 2:
            return None

        def of_drawn(drawn: FloatArray) -> np.floating:
            index = drawn.astype(int)
            return np.float64(area(self.bruised[index], self.score[index]))

        return bootstrap_interval(
            np.arange(len(self.score), dtype=float), self.sensors, statistic=of_drawn, draws=400
        )

    def found(self, false_alarms: float = FALSE_ALARMS) -> float:
        """Return the share of bruised sides that score above all but this share of sound ones."""
        limit = np.quantile(self.score[~self.bruised], 1.0 - false_alarms)
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
    scores = {SAME_WIDTH: paper_change(tested)}
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
    return {name: scored(tested, score) for name, score in scores.items()}


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


def paper_change(examined: Sequence[Examined]) -> FloatArray:
    """Return the change of the mean over all pixels since before, at one width."""
    return np.array(
        [
            one.presses["same_width"].mean_percent - one.presses["before"].mean_percent
            for one in examined
        ]
    )


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


def scored(examined: Sequence[Examined], score: FloatArray) -> Scored:
    """Pair scores with the truth."""
    return Scored(
        bruised=np.array([one.bruised for one in examined]),
        score=score,
        sensors=[str(one.sensor) for one in examined],
    )
