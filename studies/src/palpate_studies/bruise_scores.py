"""How well bruised sides are distinguished from sound ones: every way on the same grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from scipy.stats import rankdata

from palpate.arrays import FloatArray
from palpate.errors import needing
from palpate.produce.bruise.model import REFERENCES, BruiseModel, learn_bruises
from palpate.produce.bruise.shape import contrast, finger_contrast, slopes
from palpate_studies.bootstrap import bootstrap_interval
from palpate_studies.bruise_data import CUTOFFS_S, EARLY_S, SIDES_AROUND, Examined
from palpate_studies.protocol.paired import Difference, IntArray, drawn_difference

#: Ways that need no learning: the paper's mean over all pixels after 20 s.
THRESHOLD = "threshold on the 20 s mean"
CHANGE = "change of the 20 s mean since before, closed by contact"
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


def models_of(learned: Sequence[Examined], *, level: str) -> dict[float, BruiseModel]:
    """Learn a model for each cut-off."""
    sensors = len({one.sensor for one in learned})
    source = f"{len(learned)} simulated apples on {sensors} simulated sensors, level {level}"
    return {
        cutoff_s: learn_bruises([one.example(cutoff_s) for one in learned], learned_on=source)
        for cutoff_s in CUTOFFS_S
    }


#: Reference -> contrasts of every side to it, shape (sides, 17).
Felt: TypeAlias = Mapping[str, FloatArray]


def felt_of(
    examined: Sequence[Examined], *, cutoff_s: float = EARLY_S, press_name: str = "now"
) -> Felt:
    """Return what one grasp of each side is judged by."""
    examples = [one.example(cutoff_s, press_name=press_name) for one in examined]
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
    tested: Sequence[Examined],
    models: Mapping[float, BruiseModel],
    *,
    learned: Sequence[Examined],
) -> dict[str, Scored]:
    """Return the scores of every way on the test apples; way -> scores."""
    means = {
        name: np.array([one.presses[name].mean_percent for one in tested])
        for name in ("before", "now", "same_width")
    }
    scores = {
        THRESHOLD: means["now"],
        CHANGE: means["now"] - means["before"],
        SAME_WIDTH: means["same_width"] - means["before"],
    }
    felt = {cutoff_s: felt_of(tested, cutoff_s=cutoff_s) for cutoff_s in CUTOFFS_S}
    again = felt_of(tested, press_name="again")
    for size in range(1, len(REFERENCES) + 1):
        for chosen in combinations(REFERENCES, size):
            names = "+".join(chosen)
            scores[way(names, EARLY_S)] = log_odds(felt[EARLY_S], models[EARLY_S], names)
    for names in (KIND, EARLIER):
        for cutoff_s in CUTOFFS_S:
            scores[way(names, cutoff_s)] = log_odds(felt[cutoff_s], models[cutoff_s], names)
        both = [log_odds(one, models[EARLY_S], names) for one in (felt[EARLY_S], again)]
        scores[f"{way(names, EARLY_S)}, two grasps"] = np.mean(both, axis=0)
    known, bruised = felt_of(learned), [one.bruised for one in learned]
    for names, name in TREES.items():
        scores[name] = _by_trees(_numbers(known, names), bruised, _numbers(felt[EARLY_S], names))
    return {name: scored(tested, score) for name, score in scores.items()}


def _by_trees(learned: FloatArray, bruised: Sequence[bool], tested: FloatArray) -> FloatArray:
    """Learn boosted trees, one setting, not tuned, and return a score for each tested side."""
    with needing("the study of bruises", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingClassifier
    trees = HistGradientBoostingClassifier(
        max_iter=300, learning_rate=0.05, max_leaf_nodes=15, random_state=0
    )
    return np.asarray(trees.fit(learned, bruised).decision_function(tested))


def way(names: str, cutoff_s: float) -> str:
    """Return how one of our ways is called."""
    return f"ours against {names.replace('+', ' and ')}, {cutoff_s:g} s"


def scored(examined: Sequence[Examined], score: FloatArray) -> Scored:
    """Pair scores with the truth."""
    return Scored(
        bruised=np.array([one.bruised for one in examined]),
        score=score,
        sensors=[str(one.sensor) for one in examined],
    )


def around(examined: Sequence[Examined], model: BruiseModel) -> Scored:
    """Return the scores of apples whose bruised side nobody knows: their most suspicious one."""
    each = [
        log_odds(felt_of(examined, press_name=str(turn)), model, FIRST_MET)
        for turn in range(SIDES_AROUND)
    ]
    return scored(examined, np.max(each, axis=0))


def locate(examined: Sequence[Examined], model: BruiseModel) -> dict[str, float] | None:
    """Return how often the finger is right, and the error of the place on the right finger.

    `spread_mm` is how far off it would be if the middle of the finger were always named. None where
    too few were learned from to name places.
    """
    if "history" not in model.locators:
        return None
    locator, right, off_mm, spread_mm = model.locators["history"], [], [], []
    for one in examined:
        if one.place is None:
            continue
        example = one.example(EARLY_S)
        reference = example.against["history"]
        second = locator.finger.log_odds(finger_contrast(example.shape, reference)) > 0
        right.append(second == (one.place.finger == 1))
        sign = 1 - 2 * one.place.finger
        found_mm = sign * slopes(example.shape, reference) * np.array(locator.mm_per_slope)
        true_mm = np.array([one.place.along_mm, one.place.across_mm])
        off_mm.append(float(np.hypot(*(found_mm - true_mm))))
        spread_mm.append(float(np.hypot(*true_mm)))
    return {
        "bruised": len(right),
        "finger_right": float(np.mean(right)),
        "median_off_mm": float(np.median(off_mm)),
        "median_spread_mm": float(np.median(spread_mm)),
    }
