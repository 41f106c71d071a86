"""Methods that decide when to stop closing on a fruit, and how firm a grip each gives.

Their settings are chosen on other fruit than those that are scored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from palpate.estimate.damage import DamageModel
from palpate.estimate.damage_learning import FruitClosing, split
from palpate.estimate.measurement import Measurement
from palpate.estimate.strength import ClosingState
from palpate_studies.protocol.paired import compare
from palpate_studies.protocol.parts import Learned

#: Half of the interval of a stiffness by load cell and encoder, as a share of it.
_EXACT = 0.01
#: Nominal rates of rupture at which methods are compared.
RATES = (0.01, 0.02, 0.03, 0.05, 0.075, 0.10)
LEVEL = 0.9
#: Score of a fruit that ruptured before its first force level, below any other.
_LEAST_SCORE = -6.0
#: Pairs of closings that are learned from and closings that are judged.
Splits: TypeAlias = Sequence[tuple[Sequence[FruitClosing], Sequence[FruitClosing]]]


class Scored(NamedTuple):
    """How near the limit a policy thinks to be, with the force at which it came to think so."""

    force_n: NDArray[np.float64]
    score: NDArray[np.float64]


def shipped_scores(closing: FruitClosing, *, model: DamageModel, kind_known: bool) -> Scored:
    """Return the share of such fruit that each force would damage, as a grasp's limit has it.

    A grasp stops below `DamageModel.bound_n`; the share reaches the nominal rate at that force.
    """
    kind = closing.fruit if kind_known else ""
    shares = [
        model.rate_below(state.force_n, _measured(state), kind=kind) for state in closing.states
    ]
    return Scored(closing.force_n, np.array(shares))


def _measured(state: ClosingState) -> Measurement:
    """Return the stiffness of a curve as a measurement: the load cell shows it well."""
    value = float(np.exp(state.log_stiffness))
    low, high = value / (1 + _EXACT), value * (1 + _EXACT)
    return Measurement(value=value, low=low, high=high, unit="n_per_mm")


def cap_scores(closing: FruitClosing, *, median_n: float) -> Scored:
    """Score of the cap per fruit: force as a share of the fruit's median rupture force."""
    return Scored(closing.force_n, np.array([s.force_n for s in closing.states]) / median_n)


def rule_scores(closing: FruitClosing, *, line: tuple[float, float]) -> Scored:
    """Score of the linear stiffness rule: force as a share of what the rule predicts."""
    intercept_n, slope_mm = line
    stiffness = np.exp([state.log_stiffness for state in closing.states])
    predicted_n = np.maximum(intercept_n + slope_mm * stiffness, 0.1)
    force_n = np.array([state.force_n for state in closing.states])
    return Scored(closing.force_n, force_n / predicted_n)


def fit_rule(closings: Sequence[FruitClosing]) -> tuple[float, float]:
    """Fit rupture force = intercept + slope x stiffness, the stiffness as it is at half load."""
    stiffness, limits_n = [], []
    for closing in closings:
        reached = [s for s in closing.states if s.force_n >= closing.rupture_force_n / 2]
        if reached:
            stiffness.append(np.exp(reached[0].log_stiffness))
            limits_n.append(closing.rupture_force_n)
    slope, intercept = np.polyfit(stiffness, limits_n, 1)
    return float(intercept), float(slope)


def stop_forces(
    scored: Sequence[Scored],
    *,
    rupture_force_n: Sequence[float],
    at: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return where each closing stops when its score first reaches each setting.

    Parameters
    ----------
    scored : sequence of Scored, length n
        One per closing.
    rupture_force_n : sequence of float, length n
        What the fruit stood.
    at : ndarray, shape (n_settings,)
        Scores at which to stop.

    Returns
    -------
    ndarray, shape (n, n_settings)
        Force, N; the rupture force where it didn't stop in time.
    """
    stops = np.empty((len(scored), len(at)))
    for row, (one, limit_n) in enumerate(zip(scored, rupture_force_n, strict=True)):
        highest = np.maximum.accumulate(one.score)
        first = np.searchsorted(highest, at) if len(highest) else np.zeros(len(at), dtype=int)
        stops[row] = np.append(one.force_n, limit_n)[first]
    return stops


#: Scores closings by what was learned from others.
Scorer: TypeAlias = Callable[[FruitClosing], Scored]


class Policy(NamedTuple):
    """A way of stopping: its name, and what learns its score from training fruit."""

    name: str
    learn: Callable[[Sequence[FruitClosing]], Scorer]


class Method(NamedTuple):
    """A policy applied: its scores along each closing, and the scores at which it stops there.

    `settings` has shape (closings, rates), chosen for each of `RATES` without that closing.
    """

    name: str
    scores: Sequence[Scored]
    settings: NDArray[np.float64]


def applied(policy: Policy, splits: Splits) -> Method:
    """Learn a policy and choose its settings on each training part, and score the test part.

    Raises
    ------
    SeenBeforeError
        If a closing is in both parts.
    """
    scores, settings = list[Scored](), list[NDArray[np.float64]]()
    for training, test in splits:
        chosen = Learned(
            found=settings_of(critical_scores(policy, training)),
            seen=frozenset(map(specimen, training)),
        )
        scorer, at = policy.learn(training), chosen.on(map(specimen, test))
        scores += [scorer(closing) for closing in test]
        settings += [at] * len(test)
    return Method(policy.name, scores, np.array(settings))


def specimen(closing: FruitClosing) -> str:
    """Return what a recording is known by: two files may use one name for two fruits."""
    return f"{closing.grasp_id} ({closing.rupture_force_n:g} N, {len(closing.samples)} samples)"


def critical_scores(policy: Policy, training: Sequence[FruitClosing]) -> list[float]:
    """Return the largest score that each training fruit bore, by policies fitted without it."""
    return [
        max(scored.score.tolist(), default=_LEAST_SCORE)
        for inner, left_out in split(training)
        for scored in map(policy.learn(inner), left_out)
    ]


def settings_of(critical: Sequence[float]) -> NDArray[np.float64]:
    """Return the score at which to stop for each nominal rate, by conformal prediction.

    The k-th smallest critical score of n promises a rate of at most k / (n + 1) on fruit like
    these; with too few of them the setting lies below the smallest.

    Examples
    --------
    >>> settings_of(list(range(1, 100)))[[0, 3]].tolist()
    [1.0, 5.0]
    """
    ordered = np.sort(critical)
    ranks = np.floor(np.array(RATES) * (len(ordered) + 1)).astype(int)
    found = ordered[np.minimum(np.maximum(ranks, 1), len(ordered)) - 1]
    return np.asarray(np.where(ranks == 0, np.nextafter(found, -np.inf), found))


def stops(method: Method, closings: Sequence[FruitClosing]) -> NDArray[np.float64]:
    """Return the stop force over the rupture force, shape (closings, rates); 1 is a rupture."""
    rows = [
        stop_forces([scored], rupture_force_n=[closing.rupture_force_n], at=at)[0]
        / closing.rupture_force_n
        for scored, at, closing in zip(method.scores, method.settings, closings, strict=True)
    ]
    return np.array(rows)


def compare_grips(
    methods: Sequence[Method], closings: Sequence[FruitClosing]
) -> list[dict[str, Any]]:
    """Return the first method against every other at each nominal rate, paired by fruit.

    The loss of a fruit is what the grip falls short of its rupture force, as a share, and 1 where
    it ruptured: a firm grip that ruptures gains nothing.
    """
    lost = {
        method.name: np.where(found >= 1, 1.0, 1.0 - found)
        for method in methods
        for found in [stops(method, closings)]
    }
    names = [specimen(closing) for closing in closings]
    return [
        row
        for column, rate in enumerate(RATES)
        for row in compare(
            {name: each[:, column] for name, each in lost.items()},
            names,
            ours=methods[0].name,
            statistic=np.mean,
            rate_limit=rate,
        )
    ]


def tradeoff(
    methods: Sequence[Method], *, closings: Sequence[FruitClosing]
) -> list[dict[str, Any]]:
    """Report the grip of each method at each nominal rate of rupture, and the rate it had.

    Parameters
    ----------
    methods : sequence of Method
    closings : sequence of FruitClosing
        Those that the scores belong to.

    Returns
    -------
    list of dict
        ``fruit`` (or "all"), ``method``, ``rate_limit`` (nominal), ``setting`` (median over the
        parts), ``ruptured``, ``grasps``, ``rupture_rate`` with its binomial 90 % bounds
        ``rate_low`` and ``rate_high`` (Clopper and Pearson), and ``firmness``: mean stop force as
        a share of the rupture force, 1 for one that ruptured.
    """
    shares = {method.name: stops(method, closings) for method in methods}
    entries = []
    for fruit in [*sorted({closing.fruit for closing in closings}), "all"]:
        chosen = [i for i, closing in enumerate(closings) if fruit in ("all", closing.fruit)]
        for method in methods:
            of_chosen = shares[method.name][chosen]
            for column, rate in enumerate(RATES):
                ruptured = int(np.sum(of_chosen[:, column] >= 1))
                entries.append(
                    {
                        "fruit": fruit,
                        "method": method.name,
                        "rate_limit": rate,
                        "setting": float(np.median(method.settings[chosen, column])),
                        "grasps": len(chosen),
                        "ruptured": ruptured,
                        "rupture_rate": ruptured / len(chosen),
                        **_bounds(ruptured, len(chosen)),
                        "firmness": float(of_chosen[:, column].mean()),
                    }
                )
    return entries


def _bounds(count: int, total: int) -> dict[str, float]:
    tail = (1 - LEVEL) / 2
    low = beta.ppf(tail, count, total - count + 1) if count else 0.0
    high = beta.ppf(1 - tail, count + 1, total - count) if count < total else 1.0
    return {"rate_low": float(low), "rate_high": float(high)}
