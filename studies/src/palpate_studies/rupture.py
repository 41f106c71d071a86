"""The time to stop closing on a fruit: a grasp's limit and three baselines.

Settings of the methods are chosen on other fruit than those that are scored. The ridge sees all
that a closing curve shows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.damage import FOLDS, NOMINAL_RATE, DamageModel
from palpate.estimate.damage_learning import (
    FruitClosing,
    learn_damage,
    predict_at_half_load,
    read_closings,
    split,
)
from palpate.estimate.measurement import Measurement
from palpate_studies.baselines.full_input_learners import make_ridge
from palpate_studies.protocol.paired import compare
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.second.closings import other_closings

#: Half of the interval of a stiffness by load cell and encoder, as a share of it.
_EXACT = 0.01
#: Nominal rates of rupture at which methods are compared.
RATES = (0.01, 0.02, 0.03, 0.05, 0.075, 0.10)
#: Score of a fruit that ruptured before its first force level, below any other.
_LEAST_SCORE = -6.0
#: The ridge learns from states from this fraction of the rupture force on: before, all curves are
#: alike.
_FROM = 0.2
#: The latest stretch of a curve, mm, and the fraction of its force over which it is looked at
#: closely.
_LATEST_MM, _LATEST = 1.0, 0.7
#: In place of a slope or a roughness of nothing.
_LEAST = 1e-3
Learnt = TypeVar("Learnt")
Closings: TypeAlias = Sequence[FruitClosing]
#: Pairs of closings that are learned from and closings that are judged.
Splits: TypeAlias = Sequence[tuple[Closings, Closings]]


class ScoredClosing(NamedTuple):
    """A policy's estimated nearness to the limit, with the force at that moment."""

    force_n: FloatArray
    score: FloatArray


#: Scores closings by what was learned from others.
Scorer: TypeAlias = Callable[[FruitClosing], ScoredClosing]


class Policy(NamedTuple):
    """A way of stopping: its name, and what learns its score from training fruit."""

    name: str
    learn: Callable[[Closings], Scorer]


class Method(NamedTuple):
    """An applied policy: its scores along each closing, and the scores of its stops.

    `settings` has shape (closings, rates), chosen for each of `RATES` without that closing.
    """

    name: str
    scores: Sequence[ScoredClosing]
    settings: FloatArray


def report(
    *,
    curves: Annotated[
        Path | None, typer.Option(help="Closings until rupture.", metavar="CSV")
    ] = None,
    index: Annotated[Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")] = None,
    test_curves: Annotated[
        Path | None, typer.Option(help="Closings to test on; without, 5 folds.", metavar="CSV")
    ] = None,
    test_index: Annotated[
        Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")
    ] = None,
    second: SecondOption = False,
) -> StudyReport:
    """Stop closing on real fruit before it ruptures, at a nominal rate of rupture.

    Example: palpate study rupture --curves fruit.csv.gz --index fruit_index.csv
    """
    if (test_curves is None) != (test_index is None):
        raise InputError("--test-curves and --test-index go together; give both or neither")
    if second and curves is None and index is None:
        closings = other_closings()
    elif second or curves is None or index is None:
        raise InputError("give either --curves and --index or --second")
    else:
        closings = read_closings(curves, index)
    if test_curves is None or test_index is None:
        splits, how = split(closings), f"{FOLDS}-fold cross-validation"
    else:
        splits = [(closings, read_closings(test_curves, test_index))]
        how = f"learned from {index}, tested on {test_index}"
    tested = [closing for _, test in splits for closing in test]
    methods = [apply_shipped_limit(splits, known=known) for known in (True, False)]
    methods += [apply_policy(policy, splits) for policy in (CAP, RULE, RIDGE)]
    entries, compared = tradeoff(methods, closings=tested), compare_grips(methods, tested)
    return StudyReport(
        name="rupture",
        title="Stopping before rupture",
        provenance=(
            (
                "Simulated (second generator): fruit with a skin, of foam and of dough, each kind "
                "of two ripenesses that rupture at a deformation of their own whatever the "
                "stiffness"
                if second
                else "Real recordings of fruit closed on until rupture"
            )
            + f"; {how}.",
            "`ours` is `DamageModel.bound_n`, the limit that a grasp obeys, at the nominal rate as "
            "it is; every sample used precedes the decision. Each other method's setting is chosen "
            "for the rate on the training fruit (a rank of scores by models fitted without each "
            "fruit); the rate that it then has on the tested fruit is next to it.",
            "Stiffness rule: a line per fruit fitted to the training fruit, with our stiffness. "
            "Ridge: force over rupture force from ten features of the curve so far; one for each "
            "fruit.",
        ),
        tables=[
            Table.wide(
                "Firmness (mean stop force / rupture force) and fruit ruptured, by nominal rate",
                [row | {"rate": f"{row['rate_limit']:.1%}"} for row in entries],
                {"fruit": "{fruit}", "method": "{method}"},
                over="rate",
                form="{firmness:.2f} ({ruptured} of {grasps})",
            ),
            Table.of(
                "Ours less each rival: grip lost, a rupture counted as all of it (90 % interval)",
                compared,
                ("rival", "rate_limit", "difference", "low", "high", "verdict"),
            ),
        ],
        payload={
            "second_generator": second,
            "nominal_rate": NOMINAL_RATE,
            "rows": [
                row for training, test in splits for row in _predict_stop(training, test=test)
            ],
            "tradeoff": entries,
            "compared": compared,
        },
    )


command = as_command(report)


def _predict_stop(training: Closings, *, test: Closings) -> list[dict[str, Any]]:
    """Return what is predicted for each fruit at half load, and where its limit stops."""
    model = learn_damage(training)
    rows = []
    for one in test:
        half = predict_at_half_load(one, model=model, kind=one.fruit)
        scored = score_by_shipped_limit(one, model=model, kind_known=True)
        rupture_n = one.rupture_force_n
        stop_n = float(stop_forces(scored, rupture_n, at=np.array([NOMINAL_RATE]))[0])
        rows.append(
            {
                "grasp_id": one.grasp_id,
                "fruit": one.fruit,
                "rupture_force_n": rupture_n,
                "predicted_n": half and half.predicted_n,
                "low_n": half and half.low_n,
                "stop_force_n": stop_n,
                "ruptured": stop_n >= rupture_n,
            }
        )
    return rows


def apply_shipped_limit(splits: Splits, *, known: bool) -> Method:
    """Return the limit of a grasp at each nominal rate, without any fit."""
    scores = list[ScoredClosing]()
    for training, test in splits:
        model = learn_damage(training, by_kind=known)
        scores += [score_by_shipped_limit(one, model=model, kind_known=known) for one in test]
    name = "ours" if known else "ours, fruit unknown"
    return Method(name, scores, np.tile(RATES, (len(scores), 1)))


def score_by_shipped_limit(
    closing: FruitClosing, *, model: DamageModel, kind_known: bool
) -> ScoredClosing:
    """Return the fraction of fruit damaged at each force, by the limit of a grasp.

    A grasp stops below `DamageModel.bound_n`; the share reaches the nominal rate at that force.
    """
    kind = closing.fruit if kind_known else ""
    shares = []
    for state in closing.states:
        # The load cell shows the stiffness well.
        value = float(np.exp(state.log_stiffness))
        low, high = value / (1 + _EXACT), value * (1 + _EXACT)
        measured = Measurement(value=value, low=low, high=high, unit="n_per_mm")
        shares.append(model.damage_rate(state.force_n, measured, kind=kind))
    return ScoredClosing(closing.force_n, np.array(shares))


def stop_forces(scored: ScoredClosing, rupture_force_n: float, *, at: FloatArray) -> FloatArray:
    """Return where a closing stops when its score first reaches each of some settings.

    N, as many as settings; the rupture force where it didn't stop in time.
    """
    first = np.searchsorted(np.maximum.accumulate(scored.score), at)
    return np.asarray(np.append(scored.force_n, rupture_force_n)[first])


def _by_kind(
    training: Closings, learn: Callable[[Closings], Learnt]
) -> Callable[[FruitClosing], Learnt]:
    """Learn something of each kind of fruit; return what gives that of a closing's kind."""
    learned = {
        fruit: learn([closing for closing in training if closing.fruit == fruit])
        for fruit in dict.fromkeys(closing.fruit for closing in training)
    }

    def of(closing: FruitClosing) -> Learnt:
        if closing.fruit not in learned:
            raise InputError(f"no {closing.fruit} to learn from, but {closing.grasp_id} is one")
        return learned[closing.fruit]

    return of


def _forces_n(closing: FruitClosing) -> FloatArray:
    return np.array([state.force_n for state in closing.states])


def learn_cap(training: Closings) -> Scorer:
    """Learn the cap per fruit: force as a share of the fruit's median rupture force."""
    median_n = _by_kind(
        training, lambda mine: float(np.median([closing.rupture_force_n for closing in mine]))
    )
    return lambda closing: ScoredClosing(closing.force_n, _forces_n(closing) / median_n(closing))


def learn_rule(training: Closings) -> Scorer:
    """Learn the linear stiffness rule: force as a share of what the rule predicts.

    Rupture force = intercept + slope x stiffness, the stiffness as it is at half load.
    """

    def fit(mine: Closings) -> FloatArray:
        stiffness, limits_n = [], []
        for closing in mine:
            reached = [s for s in closing.states if s.force_n >= closing.rupture_force_n / 2]
            if reached:
                stiffness.append(np.exp(reached[0].log_stiffness))
                limits_n.append(closing.rupture_force_n)
        return np.polyfit(stiffness, limits_n, 1)

    line = _by_kind(training, fit)

    def score(closing: FruitClosing) -> ScoredClosing:
        stiffness = np.exp([state.log_stiffness for state in closing.states])
        predicted_n = np.maximum(np.polyval(line(closing), stiffness), 0.1)
        return ScoredClosing(closing.force_n, _forces_n(closing) / predicted_n)

    return score


def learn_ridge(training: Closings) -> Scorer:
    """Learn force as a fraction of the rupture force, one ridge for each fruit.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """

    def fit(mine: Closings) -> Any:
        rows = np.concatenate([features(closing) for closing in mine])
        load = np.concatenate([closing.force_n / closing.rupture_force_n for closing in mine])
        used = load > _FROM
        return make_ridge().fit(rows[used], np.log(load[used]))

    trained = _by_kind([closing for closing in training if len(closing.states)], fit)

    def score(closing: FruitClosing) -> ScoredClosing:
        if not len(closing.states):
            return ScoredClosing(closing.force_n, np.zeros(0))
        return ScoredClosing(closing.force_n, np.exp(trained(closing).predict(features(closing))))

    return score


CAP = Policy("cap per fruit", learn_cap)
RULE = Policy("stiffness rule", learn_rule)
RIDGE = Policy("ridge", learn_ridge)
#: Features by samples: each closing is learned from in several folds.
_features = dict[bytes, FloatArray]()


def features(closing: FruitClosing) -> FloatArray:
    """Return what the curve up to each state shows, shape (n_states, 10).

    ln stiffness over the upper half of the force, and how the stiffness over the last 0.7, over the
    quarter below, and over the last millimetre differ from it; bend and roughness of that
    millimetre; the fraction of force that was lost again on the way; how finely it was sampled; the
    closure at which it began (the size of the fruit); ln force.
    """
    key = closing.samples.tobytes()
    if key not in _features:
        # The force rises, however noisy it is.
        risen = np.maximum.accumulate(closing.samples[:, 1])
        at = np.searchsorted(risen, closing.force_n) + 1
        rows = [
            _list_inputs(
                closing.samples[:count], log_stiffness=state.log_stiffness, force_n=state.force_n
            )
            for state, count in zip(closing.states, at.tolist(), strict=True)
        ]
        _features[key] = np.array(rows).reshape(-1, 10)
    return _features[key]


def _list_inputs(seen: FloatArray, *, log_stiffness: float, force_n: float) -> list[float]:
    closure_mm, rising_n = seen[:, 0], np.maximum.accumulate(seen[:, 1])

    def secant(low: float, high: float) -> float:
        """Return ln stiffness between two fractions of the force, less that of the upper half."""
        forces_n = np.maximum(np.array([low, high]) * force_n, rising_n[0])
        ends_mm = np.interp(forces_n, rising_n, closure_mm)
        if forces_n[1] < 1.03 * forces_n[0]:
            return 0.0
        return float(np.log(np.ptp(forces_n) / max(np.ptp(ends_mm), _LEAST))) - log_stiffness

    latest = seen[closure_mm >= closure_mm[-1] - _LATEST_MM]
    bend, slope, rough = 0.0, np.exp(log_stiffness), _LEAST
    if len(latest) > 5 and np.ptp(latest[:, 0]) > 0.3:
        x = latest[:, 0] - latest[:, 0].mean()
        slope = max(float(np.polyfit(x, latest[:, 1], 1)[0]), _LEAST)
        curve = np.polyfit(x, latest[:, 1], 2)
        bend = float(curve[0]) / slope
        rough = max(float(np.std(latest[:, 1] - np.polyval(curve, x))) / force_n, _LEAST)
    lost_n = -float(np.minimum(np.diff(seen[:, 1]), 0.0).sum())
    return [
        log_stiffness,
        secant(_LATEST, 1.0),
        secant(0.25, 0.5),
        float(np.log(slope)) - log_stiffness,
        float(np.clip(bend, -2.0, 2.0)),
        float(np.log(rough)),
        float(np.log1p(lost_n / force_n)),
        float(np.log((np.ptp(closure_mm) + 0.05) / len(seen))),
        float(closure_mm[0]),
        float(np.log(force_n)),
    ]


def apply_policy(policy: Policy, splits: Splits) -> Method:
    """Learn a policy and its settings on each training part; score the test part.

    Raises
    ------
    SeenBeforeError
        If a closing is in both parts.
    """
    scores, settings = list[ScoredClosing](), list[FloatArray]()
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
    """Return a recording's specimen: two files may use one name for two fruits."""
    return f"{closing.grasp_id} ({closing.rupture_force_n:g} N, {len(closing.samples)} samples)"


def critical_scores(policy: Policy, training: Closings) -> list[float]:
    """Return the largest score that each training fruit bore, by policies fitted without it."""
    return [
        max(scored.score.tolist(), default=_LEAST_SCORE)
        for inner, left_out in split(training)
        for scored in map(policy.learn(inner), left_out)
    ]


def settings_of(critical: Sequence[float]) -> FloatArray:
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


def stop_fractions(method: Method, closings: Closings) -> FloatArray:
    """Return the stop force over the rupture force, shape (closings, rates); 1 is a rupture."""
    rows = [
        stop_forces(scored, closing.rupture_force_n, at=at) / closing.rupture_force_n
        for scored, at, closing in zip(method.scores, method.settings, closings, strict=True)
    ]
    return np.array(rows)


def compare_grips(methods: Sequence[Method], closings: Closings) -> list[dict[str, Any]]:
    """Return the first method against every other at each nominal rate, paired by fruit.

    The loss of a fruit is what the grip falls short of its rupture force, as a share, and 1 where
    it ruptured: a firm grip that ruptures gains nothing.
    """
    lost = {
        method.name: np.where(found >= 1, 1.0, 1.0 - found)
        for method in methods
        for found in [stop_fractions(method, closings)]
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


def tradeoff(methods: Sequence[Method], *, closings: Closings) -> list[dict[str, Any]]:
    """Report the grip and the actual rupture rate of each method at each nominal rate.

    Parameters
    ----------
    methods : sequence of Method
    closings : sequence of FruitClosing
        Those that the scores belong to.

    Returns
    -------
    list of dict
        ``fruit`` (or "all"), ``method``, ``rate_limit`` (nominal), ``setting`` (median over the
        parts), ``ruptured``, ``grasps``, ``rupture_rate``, and ``firmness``: mean stop force as a
        share of the rupture force, 1 for one that ruptured.
    """
    shares = {method.name: stop_fractions(method, closings) for method in methods}
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
                        "firmness": float(of_chosen[:, column].mean()),
                    }
                )
    return entries
