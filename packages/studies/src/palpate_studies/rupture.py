"""Stopping before rupture: palpate's damage limit compared with three baselines.

The settings of the baselines are chosen on training fruit, which are not scored. The inputs of the
ridge describe the whole closing curve so far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.measurement import Measurement
from palpate.object.damage import FOLDS, NOMINAL_RATE, DamageModel
from palpate.object.damage_learning import (
    FruitClosing,
    learn_damage,
    predict_at_half_load,
    read_closings,
    split_folds,
)
from palpate_studies.baselines.full_input_learners import make_ridge
from palpate_studies.protocol.paired import compare
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.second.closings import other_closings

#: Half width of the interval of a stiffness from load cell and encoder, as a fraction of its value.
_EXACT = 0.01
#: Nominal rates of rupture at which methods are compared.
RATES = (0.01, 0.02, 0.03, 0.05, 0.075, 0.10)
#: Score of a fruit that ruptured before its first force level, below any other score.
_LEAST_SCORE = -6.0
#: The ridge is trained on states above this fraction of the rupture force; below it all curves are
#: similar.
_LEAST_LOAD = 0.2
#: Length of the latest part of a curve, mm, and fraction of the force where the latest stiffness
#: starts.
_LATEST_MM, _LATEST = 1.0, 0.7
#: Smallest slope and roughness.
_LEAST = 1e-3
LearnedPart = TypeVar("LearnedPart")
Closings: TypeAlias = Sequence[FruitClosing]
#: Pairs of training closings and test closings.
Splits: TypeAlias = Sequence[tuple[Closings, Closings]]


class ScoredClosing(NamedTuple):
    """A policy's score, which rises towards the limit, at each force of a closing."""

    force_n: FloatArray
    score: FloatArray


#: Trained function that scores a closing.
Scorer: TypeAlias = Callable[[FruitClosing], ScoredClosing]


class Policy(NamedTuple):
    """A stopping policy: its name, and a function that trains its scorer."""

    name: str
    learn: Callable[[Closings], Scorer]


class Method(NamedTuple):
    """An applied policy: its scores along each closing, and the scores at which it stops.

    `settings` has shape (closings, rates). They are chosen for each of `RATES` without the closing.
    """

    name: str
    scores: Sequence[ScoredClosing]
    settings: FloatArray


def report(
    *,
    curves: Annotated[
        Path | None, typer.Option(help="Closings until rupture.", metavar="CSV")
    ] = None,
    index: Annotated[
        Path | None, typer.Option(help="Rupture forces of the closings.", metavar="CSV")
    ] = None,
    test_curves: Annotated[
        Path | None, typer.Option(help="Test closings; by default 5 folds.", metavar="CSV")
    ] = None,
    test_index: Annotated[
        Path | None, typer.Option(help="Rupture forces of the test closings.", metavar="CSV")
    ] = None,
    second: SecondOption = False,
) -> StudyReport:
    """Stop closing on real fruit before it ruptures, at a nominal rate of rupture.

    Example: palpate study rupture --curves fruit.csv.gz --index fruit_index.csv
    """
    splits, how = _choose_splits((curves, index), (test_curves, test_index), second=second)
    tested = [closing for _, test in splits for closing in test]
    methods = [apply_shipped_limit(splits, known=known) for known in (True, False)]
    methods += [apply_policy(policy, splits) for policy in (CAP, RULE, RIDGE)]
    entries, compared = tradeoff(methods, closings=tested), compare_grips(methods, tested)
    return StudyReport(
        name="rupture",
        title="Stopping before rupture",
        provenance=(
            (
                "Simulated (second generator): fruit with a skin, foam and dough. Each kind has "
                "two ripenesses that rupture at a fixed deformation, independent of the stiffness"
                if second
                else "Real recordings of fruit closed on until rupture"
            )
            + f"; {how}.",
            "`palpate` is `DamageModel.bound_n`, the force limit of a grasp, at the unadjusted "
            "nominal rate; all samples used precede the decision. The setting of each other method "
            "is chosen for the nominal rate on the training fruit, as a rank of scores of models "
            "fitted without each fruit. The actual numbers of ruptured test fruit are given.",
            "Stiffness rule: a line per kind of fruit from palpate's stiffness to the rupture "
            "force. Ridge: ratio of force and rupture force from ten features of the curve so far, "
            "one model per kind of fruit.",
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
                "Loss (1 - stop force / rupture force, 1 for a rupture): palpate minus baseline "
                "(90 % interval)",
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


def _choose_splits(
    training: tuple[Path | None, Path | None],
    test: tuple[Path | None, Path | None],
    *,
    second: bool,
) -> tuple[Splits, str]:
    """Return the splits of the given files, of curves and index each, and their description."""
    (curves, index), (test_curves, test_index) = training, test
    if (test_curves is None) != (test_index is None):
        raise InputError("--test-curves and --test-index belong together; give both or neither")
    if second and curves is None and index is None:
        closings = other_closings()
    elif second or curves is None or index is None:
        raise InputError("give either --curves and --index or --second")
    else:
        closings = read_closings(curves, index)
    if test_curves is None or test_index is None:
        return split_folds(closings), f"{FOLDS}-fold cross-validation"
    splits = [(closings, read_closings(test_curves, test_index))]
    return splits, f"trained on {index}, tested on {test_index}"


def _predict_stop(training: Closings, *, test: Closings) -> list[dict[str, Any]]:
    """Return each test fruit's prediction at half load and stop force."""
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
    """Apply the limit of a grasp at each nominal rate, without choosing settings."""
    scores = list[ScoredClosing]()
    for training, test in splits:
        model = learn_damage(training, by_kind=known)
        scores += [score_by_shipped_limit(one, model=model, kind_known=known) for one in test]
    name = "ours" if known else "ours, fruit unknown"
    return Method(name, scores, np.tile(RATES, (len(scores), 1)))


def score_by_shipped_limit(
    closing: FruitClosing, *, model: DamageModel, kind_known: bool
) -> ScoredClosing:
    """Return the predicted fraction of damaged fruit at each force.

    A grasp stops below `DamageModel.bound_n`, where this fraction reaches the nominal rate.
    """
    kind = closing.fruit if kind_known else ""
    fractions = []
    for state in closing.states:
        # The load cell measures the stiffness accurately.
        value = float(np.exp(state.log_stiffness))
        low, high = value / (1 + _EXACT), value * (1 + _EXACT)
        measured = Measurement(value=value, low=low, high=high, unit="n_per_mm")
        fractions.append(model.damage_rate(state.force_n, measured, kind=kind))
    return ScoredClosing(closing.force_n, np.array(fractions))


def stop_forces(scored: ScoredClosing, rupture_force_n: float, *, at: FloatArray) -> FloatArray:
    """Return the force, N, at which the score first reaches each setting.

    The value is the rupture force if the closing did not stop in time.
    """
    first = np.searchsorted(np.maximum.accumulate(scored.score), at)
    return np.asarray(np.append(scored.force_n, rupture_force_n)[first])


def _by_kind(
    training: Closings, learn: Callable[[Closings], LearnedPart]
) -> Callable[[FruitClosing], LearnedPart]:
    """Train one model per kind of fruit; return a lookup by closing."""
    learned = {
        fruit: learn([closing for closing in training if closing.fruit == fruit])
        for fruit in dict.fromkeys(closing.fruit for closing in training)
    }

    def of(closing: FruitClosing) -> LearnedPart:
        if closing.fruit not in learned:
            raise InputError(
                f"{closing.grasp_id} is of the kind {closing.fruit}, which the training set lacks"
            )
        return learned[closing.fruit]

    return of


def _forces_n(closing: FruitClosing) -> FloatArray:
    return np.array([state.force_n for state in closing.states])


def learn_cap(training: Closings) -> Scorer:
    """Learn a cap per kind of fruit: force relative to the median rupture force."""
    median_n = _by_kind(
        training, lambda mine: float(np.median([closing.rupture_force_n for closing in mine]))
    )
    return lambda closing: ScoredClosing(closing.force_n, _forces_n(closing) / median_n(closing))


def learn_rule(training: Closings) -> Scorer:
    """Learn a linear stiffness rule: force relative to the predicted rupture force.

    Rupture force = intercept + slope x stiffness, with the stiffness at half load.
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
    """Learn the ratio of force and rupture force, with one ridge per kind of fruit.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """

    def fit(mine: Closings) -> Any:
        rows = np.concatenate([features(closing) for closing in mine])
        load = np.concatenate([closing.force_n / closing.rupture_force_n for closing in mine])
        used = load > _LEAST_LOAD
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
#: Cache of features by samples, because each closing is used in several folds.
_features = dict[bytes, FloatArray]()


def features(closing: FruitClosing) -> FloatArray:
    """Return features of the curve up to each state, shape (n_states, 10).

    The features are ln stiffness over the upper half of the force; its differences to ln stiffness
    above 0.7 of the force, between a quarter and a half, and over the last millimetre; bend and
    roughness of that millimetre; the sum of all falls of the force relative to the force; the
    sampling interval; the first closure (the size of the fruit); ln force.
    """
    key = closing.samples.tobytes()
    if key not in _features:
        # The noisy force is replaced by its running maximum.
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
        """Return ln stiffness between two fractions of the force, relative to the upper half."""
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
    """Train a policy and choose its settings on each training part; score the test part.

    Raises
    ------
    SeenBeforeError
        If a closing is in both parts.
    """
    scores, settings = list[ScoredClosing](), list[FloatArray]()
    for training, test in splits:
        chosen = Learned(
            found=choose_settings(list_critical_scores(policy, training)),
            seen=frozenset(map(specimen, training)),
        )
        scorer, at = policy.learn(training), chosen.on(map(specimen, test))
        scores += [scorer(closing) for closing in test]
        settings += [at] * len(test)
    return Method(policy.name, scores, np.array(settings))


def specimen(closing: FruitClosing) -> str:
    """Return a unique name of a recording's fruit; names alone may repeat between files."""
    return f"{closing.grasp_id} ({closing.rupture_force_n:g} N, {len(closing.samples)} samples)"


def list_critical_scores(policy: Policy, training: Closings) -> list[float]:
    """Return each training fruit's largest score, from policies trained without this fruit."""
    return [
        max(scored.score.tolist(), default=_LEAST_SCORE)
        for inner, left_out in split_folds(training)
        for scored in map(policy.learn(inner), left_out)
    ]


def choose_settings(critical: Sequence[float]) -> FloatArray:
    """Return the stopping score for each nominal rate, by conformal prediction.

    The k-th smallest critical score of n bounds the rate on similar fruit by k / (n + 1). With too
    few fruit the setting is below the smallest score.

    Examples
    --------
    >>> choose_settings(list(range(1, 100)))[[0, 3]].tolist()
    [1.0, 5.0]
    """
    ordered = np.sort(critical)
    ranks = np.floor(np.array(RATES) * (len(ordered) + 1)).astype(int)
    found = ordered[np.minimum(np.maximum(ranks, 1), len(ordered)) - 1]
    return np.asarray(np.where(ranks == 0, np.nextafter(found, -np.inf), found))


def stop_fractions(method: Method, closings: Closings) -> FloatArray:
    """Return stop force / rupture force, shape (closings, rates); 1 is a rupture."""
    rows = [
        stop_forces(scored, closing.rupture_force_n, at=at) / closing.rupture_force_n
        for scored, at, closing in zip(method.scores, method.settings, closings, strict=True)
    ]
    return np.array(rows)


def compare_grips(methods: Sequence[Method], closings: Closings) -> list[dict[str, Any]]:
    """Compare the first method with every other at each nominal rate, paired by fruit.

    The loss of a fruit is 1 - stop force / rupture force, and 1 for a ruptured fruit.
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
        Closings of the scores.

    Returns
    -------
    list of dict
        ``fruit`` (or "all"), ``method``, ``rate_limit`` (nominal), ``setting`` (median over the
        parts), ``ruptured``, ``grasps``, ``rupture_rate``, and ``firmness``: the mean of stop force
        / rupture force, which is 1 for a ruptured fruit.
    """
    fractions = {method.name: stop_fractions(method, closings) for method in methods}
    entries = []
    for fruit in [*sorted({closing.fruit for closing in closings}), "all"]:
        chosen = [i for i, closing in enumerate(closings) if fruit in ("all", closing.fruit)]
        for method in methods:
            of_chosen = fractions[method.name][chosen]
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
