"""Predict the settled value on materials that are not in the training set.

The trained rules use ln of positive readings. Their features describe the fall up to the cut-off,
and their target is ln(settled / last reading).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate import predict_settled
from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds import Hold, measure_settled_value, read_holds
from palpate.measurement import Status
from palpate.settling.baselines import LogLaw
from palpate.settling.calibrated import Calibrated
from palpate.settling.result import SettlingMethod
from palpate_studies.baselines.fitted_log_law import FittedLogLaw
from palpate_studies.baselines.full_input_learners import fit_weighted_ridge
from palpate_studies.drawn_holds import draw_holds
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import find_weighted_quantile, mean, median
from palpate_studies.settling_pace import describe_pace, measure_pace

#: The paper's horizon, and that of a material whose holds are shorter.
HORIZONS_S = (20.0, 10.0)
#: Intervals of log time in the features of the ridge, and candidates of its penalty.
STRETCHES, PENALTIES = 6, np.geomspace(1e-3, 10.0, 9)
_TINY = 1e-9
CUTOFFS_S = (1.0, 2.5, 5.0)
PALPATE = "ours"
#: Simple rules that need no other holds, by their names in `predict_settled`. The law with a fitted
#: offset is scored beside them: it is the best on some materials, and far off on others.
PLAIN = ("recorded", "exponential", "log_law", "log_law_early")
#: Numbers of earlier holds of the same sensor.
OWN_HOLDS = (3, 6, 12, 24)
#: Largest number of holds of a material in the test with own holds, evenly over the file.
MOST_TESTED = 60
#: Drawn holds of each simple shape, and their seed.
DRAWN_HOLDS, DRAWN_SEED = 150, 7
#: A horizon beyond that of the paper, which the longest holds of five materials reach, s.
FAR_HORIZON_S, FAR_CUTOFFS_S = 49.0, (2.5, 10.0, 30.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HoldFeatures:
    """Features of one hold up to a cut-off, in ln, and the truth.

    Attributes
    ----------
    profile : ndarray, shape (STRETCHES + 1,)
        Fall from each interval relative to the largest fall, ln of the largest fall, and the
        largest fall.
    drop : float
        Largest fall.
    log_law : float
        Remaining change predicted by the log law.
    change : float
        True remaining change.
    """

    profile: FloatArray
    drop: float
    log_law: float
    change: float


def extract_features(hold: Hold, cutoff_s: float) -> HoldFeatures:
    """Extract the features of a hold of positive values up to a cut-off."""
    horizon_s = find_horizon(hold)
    seen = hold.time_s <= cutoff_s
    time_s, height = hold.time_s[seen], np.log(hold.values[seen])
    edges = np.geomspace(0.1, cutoff_s + 0.1, STRETCHES + 1) - 0.1
    parts = np.interp((edges[1:] + edges[:-1]) / 2, time_s, height)
    for index, (start_s, end_s) in enumerate(pairwise(edges)):
        inside = (time_s >= start_s) & (time_s <= end_s)
        if inside.any():
            parts[index] = height[inside].mean()
    fall = parts[:-1] - parts[-1]
    drop = float(np.abs(fall).max()) + _TINY
    law = LogLaw(wait_s=0.1, from_s=0.4)
    below = law.predict(time_s, (height - height[-1])[None], horizon_s=horizon_s, level=0.9)
    return HoldFeatures(
        profile=np.array([*(fall / drop), np.log(drop), drop]),
        drop=drop,
        log_law=float(below.hold(0).value),
        change=float(np.log(_measure_settled(hold)) - height[-1]),
    )


Rule = Callable[[HoldFeatures], float]


def fit_multiple(others: Mapping[str, Sequence[HoldFeatures]]) -> Rule:
    """Fit a constant multiple of the last reading, with equal weights of the materials."""
    change = np.array([one.change for holds in others.values() for one in holds])
    middle = find_weighted_quantile(change, _equal_material_weights(others))
    return lambda one: middle


def fit_scaled_log_law(others: Sequence[HoldFeatures]) -> Rule:
    """Fit a factor on the remaining change of the log law."""
    guess = np.array([one.log_law for one in others])
    change = np.array([one.change for one in others])
    known = np.abs(guess) > _TINY
    if not known.any():
        return lambda one: one.log_law
    factor = find_weighted_quantile(change[known] / guess[known], np.abs(guess[known]))
    return lambda one: factor * one.log_law


def fit_ridge(others: Mapping[str, Sequence[HoldFeatures]]) -> Rule:
    """Fit a ridge on all features, with the penalty chosen on held-out materials."""
    names = np.repeat(list(others), [len(holds) for holds in others.values()])
    holds = [one for some in others.values() for one in some]
    features = np.array([one.profile for one in holds])
    target = np.array([one.change / one.drop for one in holds])
    weight = _equal_material_weights(others)

    def miss(penalty: float) -> float:
        return float(
            sum(
                np.median(np.abs(line(features[left]) - target[left]))
                for name in others
                for left in [names == name]
                for line in [
                    fit_weighted_ridge(features[~left], target[~left], weight[~left], penalty)
                ]
            )
        )

    penalty = min(PENALTIES, key=miss) if len(others) > 1 else 1.0
    line = fit_weighted_ridge(features, target, weight, float(penalty))
    return lambda one: float(line(one.profile[None])[0]) * one.drop


def _equal_material_weights(others: Mapping[str, Sequence[HoldFeatures]]) -> FloatArray:
    return np.concatenate([np.full(len(holds), 1 / len(holds)) for holds in others.values()])


#: Scores of shape (n_holds, 4): signed error in % of the settled value; whether the interval covers
#: the truth, its half width in %, and whether its status is `ok` (NaN without an interval).
Scores: TypeAlias = FloatArray


def report(
    *,
    holds: Annotated[
        list[Path] | None,
        typer.Option(help="Holds of one material; give it once per material.", metavar="FILE"),
    ] = None,
    held_out: Annotated[
        list[Path] | None, typer.Option(help="Holds that are only scored.", metavar="FILE")
    ] = None,
) -> StudyReport:
    """Predict settled values on every material with rules trained on the other materials.

    Example: palpate study settled --holds silicone.csv.gz --holds food.csv.gz --out report
    """
    if not holds or len(holds) < 2:
        raise InputError("name at least two materials with --holds FILE")
    return judge(_read(holds), held_out=_read(held_out or []))


command = as_command(report)


def _read(files: Sequence[Path]) -> dict[str, list[Hold]]:
    """Read the holds that reach the horizon, by material (the name of the file)."""
    found: dict[str, list[Hold]] = {}
    for file in files:
        name = file.name.split(".")[0].removeprefix("holds_")
        if name in found:
            raise InputError(f"{file}: there are two files of material {name}; rename one")
        found[name] = [
            hold
            for hold in read_holds(file, until_s=FAR_HORIZON_S)
            if np.isfinite(_measure_settled(hold))
        ]
        if not found[name]:
            raise InputError(f"{file}: no hold reaches {HORIZONS_S[-1]:g} s, so none can be scored")
        for hold in found[name]:
            if not (hold.values > 0).all():
                raise InputError(
                    f"{file}: hold {hold.hold_id} is not positive throughout, so errors in % are "
                    "undefined; give values in ohm, volt or newton"
                )
    return found


def find_horizon(hold: Hold) -> float:
    """Return the longest horizon that a hold reaches, the shortest one if none."""
    reached = (h for h in HORIZONS_S if np.isfinite(_measure_value_at(hold, h)))
    return next(reached, HORIZONS_S[-1])


def _measure_settled(hold: Hold) -> float:
    return _measure_value_at(hold, find_horizon(hold))


def _measure_value_at(hold: Hold, horizon_s: float) -> float:
    return measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s)


def judge(
    materials: Mapping[str, Sequence[Hold]], *, held_out: Mapping[str, Sequence[Hold]]
) -> StudyReport:
    """Score every method on every material and held-out file, and with own holds."""
    shown = {
        (name, cutoff_s): [extract_features(hold, cutoff_s) for hold in holds]
        for name, holds in {**materials, **held_out}.items()
        for cutoff_s in CUTOFFS_S
    }
    rows = []
    for name, holds in {**materials, **held_out}.items():
        others = [other for other in materials if not _share_holds(materials[other], holds)]
        for cutoff_s in CUTOFFS_S:
            learned = {other: shown[other, cutoff_s] for other in others if other != name}
            found = _score_without_holds(holds, cutoff_s)
            if learned:
                for rule, learn in (("multiple", fit_multiple), ("ridge", fit_ridge)):
                    found[rule] = _score_rule(shown[name, cutoff_s], learn(learned))
            rows += [_row(name, cutoff_s, method, one) for method, one in found.items()]
        for wanted in OWN_HOLDS:
            count = min(wanted, len(holds) - 1)
            if count >= 0.9 * wanted:
                rows += _rows_with_own_holds(name, holds, count=count)
    rows += [
        _row(f"{shape}, drawn", cutoff_s, method, one)
        for shape, drawn in draw_holds(DRAWN_HOLDS, seed=DRAWN_SEED).items()
        for cutoff_s in CUTOFFS_S
        for method, one in _score_without_holds(drawn, cutoff_s).items()
    ]
    payload: dict[str, Any] = {
        "relative": compute_relative(rows),
        "statuses": score_statuses({**materials, **held_out}),
        "far": score_far_horizons({**materials, **held_out}),
        "pace": [
            {"material": name, **describe_pace(np.array([_measure_pace(hold) for hold in holds]))}
            for name, holds in {**materials, **held_out}.items()
        ],
    }
    regrets = compute_regret([row for row in rows if row["material"] in materials])
    return StudyReport(
        name="settled",
        title="Settled value of real recordings, on materials outside the training set",
        provenance=[
            "Real recordings: "
            + ", ".join(f"{name} ({len(holds)} holds)" for name, holds in materials.items())
            + (f"; only scored: {', '.join(held_out)}." if held_out else "."),
            "The multiple and the ridge are trained on the other materials; files with a common "
            "hold are of the same specimens and count as one material. palpate is not trained "
            "without own holds: its shapes have equal prior probabilities. The set of shapes, the "
            "usual size of a fall, the limits of `ok` and the approach to the log law were chosen "
            "on the developers' silicone, Velostat, food, tape, force and meat; held-out files "
            "test this choice. The horizon is 20 s, or 10 s where the holds are shorter (meat).",
            "Own holds are the preceding holds of the file; the first holds use the last ones.",
            f"Drawn: {DRAWN_HOLDS} holds of each shape.",
            "Pace: the rate per e-fold of time from 2.5 s to the horizon, relative to that before; "
            "0 is rest, and 1 the log law.",
        ],
        tables=[
            *_tables(rows, regrets),
            Table.of("Coverage by status, all materials and cut-offs", payload["statuses"]),
            *(
                [Table.of(f"Value at {FAR_HORIZON_S:g} s", payload["far"])]
                if payload["far"]
                else []
            ),
            Table.of("Pace, 10, 50 and 90 % quantiles", payload["pace"]),
        ],
        payload={"rows": rows, "regret": regrets, **payload},
    )


def _measure_pace(hold: Hold) -> float:
    return measure_pace(hold.time_s, hold.values, horizon_s=find_horizon(hold))


def _share_holds(some: Sequence[Hold], others: Sequence[Hold]) -> bool:
    """Return whether two files have a common hold, and therefore common specimens."""
    return bool({hold.hold_id for hold in some} & {hold.hold_id for hold in others})


def _score_without_holds(holds: Sequence[Hold], cutoff_s: float) -> dict[str, Scores]:
    """Return the scores of the shipped methods without own holds."""
    found = {PALPATE: _scores(holds, cutoff_s, method="relaxation")}
    fitted = FittedLogLaw()
    found |= {name: _scores(holds, cutoff_s, method=name) for name in PLAIN}
    return found | {fitted.name: _scores(holds, cutoff_s, method=fitted)}


def _scores(
    holds: Sequence[Hold],
    cutoff_s: float,
    *,
    method: str | SettlingMethod,
    horizon_s: float | None = None,
) -> Scores:
    rows = []
    for hold in holds:
        end_s = horizon_s or find_horizon(hold)
        settled = _measure_value_at(hold, end_s)
        found = predict_settled(hold, cutoff_s=cutoff_s, horizon_s=end_s, method=method)
        rows.append(
            (
                100 * (found.value / settled - 1),
                found.low <= settled <= found.high,
                50 * (found.high - found.low) / settled,
                found.status == Status.OK,
            )
        )
    scores = np.array(rows, dtype=np.float64)
    if not np.isfinite(scores[:, 2]).all():
        scores[:, 1:] = np.nan
    return scores


def _score_rule(holds: Sequence[HoldFeatures], rule: Rule) -> Scores:
    errors = [100 * np.expm1(rule(one) - one.change) for one in holds]
    return np.array([(error, np.nan, np.nan, np.nan) for error in errors])


def _rows_with_own_holds(name: str, holds: Sequence[Hold], *, count: int) -> list[dict[str, Any]]:
    """Return rows for predictions with the `count` preceding holds as own holds."""
    tested = range(0, len(holds), max(1, len(holds) // MOST_TESTED))
    past = {
        place: [(place - back) % len(holds) for back in range(count, 0, -1)] for place in tested
    }
    methods = {
        place: Calibrated(holds=tuple(holds[k] for k in before)) for place, before in past.items()
    }
    rows = []
    for cutoff_s in CUTOFFS_S:
        every = [extract_features(hold, cutoff_s) for hold in holds]
        found: dict[str, list[Scores]] = {PALPATE: [], "log_law": []}
        for place in tested:
            law = fit_scaled_log_law([every[k] for k in past[place]])
            found[PALPATE].append(_scores([holds[place]], cutoff_s, method=methods[place]))
            found["log_law"].append(_score_rule([every[place]], law))
        rows += [
            _row(name, cutoff_s, rule, np.concatenate(each), own_holds=count)
            for rule, each in found.items()
        ]
    return rows


def _row(
    material: str, cutoff_s: float, method: str, scores: Scores, *, own_holds: int = 0
) -> dict[str, Any]:
    error, covered, half_width, ok = scores.T
    size = np.abs(error)
    return {
        "material": material,
        "cutoff_s": cutoff_s,
        "method": method,
        "holds": len(size),
        "median_abs_error_percent": float(np.median(size)),
        "p90_abs_error_percent": float(np.quantile(size, 0.9)),
        "bias_percent": float(np.median(error)),
        "coverage": mean(covered),
        "half_width_percent": median(half_width),
        "share_ok": mean(ok),
        "own_holds": own_holds,
    }


def compute_regret(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each method's error relative to the best simple rule, without own holds.

    A ratio is the method's median |error| on a material divided by that of the simple rule that is
    best there; nobody knows beforehand which one that is. The regret is the geometric mean over
    materials.

    >>> two = [
    ...     {"material": m, "cutoff_s": 1.0, "method": n, "own_holds": 0,
    ...      "median_abs_error_percent": e}
    ...     for m, n, e in (
    ...         ("a", "ours", 1.0), ("a", "log_law", 2.0), ("b", "ours", 8.0), ("b", "log_law", 4.0)
    ...     )
    ... ]
    >>> [(row["method"], round(row["regret"], 2), row["largest"]) for row in compute_regret(two)]
    [('ours', 1.0, 2.0), ('log_law', 1.0, 1.0)]
    """
    errors: dict[float, dict[str, dict[str, float]]] = {}
    for row in rows:
        if row["own_holds"] == 0:
            one = errors.setdefault(row["cutoff_s"], {}).setdefault(row["method"], {})
            one[row["material"]] = row["median_abs_error_percent"]
    found = []
    for cutoff_s, by_method in errors.items():
        for method, by_material in by_method.items():
            ratios = [
                error / min(by_method[rule][material] for rule in PLAIN if rule in by_method)
                for material, error in by_material.items()
            ]
            mean = float(np.exp(np.mean(np.log(ratios))))
            row = {"cutoff_s": cutoff_s, "method": method, "regret": mean, "largest": max(ratios)}
            found.append(row)
    return found


def compute_relative(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return palpate's error relative to the best simple rule, by material and cut-off.

    With own holds, the simple rule is the scaled log law with the same holds.
    """
    found: dict[tuple[str, float, int], dict[str, float]] = {}
    for row in rows:
        key = row["material"], row["cutoff_s"], row["own_holds"]
        found.setdefault(key, {})[row["method"]] = row["median_abs_error_percent"]
    return [
        {
            "material": material,
            "cutoff_s": cutoff_s,
            "own_holds": own_holds,
            "relative": errors[PALPATE] / min(errors[rule] for rule in PLAIN if rule in errors),
        }
        for (material, cutoff_s, own_holds), errors in found.items()
    ]


def score_statuses(materials: Mapping[str, Sequence[Hold]]) -> list[dict[str, Any]]:
    """Return the coverage of the intervals of each status, over all materials and cut-offs."""
    covered: dict[Status, list[bool]] = {}
    for holds in materials.values():
        for hold in holds:
            settled, horizon_s = _measure_settled(hold), find_horizon(hold)
            for cutoff_s in CUTOFFS_S:
                found = predict_settled(hold, cutoff_s=cutoff_s, horizon_s=horizon_s)
                status = Status(str(found.status))
                covered.setdefault(status, []).append(bool(found.low <= settled <= found.high))
    return [
        {"status": str(status), "predictions": len(each), "coverage": mean(each)}
        for status, each in sorted(covered.items())
    ]


def score_far_horizons(materials: Mapping[str, Sequence[Hold]]) -> list[dict[str, Any]]:
    """Return scores of palpate and the log law for a horizon beyond the paper's."""
    return [
        _row(name, cutoff_s, rule, _scores(far, cutoff_s, method=method, horizon_s=FAR_HORIZON_S))
        for name, holds in materials.items()
        if (far := [hold for hold in holds if _measure_value_at(hold, FAR_HORIZON_S) > 0])
        for cutoff_s in FAR_CUTOFFS_S
        for rule, method in ((PALPATE, "relaxation"), ("log_law", "log_law"))
    ]


def _tables(rows: Sequence[Mapping[str, Any]], regrets: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Return the tables of errors, of palpate's figures, and of the regret."""
    material, form = {"material": "{material}"}, "{median_abs_error_percent:.2f}"
    at = " / ".join(f"{cutoff_s:g}" for cutoff_s in CUTOFFS_S)
    title = f"Median |error|, % of the settled value, at {at} s"
    without = [row for row in rows if row["own_holds"] == 0]
    owned = [row for row in rows if row["own_holds"]]
    return [
        Table.wide(title, without, material, over="method", form=form),
        Table.wide(
            f"With own holds: {title}",
            owned,
            material | {"own holds": "{own_holds}"},
            over="method",
            form=form,
        ),
        Table.of("palpate", [row for row in rows if row["method"] == PALPATE]),
        Table.wide(
            "Error relative to the best simple rule of each material, geometric mean (largest)",
            regrets,
            {"cut-off, s": "{cutoff_s:g}"},
            over="method",
            form="{regret:.2f} ({largest:.2f})",
        ),
    ]
