"""How well bruised sides are distinguished from sound ones: every way on the same grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.stats import rankdata

from palpate.arrays import FloatArray
from palpate.errors import needing
from palpate.produce.bruise.model import REFERENCES, BruiseModel, learn_bruises
from palpate.produce.bruise.shape import contrast
from palpate_studies.bootstrap import bootstrap_interval
from palpate_studies.bruise_data import EARLY_S, Examined
from palpate_studies.protocol.paired import Difference, IntArray, drawn_difference

#: The way that needs no learning: the paper's mean over all pixels after 20 s.
SAME_WIDTH = "change of the 20 s mean since before, at one width (the paper's way)"
#: Of what is reported as ours.
EARLIER, KIND, FIRST_MET = "history+class", "class", "class+item"
#: The strongest learner on the same numbers, by references.
TREES = {
    names: f"boosted trees against {names.replace('+', ' and ')}, 2.5 s"
    for names in (KIND, EARLIER)
}
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


def model_of(learned: Sequence[Examined], *, level: str) -> BruiseModel:
    """Learn a model of early readings."""
    sensors = len({one.sensor for one in learned})
    source = f"{len(learned)} simulated apples on {sensors} simulated sensors, level {level}"
    return learn_bruises([one.example(EARLY_S) for one in learned], learned_on=source)


#: Reference -> contrasts of every side to it, shape (sides, 17).
Felt: TypeAlias = Mapping[str, FloatArray]


def felt_of(examined: Sequence[Examined]) -> Felt:
    """Return what one grasp of each side is judged by."""
    examples = [one.example(EARLY_S) for one in examined]
    return {
        name: np.array([contrast(one.shape, one.against[name]) for one in examples])
        for name in REFERENCES
        if all(name in one.against for one in examples)
    }


def log_odds(felt: Felt, model: BruiseModel, names: str) -> FloatArray:
    """Return the log odds of every side against some references."""
    return model.judges[names].log_odds(_numbers(felt, names))


def _numbers(felt: Felt, names: str) -> FloatArray:
    return np.concatenate([felt[name] for name in names.split("+")], axis=1)


def score_all(
    tested: Sequence[Examined], model: BruiseModel, *, learned: Sequence[Examined]
) -> dict[str, Scored]:
    """Return the scores of every way on the test apples; way -> scores."""
    change = [
        one.presses["same_width"].mean_percent - one.presses["before"].mean_percent
        for one in tested
    ]
    felt, known = felt_of(tested), felt_of(learned)
    bruised = [one.bruised for one in learned]
    scores = {
        SAME_WIDTH: np.array(change),
        **{way(names): log_odds(felt, model, names) for names in (EARLIER, KIND, "item")},
        **{
            name: _by_trees(_numbers(known, names), bruised, _numbers(felt, names))
            for names, name in TREES.items()
        },
    }
    return {name: scored(tested, score) for name, score in scores.items()}


def _by_trees(learned: FloatArray, bruised: Sequence[bool], tested: FloatArray) -> FloatArray:
    """Learn boosted trees, one setting, not tuned, and return a score for each tested side."""
    with needing("the study of bruises", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingClassifier
    trees = HistGradientBoostingClassifier(
        max_iter=300, learning_rate=0.05, max_leaf_nodes=15, random_state=0
    )
    return np.asarray(trees.fit(learned, bruised).decision_function(tested))


def way(names: str) -> str:
    """Return the name of palpate's judgement against some references."""
    return f"ours against {names.replace('+', ' and ')}, {EARLY_S:g} s"


def scored(examined: Sequence[Examined], score: FloatArray) -> Scored:
    """Pair scores with the truth."""
    return Scored(
        bruised=np.array([one.bruised for one in examined]),
        score=score,
        sensors=[str(one.sensor) for one in examined],
    )
