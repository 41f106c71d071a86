"""The Velostat sheet: creep, coordinates, hysteresis, environment and wear."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.velostat import (
    FAMILIES,
    SETTLED_S,
    Creep,
    Sheet,
    draw_sheet,
    two_mode_creep,
)


def step_response(creep: Creep, time_s: np.ndarray) -> np.ndarray:
    """Return the response to a unit step of load at time 0."""
    return creep.instant_fraction - np.expm1(-time_s[:, None] / creep.tau_s) @ creep.weight


def sheet(family: str = "two-mode", *, level: str = "lab") -> Sheet:
    return draw_sheet(np.random.default_rng(1), layout=RIGID_LAYOUT, level=level, family=family)


@pytest.mark.parametrize("family", FAMILIES)
def test_creep_families_settle_at_the_horizon_and_have_invertible_coordinates(family: str) -> None:
    law = sheet(family, level="field").family
    creep = law.draw(np.random.default_rng(2))
    assert step_response(creep, np.array([SETTLED_S])).item() == pytest.approx(1.0, abs=1e-12)
    assert 0.0 < creep.instant_fraction < 1.2
    excess = np.r_[0.0, np.geomspace(1e-4, 1e4, 200)]
    v = law.coordinate(excess)
    assert np.all(np.diff(v) > 0)
    np.testing.assert_allclose(law.excess_conductance(v), excess, rtol=1e-9, atol=1e-12)


def test_two_mode_creep_matches_fit_to_table_1() -> None:
    class Typical(np.random.Generator):
        """A generator that draws the median of every normal distribution."""

        def standard_normal(self, *_: object, **__: object) -> float:  # type: ignore[override]
            return 0.0

    creep = two_mode_creep(Typical(np.random.PCG64(0)), 1.0)
    time_s = np.linspace(0, 20, 81)

    def remaining(t: np.ndarray) -> np.ndarray:
        modes = 0.131 * np.exp(-((t / 1.96) ** 1.12)) + 0.068 * np.exp(-t / 17.2)
        return modes - 0.0103 * np.log1p(t / 3.2)

    expected = 1 - remaining(time_s) + remaining(np.array([20.0]))
    np.testing.assert_allclose(step_response(creep, time_s), expected, atol=6e-4)
