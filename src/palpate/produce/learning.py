"""Labels of items, learned from a table of their grasps: kind, bruise, stage or grade.

One estimator serves every question. Its candidates are scikit-learn pipelines, and cross-validation
over items chooses among them. The chosen one's probabilities are raised to the power (a
temperature) that fits the items that it did not see.

In addition to the labels there may be "something else": a normal distribution as wide as all known
items together, twice their covariance. Its probability is the statistic of a conformal test (Vovk,
Gammerman and Shafer, Algorithmic Learning in a Random World, 2005): an item is unknown if too few
known items, each by a model that did not see it, are as unlike the labels. Of items like the known
ones it rejects no more than the stated fraction, whatever their distribution.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError, require_extra

#: Fraction of items of known labels that may be called unknown.
FALSE_REJECT = 0.05
#: A label needs this many items, or its scatter means nothing.
FEWEST_ITEMS = 3
UNKNOWN = "unknown"
#: Parts that are left out in turn.
_FOLDS = 5
#: "Something else" has this many times the covariance of all known items together.
_WIDE = 2.0
#: Probabilities are raised to a power within these bounds.
_POWERS = np.geomspace(0.25, 4.0, 33)
#: A probability is never called smaller than this.
_LEAST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedScore:
    """Accuracy of models on items left out of their training."""

    #: How many items.
    items: int
    #: Fraction named rightly, and that of always naming the most common label.
    right: float
    right_by_chance: float
    #: Mean of -ln of the probability given to the true label.
    log_loss: float
    #: Mean probability of the named label, less the fraction named rightly: above 0 is optimistic.
    overconfidence: float
    #: True label -> named label -> items.
    confusion: Mapping[str, Mapping[str, int]]


class LabelLearner:
    """Labels learned from a table with one row a grasp, or one row an item.

    `allow_unknown`: whether an item may be none of the labels.
    `methods`: names of the candidates in `METHODS`; by default all of them.

    After `fit`: `labels`, sorted; `fractions` of the rows that have them; `method`, the name of the
    chosen pipeline.

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
        """Learn; return itself.

        `table`, shape (n, features): finite numbers.
        `labels`: of each row.
        `items`: of each row; rows of one item are never on both sides of a split. By default each
            row is an item of its own.
        Raises `InputError` if there are fewer than two labels, or with strangers no label, or one
        with fewer than `FEWEST_ITEMS` items; `MissingExtraError` if scikit-learn is not installed.
        """
        of = [str(row) for row in range(len(labels))] if items is None else list(items)
        counts = Counter(label for _, label in set(zip(of, labels, strict=True)))
        least = FEWEST_ITEMS if self.allow_unknown else 1
        few = {name: count for name, count in counts.items() if count < least}
        if few or len(counts) < 2 - self.allow_unknown or len(labels) <= len(counts) > 1:
            held = ", ".join(f"{name} {count}" for name, count in sorted((few or counts).items()))
            raise InputError(
                f"each label needs at least {least} labelled item{'s' * (least > 1)} with a grasp"
                f"{', one of them two, of two labels' * (not self.allow_unknown)}; found "
                f"{held or 'none at all'}; label more: palpate items NAME --set kind=KIND, or "
                "--say ABOUT=LABEL"
            )
        self.labels = tuple(sorted(counts))
        self._table = np.asarray(table, dtype=float)
        self._truth = np.array([self.labels.index(label) for label in labels])
        self.fractions = np.bincount(self._truth) / len(self._truth)
        self._items = np.unique(of, return_inverse=True)[1]
        self._splits = self._split(max(2, min(_FOLDS, *counts.values())))
        found = {name: self._leave_out(name) for name in self._methods}
        self.method = min(found, key=lambda name: _log_loss(found[name], self._truth))
        self._power = min(
            _POWERS, key=lambda power: _log_loss(_temper(found[self.method], power), self._truth)
        )
        self._held_out = _temper(found[self.method], self._power)
        self._model = self._fit_model(self.method, np.arange(len(self._truth)))
        if self.allow_unknown:
            self._normal = _Normal(self._table, self._truth)
            self._unlike = np.empty(len(self._truth))
            for seen, rest in self._splits:
                normal = _Normal(self._table[seen], self._truth[seen])
                self._unlike[rest] = normal.background_probability(self._table[rest])
        return self

    @property
    def items_missing(self) -> int:
        """Number of labelled items missing before an item can be unknown; 5 % needs 19."""
        known = len(set(self._items.tolist()))
        return max(math.ceil(1.0 / FALSE_REJECT - 1e-9) - 1 - known, 0)

    def probabilities(self, table: ArrayLike) -> FloatArray:
        """Return the probability of each label; with strangers, the background class last.

        `table`, shape (n, features).
        """
        rows = np.asarray(table, dtype=float)
        of_labels = _temper(self._predict(self._model, rows), self._power)
        if not self.allow_unknown:
            return of_labels
        unlike = self._normal.background_probability(rows)[:, None]
        return np.concatenate([of_labels * (1.0 - unlike), unlike], axis=1)

    def typicality(self, table: ArrayLike) -> FloatArray:
        """Return the fraction of known rows at least as atypical of the labels, shape (n,)."""
        unlike = self._normal.background_probability(np.asarray(table, dtype=float))
        as_unlike = np.count_nonzero(self._unlike >= unlike[:, None], axis=1)
        return np.asarray((1.0 + as_unlike) / (len(self._unlike) + 1.0))

    def predict(self, table: ArrayLike) -> list[str]:
        """Return the most probable label of each row, or `UNKNOWN` if it is rejected."""
        best = np.argmax(self.probabilities(table)[:, : len(self.labels)], axis=1)
        rejected = self.typicality(table) <= FALSE_REJECT if self.allow_unknown else 0 * best
        return [
            UNKNOWN if stranger else self.labels[index]
            for index, stranger in zip(best, rejected, strict=True)
        ]

    def score(self) -> LearnedScore:
        """Return the accuracy of names given to known rows, with their items held out."""
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
                true: {named: pairs[i, k] for k, named in enumerate(self.labels) if pairs[i, k]}
                for i, true in enumerate(self.labels)
            },
        )

    def _split(self, folds: int) -> list[tuple[FloatArray, FloatArray]]:
        with require_extra("learning from labels", extra="produce"):
            from sklearn.model_selection import StratifiedGroupKFold
        parts = StratifiedGroupKFold(folds, shuffle=True, random_state=0)
        with warnings.catch_warnings():
            # A label of one item is missing where that is left out; `_predict` allows for it.
            warnings.simplefilter("ignore", UserWarning)
            return list(parts.split(self._table, self._truth, self._items))

    def _fit_model(self, name: str, rows: Any) -> Any:
        """Return a pipeline fitted to some rows; None for one label or too few rows."""
        truth = self._truth[rows]
        if not 1 < len(np.unique(truth)) < len(truth):
            return None
        with warnings.catch_warnings():
            # The covariance of a single row, which shrinkage replaces by that of the others.
            warnings.filterwarnings("ignore", "Only one sample available", UserWarning)
            return make_pipeline(name).fit(self._table[rows], truth)

    def _predict(self, model: Any, table: FloatArray) -> FloatArray:
        found = np.zeros((len(table), len(self.labels)))
        if model is None:
            found[:] = 1.0 / len(self.labels)
        else:
            found[:, model.classes_] = model.predict_proba(table)
        return found

    def _leave_out(self, name: str) -> FloatArray:
        """Return each row's probabilities from a pipeline trained without its item."""
        found = np.empty((len(self._truth), len(self.labels)))
        for seen, rest in self._splits:
            found[rest] = self._predict(self._fit_model(name, seen), self._table[rest])
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledTable:
    """Training rows, and rows to classify, whose label is empty."""

    #: Names of the columns.
    features: tuple[str, ...]
    #: Shape (n_rows, n_features).
    rows: FloatArray
    #: Of each row.
    labels: tuple[str, ...]
    items: tuple[str, ...]

    @classmethod
    def of(
        cls, features: Sequence[str], rows: Sequence[tuple[ArrayLike, str, str]]
    ) -> LabelledTable:
        """Combine rows of numbers, label and item."""
        return cls(
            features=tuple(features),
            rows=np.array([numbers for numbers, _, _ in rows], dtype=float),
            labels=tuple(label for _, label, _ in rows),
            items=tuple(item for _, _, item in rows),
        )

    def learn(self, *, allow_unknown: bool = False, methods: Sequence[str] = ()) -> LabelLearner:
        """Learn from the labelled rows.

        Raises `InputError` if there are too few; `MissingExtraError` if scikit-learn is not
        installed.
        """
        known = [index for index, label in enumerate(self.labels) if label]
        return LabelLearner(allow_unknown=allow_unknown, methods=methods).fit(
            self.rows[known],
            [self.labels[index] for index in known],
            items=[self.items[index] for index in known],
        )

    def find_unlabelled(self) -> list[int]:
        """Return the numbers of the rows without a label."""
        return [index for index, label in enumerate(self.labels) if not label]


#: Candidates: linear discriminant, logistic regression, and boosted trees.
METHODS = ("discriminant", "logistic", "trees")


def make_pipeline(name: str) -> Any:
    """Return a scikit-learn pipeline by its name in `METHODS`, not fitted.

    Raises `MissingExtraError` if scikit-learn is not installed.
    """
    with require_extra("learning from labels", extra="produce"):
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.ensemble import HistGradientBoostingClassifier
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline as in_line
        from sklearn.preprocessing import StandardScaler
    return {
        "discriminant": lambda: in_line(
            StandardScaler(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
        ),
        "logistic": lambda: in_line(StandardScaler(), LogisticRegression(max_iter=5000)),
        "trees": lambda: HistGradientBoostingClassifier(
            max_iter=100, learning_rate=0.05, max_leaf_nodes=7, min_samples_leaf=5, random_state=0
        ),
    }[name]()


class _Normal:
    """Labels as normal distributions of one covariance, and a wide background class."""

    def __init__(self, table: FloatArray, truth: Any) -> None:
        with require_extra("learning from labels", extra="produce"):
            from sklearn.covariance import LedoitWolf
        known = np.unique(truth)
        self._scale = table.std(axis=0) + 1e-9
        rows = table / self._scale
        means = np.array([rows[truth == label].mean(axis=0) for label in known])
        within = LedoitWolf(assume_centered=True).fit(
            rows - means[np.searchsorted(known, truth)]
        ).covariance_ * (len(rows) / max(len(rows) - len(known), 1))
        wide = _WIDE * np.atleast_2d(np.cov(rows.T)) + 1e-9 * np.eye(rows.shape[1])
        self._parts = [(mean, within) for mean in means] + [(rows.mean(axis=0), wide)]

    def background_probability(self, table: FloatArray) -> FloatArray:
        """Return the probability of the background class, with the prior of any label."""
        from scipy.special import softmax
        from scipy.stats import multivariate_normal

        rows = table / self._scale
        log = [multivariate_normal(*part).logpdf(rows) for part in self._parts]
        return np.asarray(softmax(np.atleast_2d(np.array(log).T), axis=1)[:, -1])


def _temper(probabilities: FloatArray, power: float) -> FloatArray:
    raised = np.maximum(probabilities, _LEAST) ** power
    return np.asarray(raised / raised.sum(axis=1, keepdims=True))


def _log_loss(probabilities: FloatArray, truth: Any) -> float:
    given = probabilities[np.arange(len(truth)), truth]
    return float(-np.log(np.maximum(given, _LEAST)).mean())
