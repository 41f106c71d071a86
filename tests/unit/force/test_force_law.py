"""Force law: prior, updates with measured forces, and stored form."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError, InputError
from palpate.force.force_law import INPUTS, ForceLaw, load_population
from palpate.force.force_states import ForceStates, log_reading

EXCESS, WEIGHTS_N = (4.0, 15.0, 40.0), (1.5, 4.0, 9.0)


def law_of(*, known: int = 3, factor: float = 1.0) -> ForceLaw:
    """Return the law of the first weights, all scaled by the factor."""
    if not known:
        return ForceLaw()
    return ForceLaw.fit(EXCESS[:known], force_n=factor * np.array(WEIGHTS_N[:known]))


def test_force_law_without_contact_returns_zero() -> None:
    for excess in (-0.02, 0.0, 0.05):
        answer = law_of().force(excess)
        assert answer.value == answer.low == 0.0 < answer.high < 1.0


def test_force_law_upper_limit_at_rest_ignores_history() -> None:
    """A sheet at rest after a release is not a force of many newtons."""
    states = ForceStates()
    for frame in range(200):
        states.step(0.01 * frame, float(log_reading(150.0 if frame < 150 else 0.02)))
    inputs = states.step(2.0, float(log_reading(0.02)))
    law = ForceLaw.fit(
        [inputs + np.eye(INPUTS)[0] * shift for shift in (6.0, 6.5, 7.0)],
        force_n=[4.0, 6.0, 9.0],
        contact=[0, 0, 0],
    )
    answer = law.force(inputs)
    assert answer.value == 0.0 < answer.high < 1.0


@pytest.mark.parametrize(
    ("readings", "forces_n", "message"),
    [
        ([5000.0, 900.0, 200.0], WEIGHTS_N, "give conductances"),
        ([0.0, 15.0, 40.0], WEIGHTS_N, "at 1.5 N is 0, not above"),
        ([-0.01, 15.0, 40.0], WEIGHTS_N, "not above"),
        ([13.0, np.inf, 112.0], WEIGHTS_N, "saturated"),
        ([4.0, 15.0], [0.0, 4.0], "not above 0"),
        ([4.0, 15.0], [4.0], "2 readings for 1"),
    ],
)
def test_force_law_fit_refuses_invalid_pairs(
    readings: list[float], forces_n: list[float], message: str
) -> None:
    with pytest.raises(CalibrationError, match=message):
        ForceLaw.fit(readings, force_n=forces_n)


@pytest.mark.parametrize(("excess", "message"), [(float("nan"), "NaN"), ([1.0, 2.0], "shape")])
def test_force_of_an_invalid_reading_is_refused(excess: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ForceLaw().force(excess)


def test_force_law_samples_of_one_contact_have_limited_weight() -> None:
    """One second of load-cell samples at one reading is not equivalent to 100 weights."""
    rng = np.random.default_rng(3)
    reading = [20.0] * 400
    force_n = 5.0 * np.exp(0.05 * rng.standard_normal(400))
    many = ForceLaw.fit(reading, force_n=force_n, contact=[0] * 400)
    few = ForceLaw.fit(reading[:25], force_n=force_n[:25], contact=[0] * 25)
    inputs = np.array([[log_reading(40.0), *[0.0] * (INPUTS - 1)]])
    np.testing.assert_allclose(many.log_force(inputs)[1], few.log_force(inputs)[1], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "power"}, "'power' is unknown"),
        ({"weights": [1.0]}, "shape"),
        ({"covariance": [[float("nan")]]}, "shape"),
        ({"known": None}, "calibrate the force again"),
        ({"population": {}}, "centre"),
    ],
)
def test_force_law_invalid_values_are_refused_in_one_line(
    change: dict[str, object], message: str
) -> None:
    stored = ForceLaw().as_dict() | change
    with pytest.raises(CalibrationError, match="calibrate the force again") as error:
        ForceLaw.from_dict(stored)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_shipped_population_is_valid() -> None:
    population = load_population()
    for spread in (population.spread, population.contact_spread):
        np.testing.assert_allclose(spread, spread.T)
        assert np.linalg.eigvalsh(spread).min() > -1e-9
    # More reading is more force, over the whole range that sensors show.
    values = [ForceLaw().force(excess).value for excess in (0.5, 2.0, 8.0, 30.0, 120.0)]
    assert np.all(np.diff(values) > 0)
