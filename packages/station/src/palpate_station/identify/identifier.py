"""Identification of an item: probabilities of the labelled kinds, or rejection as unknown.

The features of an item are the means of ln size and ln stiffness over its grasps. The classifier is
`palpate_station.learning.LabelLearner`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from palpate.arrays import FloatArray
from palpate.measurement import Measurement, half_width_sds
from palpate_station.learning import FALSE_REJECT, UNKNOWN, LabelLearner

#: Quantities that distinguish kinds; fingers driven by pressure measure neither.
FEATURES = ("size_mm", "stiffness_n_per_mm")
#: Pipeline in `palpate_station.learning.METHODS`. On simulated crates no other is more accurate
#: (study sorting). Training takes 0.1 s.
METHODS = ("discriminant",)
#: Fraction of a measurement's variance that is independent between grasps (assumed).
_INDEPENDENT_FRACTION = 0.5
#: Level of the interval beyond which two grasps do not measure the same quantity.
_DIFFERENCE_LEVEL = 0.999


def grasp_features(measured: Mapping[str, Measurement]) -> FloatArray | None:
    """Return the logarithms of a grasp's `FEATURES`; None if one was not measured.

    >>> size = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    >>> stiffness = Measurement(value=2.0, low=1.5, high=2.5, unit="n_per_mm")
    >>> grasp_features({"size_mm": size, "stiffness_n_per_mm": stiffness}).round(2).tolist()
    [3.69, 0.69]
    """
    found = [measured.get(name) for name in FEATURES]
    values = [
        one.middle
        for one in found
        # The limits of a bound may be infinite.
        if one is not None and 0 < one.low <= one.middle <= one.high < math.inf
    ]
    return np.log(values) if len(values) == len(FEATURES) else None


def combine(measured: Sequence[Measurement]) -> Measurement:
    """Average a quantity of an item over grasps; half of the variance averages out.

    Grasps that differ beyond their combined 99.9 % interval are of a turned object that is not
    round, or of two objects: the interval then includes those of all grasps.

    >>> sizes = [Measurement(value=v, low=v - 1, high=v + 1, unit="mm") for v in (39.0, 41.0)]
    >>> both = combine(sizes)
    >>> both.value, round(both.high - both.value, 3)
    (40.0, 0.866)
    >>> other = Measurement(value=60.0, low=59.0, high=61.0, unit="mm")
    >>> both = combine([sizes[0], other])
    >>> both.low, both.high
    (38.0, 61.0)
    """
    factor = math.sqrt(_INDEPENDENT_FRACTION / len(measured) + 1.0 - _INDEPENDENT_FRACTION)
    value = float(np.mean([one.middle for one in measured]))
    below = float(np.sqrt(np.mean([(one.middle - one.low) ** 2 for one in measured])))
    above = float(np.sqrt(np.mean([(one.high - one.middle) ** 2 for one in measured])))
    low, high = value - factor * below, value + factor * above
    if any(_differ(one, other) for one, other in combinations(measured, 2)):
        low, high = min(one.low for one in measured), max(one.high for one in measured)
    return replace(measured[0], value=value, low=low, high=high)


def _differ(one: Measurement, other: Measurement) -> bool:
    """Return whether two measurements of a quantity differ beyond their combined interval."""
    smaller, larger = sorted((one, other), key=lambda each: each.middle)
    uncertainty = math.hypot(
        (smaller.high - smaller.middle) / half_width_sds(smaller.level),
        (larger.middle - larger.low) / half_width_sds(larger.level),
    )
    return larger.middle - smaller.middle > half_width_sds(_DIFFERENCE_LEVEL) * uncertainty


class Identifier:
    """Identifier of kinds, learned from labelled items.

    `training`: kind and grasps (`grasp_features`) of each training item; items without a grasp are
        skipped.
    `methods`: candidates, see `LabelLearner`.

    Raises `InputError` if a kind has fewer than three items, or there is no kind;
    `MissingExtraError` if scikit-learn is not installed.

    >>> rng = np.random.default_rng(1)
    >>> training = [("egg", [rng.normal((3.8, 2.5), 0.05)]) for _ in range(15)]
    >>> training += [("grape", [rng.normal((2.9, 0.0), 0.05)]) for _ in range(15)]
    >>> known = Identifier(training)
    >>> known.identify([np.array([3.8, 2.5])]).kind, known.identify([np.array([4.6, 0.0])]).kind
    ('egg', 'unknown')
    """

    def __init__(
        self,
        training: Sequence[tuple[str, Sequence[FloatArray]]],
        *,
        methods: Sequence[str] = METHODS,
    ) -> None:
        known = [(kind, np.mean(points, axis=0)) for kind, points in training if len(points)]
        self.learner = LabelLearner(methods=methods).fit(
            [point for _, point in known], [kind for kind, _ in known]
        )
        self.kinds = self.learner.labels

    def identify(self, points: Sequence[FloatArray]) -> Identity:
        """Identify an item from all its grasps.

        `points`: features of each grasp (`grasp_features`).
        Raises `ValueError` if there is no grasp.
        """
        if not points:
            raise ValueError("an item that was never grasped can't be identified")
        point = [np.mean(points, axis=0)]
        usual = float(self.learner.typicality(point)[0])
        found = Identity(
            kind=UNKNOWN,
            probability=dict(
                zip(
                    (*self.kinds, UNKNOWN),
                    self.learner.probabilities(point)[0].tolist(),
                    strict=True,
                )
            ),
            usual=usual,
            rejected=usual <= FALSE_REJECT,
            grasps=len(points),
        )
        return found if found.rejected else replace(found, kind=found.best_guess)


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """The kind of an item."""

    #: The most probable kind, or `UNKNOWN` if it is rejected.
    kind: str
    #: Probability of each labelled kind and of `UNKNOWN`; the sum is 1.
    probability: Mapping[str, float]
    #: Fraction of training items that are at least as atypical as this item.
    usual: float
    #: Whether the item is rejected as unknown (`FALSE_REJECT`).
    rejected: bool
    #: Number of grasps used.
    grasps: int

    @property
    def confidence(self) -> float:
        """Probability of the kind; for an unknown item, the confidence of the rejection."""
        return 1.0 - self.usual if self.rejected else self.probability[self.kind]

    @property
    def best_guess(self) -> str:
        """The most probable labelled kind, also for a rejected item."""
        kinds = [kind for kind in self.probability if kind != UNKNOWN]
        return max(kinds, key=self.probability.__getitem__)

    def rank_kinds(self, count: int, *, least: float) -> list[tuple[str, float]]:
        """Return name and probability of at most `count` kinds, most probable first.

        `least`: minimum probability.
        """
        ranked = sorted(self.probability.items(), key=lambda pair: -pair[1])[:count]
        return [("something else" if k == UNKNOWN else k, p) for k, p in ranked if p >= least]


def label_identity(kind: str) -> Identity:
    """Return the certain identity of a labelled item.

    >>> label_identity("kiwi").confidence
    1.0
    """
    is_known = kind != UNKNOWN
    return Identity(
        kind=kind,
        probability={kind: 1.0},
        usual=1.0 if is_known else 0.0,
        rejected=not is_known,
        grasps=0,
    )
