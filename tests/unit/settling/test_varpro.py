"""The variable-projection core."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.settling.varpro import decay, fit_rate, saturation

RATES = np.geomspace(1e-3, 1e3, 90)


@pytest.mark.parametrize("basis", [decay, saturation])
def test_derivatives_are_those_of_the_basis(basis) -> None:
    x, rate, step = np.linspace(0.1, 3, 7), np.array([[0.7], [2.0]]), 1e-4
    value, slope, bend = basis(x, rate)
    above, below = basis(x, rate + step)[0], basis(x, rate - step)[0]
    assert np.allclose(slope, (above - below) / (2 * step), atol=1e-7)
    assert np.allclose(bend, (above - 2 * value + below) / step**2, atol=1e-6)


@pytest.mark.parametrize("rate", [0.02, 0.3, 1.0, 8.0, 40.0])
@pytest.mark.parametrize("offset", [True, False])
def test_exact_data_give_their_parameters_back(rate: float, offset: bool) -> None:
    x = np.linspace(0, 3, 40)
    y = -2.5 * np.exp(-rate * x) + (7.0 if offset else 0.0)
    fit = fit_rate(x, y[None], rates=RATES, offset=offset)
    assert fit.rate[0] == pytest.approx(rate, rel=1e-6)
    assert fit.amplitude[0] == pytest.approx(-2.5, rel=1e-6)
    assert fit.offset[0] == pytest.approx(7.0 if offset else 0.0, rel=1e-6, abs=1e-9)
    assert fit.unexplained[0] == pytest.approx(0.0, abs=1e-9)


def test_a_straight_line_has_its_rate_at_the_end() -> None:
    x = np.linspace(0, 1, 20)
    fit = fit_rate(x, np.stack([x, np.zeros(20)]), rates=RATES)
    assert fit.at_end.all()
    assert np.isfinite(fit.amplitude).all()
    assert fit.amplitude[1] == 0.0


def test_the_sum_of_squares_is_that_of_the_residuals_and_minimal() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(0, 2, 25)
    y = 3 * np.exp(-1.5 * x) + rng.normal(0, 0.1, (5, 25))
    fit = fit_rate(x, y, rates=RATES)

    def squares(rate: np.ndarray) -> np.ndarray:
        shape = np.exp(-rate[:, None] * x)
        design = np.stack([shape, np.ones_like(shape)], axis=2)
        best = [np.linalg.lstsq(a, b, rcond=None)[1][0] for a, b in zip(design, y, strict=True)]
        return np.array(best)

    assert fit.unexplained == pytest.approx(squares(fit.rate), rel=1e-9)
    assert (squares(fit.rate * 1.001) > fit.unexplained).all()
    assert (squares(fit.rate * 0.999) > fit.unexplained).all()
    assert fit.gained == pytest.approx(squares(np.full(5, 1e-3)) - fit.unexplained, rel=1e-6)
