"""Identification: probabilities of the kinds that were taught, and whether it is any of them.

Each kind is a normal distribution in the logarithms of size and stiffness, learned from few items:
so its predictive distribution is Student's t, and every covariance is shrunk towards what all kinds
share. The error of the item's own measurement is added to the kind's scatter, so that a wide
interval spreads the probability instead of moving it.

Part of a measurement's error comes again with each grasp by the same calibration. Items that were
taught with several grasps show how large the other part is; only that part shrinks as grasps are
averaged. Under the calibration of the taught items the common part shifted those alike, and drops
out; under another one it counts in full.

In addition to the kinds there is "something else": as probable beforehand as any of them, and
spread wide over all that was taught. So an item at the edge of a kind, where no other kind is, is
not taken for certain.

"Unknown" is a conformal test (Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World,
2005): an item's statistic is how usual it is for the kind that it fits best, and it is rejected if
too few taught items, each left out of its own kind in turn, are as unusual. Of items like those
taught, it rejects no more than the stated share, whatever their distribution.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.measurement import Measurement

#: Share of items of the taught kinds that may be called unknown.
FALSE_REJECT = 0.05
#: A kind's own covariance counts as its items, the one that all kinds share as this many.
_COMMON_ITEMS = 6.0
#: Share of a stated variance that differs from grasp to grasp: half, worth this many repeated
#: grasps, until repeated grasps show it; and never quite none.
_OWN_SHARE, _OWN_GRASPS, _LEAST_OWN_SHARE = 0.5, 4.0, 0.01
#: A kind needs this many items, or its scatter means nothing.
FEWEST_ITEMS = 3
#: "Something else" has this many times the covariance of all taught items together.
_WIDE = 2.0
#: Spread that is left to a kind whose items differ less than their measurements, log sd.
_LEAST_SD = 0.01

UNKNOWN = "unknown"


#: What distinguishes kinds for fingers driven by width, and for those driven by pressure, which
#: know neither mm nor N/mm: the pressure at contact, and the force gained per kPa from there on.
WIDTH_FEATURES = ("size_mm", "stiffness_n_per_mm")
PRESSURE_FEATURES = ("contact_kpa", "gain_n_per_kpa")


@dataclass(frozen=True, slots=True, kw_only=True)
class FeaturePoint:
    """One grasp in feature space."""

    #: Shape (n_features,). Natural logarithm of each quantity: a doubling counts alike wherever it
    #: happens.
    value: FloatArray
    #: Shape (n_features,). Standard deviation of a normal error in the logarithm with an interval
    #: as wide.
    sd: FloatArray
    #: Which calibration it was read by: grasps that share one share its error.
    calibration: str


def touch_of(
    measured: Mapping[str, Measurement], *, features: Sequence[str], calibration: str
) -> FeaturePoint | None:
    """Return a grasp as a point; None if a feature was not measured.

    >>> size = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    >>> touch = touch_of({"size_mm": size}, features=["size_mm"], calibration="monday")
    >>> touch.value.round(2).tolist(), touch.sd.round(3).tolist()
    ([3.69], [0.015])
    """
    found = [measured.get(name) for name in features]
    given = [one for one in found if one is not None and 0 < one.low <= one.middle <= one.high]
    if len(given) < len(features):
        return None
    return FeaturePoint(
        value=np.log([one.middle for one in given]),
        sd=np.array([_log_sd(one) for one in given]),
        calibration=calibration,
    )


def put_together(measured: Sequence[Measurement], *, own_share: float) -> Measurement:
    """Average one quantity over grasps; only the errors of their own shrink.

    `measured`: the same quantity of one item, grasp by grasp.
    `own_share`: share of the variance that differs from grasp to grasp; above 1 where sides differ
        more than measurements err.

    >>> sizes = [Measurement(value=v, low=v - 1, high=v + 1, unit="mm") for v in (39.0, 41.0)]
    >>> both = put_together(sizes, own_share=0.5)
    >>> both.value, round(both.high - both.value, 3)
    (40.0, 0.866)
    """
    count = len(measured)
    left = math.sqrt(own_share / count + max(1.0 - own_share, 0.0))
    value = float(np.mean([one.middle for one in measured]))
    down = float(np.sqrt(np.mean([(one.middle - one.low) ** 2 for one in measured])))
    up = float(np.sqrt(np.mean([(one.high - one.middle) ** 2 for one in measured])))
    return replace(measured[0], value=value, low=value - left * down, high=value + left * up)


def _log_sd(one: Measurement) -> float:
    return float(np.log(one.high / one.low)) / (2.0 * NormalDist().inv_cdf(0.5 + one.level / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class TaughtItem:
    """An item whose kind is known, with its grasps."""

    kind: str
    touches: tuple[FeaturePoint, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Felt:
    """Grasps of one item put together: their mean, and the variance that the mean still has."""

    value: FloatArray
    variance: FloatArray


@dataclass(frozen=True, slots=True)
class _Kind:
    """The predictive distribution of one kind: Student's t, less the measurement's own error."""

    mean: FloatArray
    scale: FloatArray
    freedom: float

    def distance(self, felt: _Felt) -> tuple[float, float]:
        """Return the squared Mahalanobis distance, and the log determinant that goes with it."""
        covariance = self.scale + np.diag(felt.variance)
        left = felt.value - self.mean
        return float(left @ np.linalg.solve(covariance, left)), float(
            np.linalg.slogdet(covariance)[1]
        )

    def log_density(self, felt: _Felt) -> float:
        """Return the log density, up to what all kinds share."""
        from scipy.special import gammaln

        squared, log_det = self.distance(felt)
        size, nu = felt.value.size, self.freedom
        norm = gammaln((nu + size) / 2) - gammaln(nu / 2) - size / 2 * np.log(nu)
        return float(norm - 0.5 * log_det - (nu + size) / 2 * np.log1p(squared / nu))

    def usual(self, felt: _Felt) -> float:
        """Return the share of this kind that would lie farther out, were it exactly so."""
        from scipy.special import fdtrc

        squared, _ = self.distance(felt)
        return float(fdtrc(felt.value.size, self.freedom, squared / felt.value.size))


class Identifier:
    """Kinds learned from labelled items.

    `taught`: items whose kind is known, all in the same features; those without a grasp are
        skipped.
    `false_reject`: share of items of the taught kinds that may be called unknown.

    `kinds`: what was taught.
    `own_share`, shape (n_features,): variance by which grasps of one item differ, in stated
        variances; above 1 where its sides differ more than measurements err.
    Raises `InputError` if a kind has fewer than `FEWEST_ITEMS` items, or there is no kind.

    >>> rng = np.random.default_rng(1)
    >>> def item(kind, ln_mm):
    ...     value = np.array([ln_mm + 0.05 * rng.standard_normal()])
    ...     touch = FeaturePoint(value=value, sd=np.array([0.02]), calibration="monday")
    ...     return TaughtItem(kind=kind, touches=(touch,))
    >>> taught = [item("egg", 3.8) for _ in range(15)] + [item("grape", 2.9) for _ in range(15)]
    >>> known = Identifier(taught)
    >>> known.identify(item("?", 3.8).touches).kind
    'egg'
    >>> known.identify(item("?", 4.6).touches).kind
    'unknown'
    """

    def __init__(self, taught: Sequence[TaughtItem], *, false_reject: float = FALSE_REJECT) -> None:
        self._taught = tuple(item for item in taught if item.touches)
        self.false_reject = false_reject
        counts = dict.fromkeys(sorted({item.kind for item in self._taught}), 0)
        for item in self._taught:
            counts[item.kind] += 1
        few = [f"{kind} {count}" for kind, count in counts.items() if count < FEWEST_ITEMS]
        if few or not counts:
            raise InputError(
                f"each kind needs at least {FEWEST_ITEMS} labelled items with a grasp; found "
                f"{', '.join(few) or 'none at all'}; label more: palpate items NAME --set kind=..."
            )
        self.kinds = tuple(counts)
        self.own_share = _own_share(self._taught)
        self._calibrations = {t.calibration for item in self._taught for t in item.touches}
        self._felt = [self._put_together(item.touches) for item in self._taught]
        self._common = self._common_covariance()
        self._model = {kind: self._kind(kind) for kind in self.kinds}
        self._else = self._something_else()

    @property
    def items_missing(self) -> int:
        """Labelled items still missing before anything can be called unknown; 5 % needs 19."""
        return max(math.ceil(1.0 / self.false_reject - 1e-9) - 1 - len(self._taught), 0)

    def identify(self, touches: Sequence[FeaturePoint]) -> Identity:
        """Identify an item from all its grasps.

        Raises `ValueError` if there is no grasp.
        """
        if not touches:
            raise ValueError("an item that was never grasped can't be identified")
        felt = self._put_together(touches)
        models = [*self._model.values(), self._else]
        log_density = np.array([model.log_density(felt) for model in models])
        weight = np.exp(log_density - log_density.max())
        share = (weight / weight.sum()).tolist()
        probability = dict(zip((*self.kinds, UNKNOWN), share, strict=True))
        statistic = max(self._model[kind].usual(felt) for kind in self.kinds)
        as_unusual = int(np.count_nonzero(self._left_out <= statistic))
        usual = (1 + as_unusual) / (len(self._taught) + 1)
        found = Identity(
            kind=UNKNOWN,
            probability=probability,
            usual=usual,
            rejected=usual <= self.false_reject,
            grasps=len(touches),
        )
        return found if found.rejected else replace(found, kind=found.best_guess)

    @cached_property
    def _left_out(self) -> FloatArray:
        """How usual each taught item is for the kind it fits best, left out of its own."""
        found = []
        for index, (item, felt) in enumerate(zip(self._taught, self._felt, strict=True)):
            others = [self._model[kind].usual(felt) for kind in self.kinds if kind != item.kind]
            found.append(max(self._kind(item.kind, without=index).usual(felt), *others, 0.0))
        return np.array(found)

    def _put_together(self, touches: Sequence[FeaturePoint]) -> _Felt:
        """Average grasps; only the errors of their own shrink."""
        variance = np.array([touch.sd**2 for touch in touches])
        foreign = np.array([touch.calibration not in self._calibrations for touch in touches])
        common = np.maximum(1.0 - self.own_share, 0.0) * variance * foreign[:, None]
        own = self.own_share * variance
        return _Felt(
            value=np.mean([touch.value for touch in touches], axis=0),
            variance=own.mean(axis=0) / len(touches) + common.mean(axis=0),
        )

    def _members(self, kind: str, *, without: int | None = None) -> list[_Felt]:
        pairs = enumerate(zip(self._taught, self._felt, strict=True))
        return [felt for index, (item, felt) in pairs if item.kind == kind and index != without]

    def _common_covariance(self) -> FloatArray:
        """Return the covariance within kinds, pooled over all."""
        parts = [_true_scatter(self._members(kind)) for kind in self.kinds]
        freedom = len(self._taught) - len(self.kinds)
        return _positive(np.sum(parts, axis=0) / freedom)

    def _kind(self, kind: str, *, without: int | None = None) -> _Kind:
        members = self._members(kind, without=without)
        count = len(members)
        freedom = count - 1 + _COMMON_ITEMS
        scatter = _true_scatter(members) + _COMMON_ITEMS * self._common
        return _Kind(
            mean=np.mean([felt.value for felt in members], axis=0),
            scale=_positive(scatter / freedom) * (1.0 + 1.0 / count),
            freedom=freedom,
        )

    def _something_else(self) -> _Kind:
        """Return the class that represents everything that nobody taught."""
        value = np.array([felt.value for felt in self._felt])
        return _Kind(
            mean=value.mean(axis=0),
            scale=_positive(_WIDE * np.atleast_2d(np.cov(value.T))),
            freedom=len(value) - 1.0,
        )


def _own_share(taught: Sequence[TaughtItem]) -> FloatArray:
    """Return by what share of the stated variance grasps of one item differ, per feature."""
    size = taught[0].touches[0].value.size
    seen, stated = np.zeros(size), np.zeros(size)
    freedom = 0
    for item in taught:
        for calibration in {touch.calibration for touch in item.touches}:
            same = [touch for touch in item.touches if touch.calibration == calibration]
            if len(same) > 1:
                seen += np.var([touch.value for touch in same], axis=0, ddof=1) * (len(same) - 1)
                stated += np.mean([touch.sd**2 for touch in same], axis=0) * (len(same) - 1)
                freedom += len(same) - 1
    ratio = seen / np.maximum(stated, 1e-12)
    share = (freedom * ratio + _OWN_GRASPS * _OWN_SHARE) / (freedom + _OWN_GRASPS)
    return np.asarray(np.maximum(share, _LEAST_OWN_SHARE))


def _true_scatter(members: Sequence[_Felt]) -> FloatArray:
    """Return the scatter matrix of a kind, less what its measurements add to it."""
    value = np.array([felt.value for felt in members])
    centred = value - value.mean(axis=0)
    added = np.mean([felt.variance for felt in members], axis=0)
    return np.asarray(centred.T @ centred - (len(members) - 1) * np.diag(added))


def _positive(covariance: FloatArray) -> FloatArray:
    """Return the nearest covariance with no direction narrower than the least spread."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.maximum(values, _LEAST_SD**2)) @ vectors.T)


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What an item is."""

    #: The most probable kind, or `UNKNOWN` if it is rejected.
    kind: str
    #: Of each kind that was taught, and of something else under `UNKNOWN`; the sum is 1.
    probability: Mapping[str, float]
    #: Share of the taught items that are at most as usual as this one: small for strangers.
    usual: float
    #: Whether it is unknown at the stated level.
    rejected: bool
    #: Grasps that went into it.
    grasps: int

    @property
    def confidence(self) -> float:
        """Probability of the kind that is named; for what is unknown, the level of the test."""
        return 1.0 - self.usual if self.rejected else self.probability[self.kind]

    @property
    def best_guess(self) -> str:
        """The most probable kind, whether it is rejected or not."""
        kinds = [kind for kind in self.probability if kind != UNKNOWN]
        return max(kinds, key=self.probability.__getitem__)


def as_labelled(kind: str) -> Identity:
    """Return what is known of an item whose kind a person gave.

    >>> as_labelled("kiwi").confidence
    1.0
    """
    sure = kind != UNKNOWN
    return Identity(
        kind=kind,
        probability={kind: 1.0},
        usual=1.0 if sure else 0.0,
        rejected=not sure,
        grasps=0,
    )
