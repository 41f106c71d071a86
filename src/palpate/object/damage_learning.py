"""Fitting of a damage model to recorded closings, and its cross-validation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.strict import read_table
from palpate.object.damage import (
    FOLDS,
    NOMINAL_RATE,
    DamageModel,
    DamageScore,
    RupturePrediction,
    fit_damage_model,
    prediction_at_half_load,
)
from palpate.object.strength import ClosingCurve, ClosingState


def find_unfit(closings: Sequence[FruitClosing]) -> dict[str, str]:
    """Return the closings that are unfit for training, with the reason."""
    copied = find_copies(closings)
    found = {}
    for closing in closings:
        original = copied.get(closing.grasp_id)
        reason = _find_fault(closing) if original is None else f"the same recording as {original}"
        if reason is not None:
            found[closing.grasp_id] = reason
    return found


def _find_fault(closing: FruitClosing) -> str | None:
    """Return why a closing is unfit for training; None if it is fit."""
    half_n = closing.rupture_force_n / 2
    closure_mm, force_n = closing.samples.T
    if force_n.max(initial=0.0) < half_n:
        reached_n = force_n.max(initial=0.0)
        return f"its curve ends at {reached_n:.2f} N, before half of its rupture force"
    if closure_mm[-1] <= closure_mm[0]:
        return "its closure falls during the closing; is it a width?"
    if not any(state.force_n >= half_n for state in closing.states):
        return f"its curve begins too close to its rupture force of {closing.rupture_force_n:g} N"
    return None


def learn_damage(
    closings: Sequence[FruitClosing], *, by_kind: bool = True, rate: float = NOMINAL_RATE
) -> DamageModel:
    """Fit a damage model to recorded closings.

    `rate`: fraction of objects that may be damaged at the limit.
    Raises `InputError` if there are too few closings.
    """
    try:
        return fit_damage_model(
            [closing.states for closing in closings],
            rupture_force_n=[closing.rupture_force_n for closing in closings],
            kinds=[closing.fruit for closing in closings],
            by_kind=by_kind,
            rate=rate,
        )
    except ValueError as fault:
        raise InputError(f"can't learn a damage limit: {fault}; add closings") from fault


def split_folds(
    closings: Sequence[FruitClosing],
) -> list[tuple[list[FruitClosing], list[FruitClosing]]]:
    """Split closings into cross-validation folds; return training and test set of each.

    Each fruit is distributed evenly over the folds. Copies of a recording are in the same fold.
    """
    seen: dict[str, int] = {}
    fold: dict[str, int] = {}
    copied = find_copies(closings)
    for closing in closings:
        seen[closing.fruit] = seen.get(closing.fruit, -1) + 1
        fold[closing.grasp_id] = seen[closing.fruit] % FOLDS
        if closing.grasp_id in copied:
            fold[closing.grasp_id] = fold[copied[closing.grasp_id]]
    return [
        (
            [c for c in closings if fold[c.grasp_id] != k],
            [c for c in closings if fold[c.grasp_id] == k],
        )
        for k in range(FOLDS)
    ]


def predict_at_half_load(
    closing: FruitClosing, *, model: DamageModel, kind: str
) -> RupturePrediction | None:
    """Return the model's prediction for a closing at half of the predicted force."""
    return prediction_at_half_load([model.predict(state, kind=kind) for state in closing.states])


def score_held_out(closings: Sequence[FruitClosing]) -> dict[str, DamageScore]:
    """Cross-validate a damage model, by kind (`""`: kind unknown).

    Raises `InputError` if there are too few closings for training.
    """
    predictions: dict[str, list[tuple[float, float, float]]] = {}
    for training, test in split_folds(closings):
        model = learn_damage(training)
        for closing in test:
            for kind in {"", closing.fruit}:
                half = predict_at_half_load(closing, model=model, kind=kind)
                if half is None or (kind and kind not in model.strengths):
                    continue
                alike = [c.rupture_force_n for c in training if kind in ("", c.fruit)]
                predictions.setdefault(kind, []).append(
                    (
                        half.predicted_n / closing.rupture_force_n,
                        float(np.median(alike)) / closing.rupture_force_n,
                        half.low_n / closing.rupture_force_n,
                    )
                )
    return {kind: _score(predictions[kind]) for kind in sorted(predictions)}


def _score(predictions: Iterable[tuple[float, float, float]]) -> DamageScore:
    predicted, median, low = np.array(list(predictions)).T
    return DamageScore(
        closings=len(predicted),
        error_percent=100 * float(np.mean(np.abs(predicted - 1))),
        median_error_percent=100 * float(np.mean(np.abs(median - 1))),
        above_low=float(np.mean(low <= 1)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitClosing:
    """One recorded closing until rupture."""

    #: Name and fruit, as in the file.
    grasp_id: str
    fruit: str
    #: Labelled rupture force.
    rupture_force_n: float
    #: Shape (n_states,). Force of the sample at which each state became known, at least the force
    #: of the state.
    force_n: NDArray[np.float64]
    #: States before the force first reached the label.
    states: Sequence[ClosingState]
    #: Shape (n_samples, 2). Recorded closure (mm) and force (N) before the force reached the label.
    samples: NDArray[np.float64]


def read_closings(curves: Path, index: Path) -> list[FruitClosing]:
    """Read recorded closings and their labels.

    `curves`: CSV with ``grasp_id,closure_mm,force_n``; the samples of each closing in order.
    `index`: CSV with ``grasp_id,fruit,rupture_force_n``; one line per closing.
    Raises `InputError` if a file can't be used, or a closing is listed twice or has no curve.
    """
    labels = read_table(
        index, columns={"grasp_id": "text", "fruit": "text", "rupture_force_n": "number"}
    )
    samples = read_table(
        curves, columns={"grasp_id": "text", "closure_mm": "number", "force_n": "number"}
    )
    owner = samples["grasp_id"]
    starts = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    ends = np.append(starts[1:], len(owner))
    where = dict(zip(owner[starts], zip(starts, ends, strict=True), strict=True))
    if len(where) < len(starts):
        divided = next(name for name in where if np.sum(owner[starts] == name) > 1)
        raise InputError(f"{curves}: the samples of {divided} are not contiguous; sort the file")
    closings: list[FruitClosing] = []
    for name, fruit, limit_n in zip(*labels.values(), strict=True):
        if any(name == closing.grasp_id for closing in closings):
            raise InputError(f"{index}: {name} is listed twice; remove one line")
        if name not in where:
            raise InputError(f"{curves}: no curve for {name}, which {index} lists")
        if not fruit.strip():
            raise InputError(f"{index}: the fruit of {name} is empty; enter its kind")
        if limit_n <= 0:
            raise InputError(
                f"{index}: rupture_force_n of {name} is {limit_n}; it must be positive"
            )
        part = slice(*where[name])
        closings.append(
            follow_closing(
                name,
                fruit=fruit,
                rupture_force_n=float(limit_n),
                closure_mm=samples["closure_mm"][part],
                force_n=samples["force_n"][part],
            )
        )
    return closings


def follow_closing(
    grasp_id: str,
    *,
    fruit: str,
    rupture_force_n: float,
    closure_mm: NDArray[np.float64],
    force_n: NDArray[np.float64],
) -> FruitClosing:
    """Compute the states of a recorded closing, sample by sample, until the fruit ruptures."""
    curve = ClosingCurve()
    states: list[ClosingState] = []
    known_at_n: list[float] = []
    above = np.flatnonzero(force_n >= rupture_force_n)
    before = slice(above[0] if above.size else len(force_n))
    samples = np.column_stack([closure_mm[before], force_n[before]])
    for closure, force in samples.tolist():
        passed = curve.push(closure, force_n=force)
        states += passed
        known_at_n += [force] * len(passed)
    return FruitClosing(
        grasp_id=grasp_id,
        fruit=fruit,
        rupture_force_n=rupture_force_n,
        force_n=np.array(known_at_n),
        states=states,
        samples=samples,
    )


def find_copies(closings: Sequence[FruitClosing]) -> dict[str, str]:
    """Return the closings that repeat an earlier recording, with the name of the original.

    A fruit that is in the training set twice, or in both training and test set, would make the
    score too optimistic.
    """
    first: dict[tuple[str, float, bytes], str] = {}
    found = {}
    for closing in closings:
        content = (closing.fruit, closing.rupture_force_n, closing.samples.tobytes())
        earlier = first.setdefault(content, closing.grasp_id)
        if earlier != closing.grasp_id:
            found[closing.grasp_id] = earlier
    return found
