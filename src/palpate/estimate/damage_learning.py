"""Learning a damage limit from recorded closings, and what it is worth on those left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import InputError
from palpate.estimate.damage import FOLDS, DamageLimit, DamageModel, fit_damage_model, half_load
from palpate.estimate.fruit_closings import FruitClosing, copies


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """What a model said of closings that it was not fitted to."""

    #: How many it said something of.
    closings: int
    #: Mean error of the rupture force predicted at half load, percent of the true one.
    error_percent: float
    #: The same of the median rupture force of the kind alone: no stiffness needed.
    median_error_percent: float
    #: Share that ruptured above the lower bound; 0.95 is meant.
    above_low: float


def unfit(closings: Sequence[FruitClosing]) -> dict[str, str]:
    """Return which closings can't be learned from, and why."""
    copied = copies(closings)
    found = {}
    for closing in closings:
        of = copied.get(closing.grasp_id)
        why = _fault(closing) if of is None else f"the same recording as {of}"
        if why is not None:
            found[closing.grasp_id] = why
    return found


def _fault(closing: FruitClosing) -> str | None:
    """Return why nothing can be learned from a closing, None if something can."""
    half_n = closing.rupture_force_n / 2
    closure_mm, force_n = closing.samples.T
    if force_n.max(initial=0.0) < half_n:
        reached_n = force_n.max(initial=0.0)
        return f"its curve ends at {reached_n:.2f} N, before half of its rupture force"
    if closure_mm[-1] <= closure_mm[0]:
        return "its closure falls while it is closed on; is it a width?"
    if not any(state.force_n >= half_n for state in closing.states):
        return f"its curve begins too near to its rupture force of {closing.rupture_force_n:g} N"
    return None


def learn(closings: Sequence[FruitClosing], *, tell_apart: bool = True) -> DamageModel:
    """Fit a damage model to recorded closings.

    Raises
    ------
    InputError
        If there are too few to learn from.
    """
    try:
        return fit_damage_model(
            [closing.states for closing in closings],
            rupture_force_n=[closing.rupture_force_n for closing in closings],
            kinds=[closing.fruit for closing in closings],
            tell_apart=tell_apart,
        )
    except ValueError as fault:
        raise InputError(f"can't learn a damage limit: {fault}; give more closings") from fault


def split(
    closings: Sequence[FruitClosing],
) -> list[tuple[list[FruitClosing], list[FruitClosing]]]:
    """Return parts to learn from and to test on; each closing is tested on once.

    Each fruit is spread evenly over the parts. Copies of one recording stay together.
    """
    seen: dict[str, int] = {}
    fold: dict[str, int] = {}
    copied = copies(closings)
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


def at_half_load(closing: FruitClosing, *, model: DamageModel, kind: str) -> DamageLimit | None:
    """Return what a model says of a closing when half of its own prediction is reached."""
    return half_load([model.limit(s, kind=kind, stop_score=np.inf) for s in closing.states])


def held_out(closings: Sequence[FruitClosing]) -> dict[str, HeldOut]:
    """Return what a model says of closings left out of it, by kind; ``""`` is for kind untold.

    Raises
    ------
    InputError
        If there are too few to leave some out.
    """
    said: dict[str, list[tuple[float, float, float]]] = {}
    for training, test in split(closings):
        model = learn(training)
        for closing in test:
            for kind in {"", closing.fruit}:
                limit = at_half_load(closing, model=model, kind=kind)
                if limit is None or (kind and kind not in model.strengths):
                    continue
                alike = [c.rupture_force_n for c in training if kind in ("", c.fruit)]
                said.setdefault(kind, []).append(
                    (
                        limit.predicted_n / closing.rupture_force_n,
                        float(np.median(alike)) / closing.rupture_force_n,
                        limit.low_n / closing.rupture_force_n,
                    )
                )
    return {kind: _scored(said[kind]) for kind in sorted(said)}


def _scored(said: Iterable[tuple[float, float, float]]) -> HeldOut:
    predicted, median, low = np.array(list(said)).T
    return HeldOut(
        closings=len(predicted),
        error_percent=100 * float(np.mean(np.abs(predicted - 1))),
        median_error_percent=100 * float(np.mean(np.abs(median - 1))),
        above_low=float(np.mean(low <= 1)),
    )
