"""Classifier of items from a table of grasps: kind, bruise, stage or grade.

The candidates are scikit-learn pipelines. Cross-validation over items chooses one of them. The
probabilities of the chosen pipeline are raised to a power (a temperature) that fits the held-out
items.

A background class for unknown items is optional: a normal distribution with twice the covariance of
all training items together. Its probability is the statistic of a conformal test (Vovk, Gammerman
and Shafer, Algorithmic Learning in a Random World, 2005). An item is unknown if too few held-out
training items have the same or a larger probability of the background class. At most the stated
fraction of items from the training distribution is rejected, whatever this distribution is.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError

#: Largest fraction of items of known labels that are rejected as unknown.
FALSE_REJECT = 0.05
#: Minimum number of items of a label, for an estimate of the scatter.
FEWEST_ITEMS = 3
UNKNOWN = "unknown"
#: Maximum number of cross-validation folds.
_FOLDS = 5
#: Covariance of the background class, as a multiple of the covariance of all training items.
_BACKGROUND_COVARIANCE = 2.0
#: Candidate powers for the probabilities.
_POWERS = np.geomspace(0.25, 4.0, 33)
#: Lower limit of a probability.
_LEAST_PROBABILITY = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedScore:
    """Accuracy on held-out items."""

    #: Number of items.
    items: int
    #: Fraction classified correctly, and the same for always choosing the most common label.
    right: float
    right_by_chance: float
    #: Mean of -ln of the probability of the true label.
    log_loss: float
    #: Mean probability of the chosen label minus the correct fraction: above 0 is optimistic.
    overconfidence: float
    #: True label -> chosen label -> items.
    confusion: Mapping[str, Mapping[str, int]]


class LabelLearner:
    """Classifier learned from a table with one row per grasp or per item.

    `allow_unknown`: whether to add the background class for unknown items.
    `methods`: names of the candidates in `METHODS`; by default all.

    After `fit`: `labels`, sorted; `fractions`, the fraction of rows of each label; `method`, the
    name of the chosen pipeline.

    >>> rng = np.random.default_rng(1)
    >>> kinds = 20 * ["egg", "grape"]
    >>> table = [rng.normal((3.8, 1.0) if kind == "egg" else (2.9, 1.0), 0.05) for kind in kinds]
    >>> known = LabelLearner(methods=("discriminant",)).fit(table, kinds)
    >>> known.predict([[3.8, 1.0], [5.5, 1.0]])
    ['egg', 'unknown']
    """

    def __init__(
        self,
        *,
        allow_unknown: bool = True,
        methods: Sequence[str] = (),
    ) -> None:
        self.allow_unknown = allow_unknown
        self._methods = tuple(methods) or METHODS
        self.labels: tuple[str, ...] = ()
        self.method = ""
        self.fractions: FloatArray = np.empty(0)

    def fit(
        self, table: ArrayLike, labels: Sequence[str], *, items: Sequence[str] | None = None
    ) -> LabelLearner:
        """Fit the classifier and return it.

        `table`, shape (n, features): finite numbers.
        `labels`: label of each row.
        `items`: item of each row; a split never separates rows of one item. By default each row is
            a separate item.
        The result depends neither on the order of the rows nor on the names of the items.
        Raises `InputError` if there are too few labels or items: without unknown items, two labels
        and more rows than labels are required; with unknown items, one label and `FEWEST_ITEMS`
        items per label. Raises `MissingExtraError` if scikit-learn is not installed.
        """
        row_items = [str(row) for row in range(len(labels))] if items is None else list(items)
        counts = Counter(label for _, label in set(zip(row_items, labels, strict=True)))
        if self.allow_unknown:
            few = {name: count for name, count in counts.items() if count < FEWEST_ITEMS}
            is_enough = bool(counts) and not few
            required = f"each label needs at least {FEWEST_ITEMS} labelled items with a grasp"
        else:
            few, is_enough = counts, 1 < len(counts) < len(labels)
            required = "at least two labels are required, one of them with two labelled items"
        if not is_enough:
            found = ", ".join(f"{name} {count}" for name, count in sorted(few.items()))
            raise InputError(
                f"{required}; found {found or 'none'}; label more: palpate items NAME --set "
                "kind=KIND, or --say ABOUT=LABEL"
            )
        self.labels = tuple(sorted(counts))
        by_item: dict[str, list[tuple[list[float], int]]] = {}
        values = np.asarray(table, dtype=float).tolist()
        for item, value, label in zip(row_items, values, labels, strict=True):
            by_item.setdefault(item, []).append((value, self.labels.index(label)))
        # The folds depend on the order of the items: sorted by their content, it is always equal.
        ordered = sorted(sorted(rows) for rows in by_item.values())
        known = [(*row, place) for place, rows in enumerate(ordered) for row in rows]
        self._table, self._truth, self._items = map(np.array, zip(*known, strict=True))
        self.fractions = np.bincount(self._truth) / len(self._truth)
        self._splits = self._split(max(2, min(_FOLDS, *counts.values())))
        held_out = {name: self._cross_validate(name) for name in self._methods}
        self.method = min(held_out, key=lambda name: _log_loss(held_out[name], self._truth))
        self._power = min(
            _POWERS, key=lambda power: _log_loss(_temper(held_out[self.method], power), self._truth)
        )
        self._held_out = _temper(held_out[self.method], self._power)
        self._model = self._fit_model(self.method, np.arange(len(self._truth)))
        if self.allow_unknown:
            self._mixture = _NormalMixture(self._table, self._truth)
            self._held_out_background = np.empty(len(self._truth))
            for train, test in self._splits:
                mixture = _NormalMixture(self._table[train], self._truth[train])
                self._held_out_background[test] = mixture.background_probability(self._table[test])
        return self

    @property
    def items_missing(self) -> int:
        """Number of further labelled items that a rejection requires; 5 % requires 19 in total."""
        known = len(set(self._items.tolist()))
        return max(math.ceil(1.0 / FALSE_REJECT - 1e-9) - 1 - known, 0)

    def probabilities(self, table: ArrayLike) -> FloatArray:
        """Return the probability of each label, and of the background class as last column.

        `table`, shape (n, features). Without unknown items there is no background column.
        """
        rows = np.asarray(table, dtype=float)
        label_probability = _temper(self._predict(self._model, rows), self._power)
        if not self.allow_unknown:
            return label_probability
        background = self._mixture.background_probability(rows)[:, None]
        return np.concatenate([label_probability * (1.0 - background), background], axis=1)

    def typicality(self, table: ArrayLike) -> FloatArray:
        """Return the fraction of training rows that are at least as atypical, shape (n,)."""
        background = self._mixture.background_probability(np.asarray(table, dtype=float))
        at_least = np.count_nonzero(self._held_out_background >= background[:, None], axis=1)
        return np.asarray((1.0 + at_least) / (len(self._held_out_background) + 1.0))

    def predict(self, table: ArrayLike) -> list[str]:
        """Return the most probable label of each row, `UNKNOWN` for a rejected row."""
        best = np.argmax(self.probabilities(table)[:, : len(self.labels)], axis=1)
        rejected = self.typicality(table) <= FALSE_REJECT if self.allow_unknown else 0 * best
        return [
            UNKNOWN if is_unknown else self.labels[index]
            for index, is_unknown in zip(best, rejected, strict=True)
        ]

    def score(self) -> LearnedScore:
        """Return the cross-validated accuracy on the training items."""
        best = np.argmax(self._held_out, axis=1)
        right = float(np.mean(best == self._truth))
        pairs = Counter(zip(self._truth.tolist(), best.tolist(), strict=True))
        return LearnedScore(
            items=len(set(self._items.tolist())),
            right=right,
            right_by_chance=max(np.bincount(self._truth).tolist()) / len(self._truth),
            log_loss=_log_loss(self._held_out, self._truth),
            overconfidence=float(self._held_out.max(axis=1).mean()) - right,
            confusion={
                true: {chosen: pairs[i, k] for k, chosen in enumerate(self.labels) if pairs[i, k]}
                for i, true in enumerate(self.labels)
            },
        )

    def _split(self, folds: int) -> list[tuple[FloatArray, FloatArray]]:
        from sklearn.model_selection import StratifiedGroupKFold

        splitter = StratifiedGroupKFold(folds, shuffle=True, random_state=0)
        with warnings.catch_warnings():
            # A label of a single item is absent from one training fold; `_predict` handles this.
            warnings.simplefilter("ignore", UserWarning)
            return list(splitter.split(self._table, self._truth, self._items))

    def _fit_model(self, name: str, rows: Any) -> Any:
        """Return a pipeline fitted to some rows; None for one label or too few rows."""
        truth = self._truth[rows]
        if not 1 < len(np.unique(truth)) < len(truth):
            return None
        with warnings.catch_warnings():
            # For a label with a single row, shrinkage replaces the undefined covariance.
            warnings.filterwarnings("ignore", "Only one sample available", UserWarning)
            return make_pipeline(name).fit(self._table[rows], truth)

    def _predict(self, model: Any, table: FloatArray) -> FloatArray:
        probability = np.zeros((len(table), len(self.labels)))
        if model is None:
            probability[:] = 1.0 / len(self.labels)
        else:
            probability[:, model.classes_] = model.predict_proba(table)
        return probability

    def _cross_validate(self, name: str) -> FloatArray:
        """Return each row's probabilities from a pipeline trained without the row's item."""
        probability = np.empty((len(self._truth), len(self.labels)))
        for train, test in self._splits:
            probability[test] = self._predict(self._fit_model(name, train), self._table[test])
        return probability


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledTable:
    """Rows for training, and rows to classify (with an empty label)."""

    #: Names of the columns.
    features: tuple[str, ...]
    #: Feature values, shape (n_rows, n_features).
    rows: FloatArray
    #: Label and item of each row.
    labels: tuple[str, ...]
    items: tuple[str, ...]
    #: Labelled items without a row -> the missing feature.
    left_out: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    @classmethod
    def from_rows(
        cls,
        features: Sequence[str],
        rows: Sequence[tuple[ArrayLike, str, str]],
        *,
        left_out: Mapping[str, str] = MappingProxyType({}),
    ) -> LabelledTable:
        """Return a table from rows of (numbers, label, item)."""
        return cls(
            features=tuple(features),
            rows=np.array([numbers for numbers, _, _ in rows], dtype=float),
            labels=tuple(label for _, label, _ in rows),
            items=tuple(item for _, _, item in rows),
            left_out=left_out,
        )

    def learn(self, *, allow_unknown: bool = False, methods: Sequence[str] = ()) -> LabelLearner:
        """Learn from the labelled rows.

        Raises `InputError` if there are too few labelled rows; `MissingExtraError` if scikit-learn
        is not installed.
        """
        labelled = [index for index, label in enumerate(self.labels) if label]
        return LabelLearner(allow_unknown=allow_unknown, methods=methods).fit(
            self.rows[labelled],
            [self.labels[index] for index in labelled],
            items=[self.items[index] for index in labelled],
        )

    def find_unlabelled(self) -> list[int]:
        """Return the indices of the rows without a label."""
        return [index for index, label in enumerate(self.labels) if not label]


#: Candidates: linear discriminant, logistic regression, and boosted trees.
METHODS = ("discriminant", "logistic", "trees")


def make_pipeline(name: str) -> Any:
    """Return an unfitted scikit-learn pipeline by its name in `METHODS`.

    Raises `MissingExtraError` if scikit-learn is not installed.
    """
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline as join_steps
    from sklearn.preprocessing import StandardScaler

    return {
        "discriminant": lambda: join_steps(
            StandardScaler(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
        ),
        "logistic": lambda: join_steps(StandardScaler(), LogisticRegression(max_iter=5000)),
        "trees": lambda: HistGradientBoostingClassifier(
            max_iter=100, learning_rate=0.05, max_leaf_nodes=7, min_samples_leaf=5, random_state=0
        ),
    }[name]()


class _NormalMixture:
    """Normal distributions of the labels with a common covariance, and the background class."""

    def __init__(self, table: FloatArray, truth: Any) -> None:
        from sklearn.covariance import LedoitWolf

        known = np.unique(truth)
        self._scale = table.std(axis=0) + 1e-9
        rows = table / self._scale
        means = np.array([rows[truth == label].mean(axis=0) for label in known])
        within = LedoitWolf(assume_centered=True).fit(
            rows - means[np.searchsorted(known, truth)]
        ).covariance_ * (len(rows) / max(len(rows) - len(known), 1))
        background = _BACKGROUND_COVARIANCE * np.atleast_2d(np.cov(rows.T))
        background = background + 1e-9 * np.eye(rows.shape[1])
        self._components = [*((mean, within) for mean in means), (rows.mean(axis=0), background)]

    def background_probability(self, table: FloatArray) -> FloatArray:
        """Return the probability of the background class; all classes have equal priors."""
        from scipy.special import softmax
        from scipy.stats import multivariate_normal

        rows = table / self._scale
        log = [multivariate_normal(*one).logpdf(rows) for one in self._components]
        return np.asarray(softmax(np.atleast_2d(np.array(log).T), axis=1)[:, -1])


def _temper(probabilities: FloatArray, power: float) -> FloatArray:
    raised = np.maximum(probabilities, _LEAST_PROBABILITY) ** power
    return np.asarray(raised / raised.sum(axis=1, keepdims=True))


def _log_loss(probabilities: FloatArray, truth: Any) -> float:
    of_truth = probabilities[np.arange(len(truth)), truth]
    return float(-np.log(np.maximum(of_truth, _LEAST_PROBABILITY)).mean())
