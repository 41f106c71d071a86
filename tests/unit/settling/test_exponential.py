"""The paper's estimation: agreement with curve_fit, statuses and fallback values."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import OptimizeWarning, curve_fit

from palpate.measurement import Status
from palpate.settling.exponential import fit_exponential

TIME_S = np.arange(0, 2.5, 1 / 15)


def random_holds(n_holds: int, *, noise: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rate = np.exp(rng.uniform(np.log(0.3), np.log(5), (n_holds, 1)))
    holds = rng.uniform(5, 40, (n_holds, 1)) * np.exp(-rate * TIME_S) - rng.uniform(
        13, 72, (n_holds, 1)
    )
    return holds + rng.normal(0, noise, holds.shape)


def fit_with_scipy(hold: np.ndarray) -> float:
    inside = TIME_S >= 0.5 - 1e-9
    since, window = TIME_S[inside], hold[inside]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimizeWarning)
        try:
            found, _ = curve_fit(
                lambda t, a, rate, c: a * np.exp(-rate * t) + c,
                since,
                window,
                p0=(window[0] - window[-1], 1.0, window[-1]),
            )
        except RuntimeError:
            return np.nan
    return float(found[2])


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.3])
def test_fit_exponential_agrees_with_curve_fit(noise: float) -> None:
    holds = random_holds(300, noise=noise, seed=11)
    # In a noisy hold the peak can be after the first sample, and the fit windows would differ.
    holds = holds[holds.argmax(axis=1) == 0]
    fit = fit_exponential(TIME_S, holds)
    expected = np.array([fit_with_scipy(hold) for hold in holds])
    both = np.isfinite(expected) & (fit.status == Status.OK)
    assert both.mean() > (0.99 if noise < 0.1 else 0.6)
    difference = np.abs(fit.settled[both] / expected[both] - 1)
    assert np.quantile(difference, 0.99) < 1e-5
    assert np.median(difference) < 1e-7


def test_fit_exponential_amplitude_is_relative_to_the_peak() -> None:
    time_s = np.arange(0, 3, 0.05)
    since_peak = time_s - 0.2
    hold = np.where(since_peak < 0, -30.0, 25 * np.exp(-1.1 * since_peak) - 50)
    fit = fit_exponential(time_s, hold[None])
    assert fit.amplitude[0] == pytest.approx(25)
    assert fit.rate_per_s[0] == pytest.approx(1.1)
    assert fit.settled[0] == pytest.approx(-50)
    assert fit.window_s[0] == pytest.approx(time_s[-1] - 0.7)


def test_fit_exponential_requires_four_samples() -> None:
    time_s = np.array([0.0, 0.5, 0.8, 1.1, 1.4])
    hold = 10 * np.exp(-2 * time_s)[None] - 3
    short = fit_exponential(time_s[:4], hold[:, :4])
    assert short.status.tolist() == [Status.TOO_SHORT]
    assert short.settled[0] == hold[0, 3]
    assert fit_exponential(time_s, hold).settled[0] == pytest.approx(-3)


@pytest.mark.parametrize(
    "hold",
    [
        pytest.param(-TIME_S, id="straight line"),
        pytest.param(-(TIME_S**2), id="accelerating fall"),
        pytest.param(np.full(TIME_S.size, 4.2), id="constant"),
    ],
)
def test_fit_exponential_without_a_solution_returns_the_recorded_value(hold) -> None:
    fit = fit_exponential(TIME_S, hold[None])
    assert fit.status.tolist() == [Status.NOT_SETTLING]
    assert fit.settled[0] == hold[-1]
    assert fit.window_s[0] == 0


def test_fit_exponential_accepts_a_distant_asymptote_only_for_clear_data() -> None:
    slow = 10 * np.exp(-0.15 * TIME_S)
    noisy = slow + np.random.default_rng(5).normal(0, 0.05, (200, TIME_S.size))
    clear, unclear = fit_exponential(TIME_S, slow[None]), fit_exponential(TIME_S, noisy)
    assert clear.status[0] is Status.OK
    assert clear.settled[0] == pytest.approx(0, abs=1e-5)
    change = noisy.max(axis=1) - noisy[:, -1]
    assert (np.abs(unclear.settled - noisy[:, -1]) <= change).all()
    assert (unclear.status == Status.NOT_SETTLING).mean() > 0.3
