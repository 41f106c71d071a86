"""Damage model with synthetic fruit: curve states, prediction and limit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.measurement import Measurement
from palpate.object.damage import DamageModel, fit_damage_model
from palpate.object.strength import ClosingCurve, ClosingState, fit_strength


def close_on(stiffness: float, *, until_n: float) -> list[ClosingState]:
    """Close on a linear spring and return the states."""
    curve = ClosingCurve()
    states: list[ClosingState] = []
    closure_mm = 0.05
    while stiffness * closure_mm < until_n:
        states += curve.push(closure_mm, force_n=stiffness * closure_mm)
        closure_mm += 0.05
    return states


def orchard(count: int, *, seed: int) -> tuple[list[list[ClosingState]], list[float], list[str]]:
    """Fruit that ruptures at twice its stiffness, give or take 20 %."""
    rng = np.random.default_rng(seed)
    paths, limits_n, kinds = [], [], []
    for _ in range(count):
        stiffness = math.exp(rng.normal(1.0, 0.4))
        limit_n = 2 * stiffness * math.exp(rng.normal(0.0, 0.2))
        paths.append(close_on(stiffness, until_n=1.1 * limit_n))
        limits_n.append(limit_n)
        kinds.append(str(rng.choice(["plum", "pear"])))
    return paths, limits_n, kinds


@pytest.fixture(scope="module")
def model() -> DamageModel:
    paths, limits_n, kinds = orchard(240, seed=1)
    return fit_damage_model(paths, rupture_force_n=limits_n, kinds=kinds)


def test_closing_states_are_independent_of_origin_and_sampling() -> None:
    """The states of a spring have its stiffness."""
    fine, coarse, shifted = ClosingCurve(), ClosingCurve(), ClosingCurve()
    x = np.linspace(0.1, 4.0, 4001)
    a = [s for c in x for s in fine.push(c, force_n=2 * c)]
    b = [s for c in x[::10] for s in coarse.push(c, force_n=2 * c)]
    c = [s for v in x for s in shifted.push(v + 7.0, force_n=2 * v)]
    assert np.allclose(np.array(a), np.array(c), atol=1e-9)
    assert np.allclose(np.array(a), np.array(b), atol=1e-9)
    assert math.exp(a[-1].log_stiffness) == pytest.approx(2.0, rel=1e-3)


def test_prediction_is_near_the_rupture_force_and_at_least_the_force_withstood(
    model: DamageModel,
) -> None:
    paths, limits_n, _ = orchard(80, seed=3)
    strength = fit_strength(paths, rupture_force_n=limits_n)
    half_loaded = close_on(3.0, until_n=3.0)[-1]
    assert strength.predict_n(half_loaded) == pytest.approx(6.0, rel=0.15)
    for state in close_on(1.0, until_n=20.0):
        assert model.strengths[""].predict_n(state) >= state.force_n


def test_fit_damage_model_too_few_closings_are_refused() -> None:
    paths, limits_n, kinds = orchard(3, seed=5)
    with pytest.raises(ValueError, match="are needed"):
        fit_damage_model(paths, rupture_force_n=limits_n, kinds=kinds)


def felt(low: float, value: float, high: float) -> Measurement:
    return Measurement(value=value, low=low, high=high, unit="n_per_mm", level=0.9)


@pytest.mark.slow
def test_damage_bound_of_unseen_fruit_limits_damage_to_the_rate() -> None:
    """Fruit compliance is known to 0.07 mm/N, a fifth; the bound holds on average."""
    rng, rates, count = np.random.default_rng(11), np.array([0.01, 0.1]), 0
    damaged = np.zeros(2)
    for seed in (1, 2, 3, 4):
        paths, limits_n, kinds = orchard(120, seed=seed)
        fitted = fit_damage_model(paths, rupture_force_n=limits_n, kinds=kinds)
        learned = [replace(fitted, rate=rate) for rate in rates]
        for path, limit_n, _ in zip(*orchard(200, seed=20 + seed), strict=True):
            compliance = math.exp(-path[-1].log_stiffness)
            seen, half_width = max(compliance + 0.07 * rng.standard_normal(), 0.02), 1.645 * 0.07
            stiffness = felt(1 / (seen + half_width), 1 / seen, 1 / max(seen - half_width, 1e-3))
            damaged += [model.bound_n(stiffness) > limit_n for model in learned]
            count += 1
    assert np.all(damaged <= rates * count + 2.5 * np.sqrt(rates * count))


@pytest.mark.slow
def test_damage_bound_of_unknown_stiffness_follows_training_set(model: DamageModel) -> None:
    """The measurement is uninformative, so only the training set determines the limit."""
    uninformative = felt(0.05, 1.0, 500.0)
    bound_n = model.bound_n(uninformative)
    # The rupture forces of an orchard of 4000.
    rng = np.random.default_rng(13)
    limits_n = 2 * np.exp(rng.normal(1.0, 0.4, 4000) + rng.normal(0.0, 0.2, 4000))
    assert 0.3 * np.quantile(limits_n, 0.01) < bound_n < 1.3 * np.quantile(limits_n, 0.01)
