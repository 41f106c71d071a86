"""The memory of a sheet, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.creep import CreepStates, loading_sensitivity


def test_states_forget_at_their_time_constants() -> None:
    sheet = CreepStates(time_constants_s=(0.5, 2.0))
    sheet.step(0.0, [0.9])
    for time_s in np.linspace(0.0, 1.0, 11)[1:]:
        sheet.step(float(time_s), [9.9])
    reached = (sheet.states[0] - 0.0) / np.log(10.0)
    assert reached[0] == pytest.approx(1.0)
    assert reached[1:] == pytest.approx(1 - np.exp([-2.0, -0.5]))


def test_sheets_of_a_batch_do_not_mix() -> None:
    rng = np.random.default_rng(0)
    excess = rng.uniform(0, 50, (20, 3))
    batch = CreepStates(sensors=3)
    alone = [CreepStates() for _ in range(3)]
    for k, reading in enumerate(excess):
        batch.step(0.1 * k, reading)
        for sheet, one in zip(alone, reading, strict=True):
            sheet.step(0.1 * k, [one])
    assert batch.states == pytest.approx(np.concatenate([sheet.states for sheet in alone]))
    assert batch.fall == pytest.approx(np.concatenate([sheet.fall for sheet in alone]))


def test_a_flicker_of_one_digit_is_no_unloading() -> None:
    steady, falling = CreepStates(), CreepStates()
    for sheet, last in ((steady, 9.0), (falling, 5.0)):
        sheet.step(0.0, [10.0], resolution=1.0)
        sheet.step(0.01, [last], resolution=1.0)
    assert steady.fall[0] == 0.0
    assert falling.fall[0] > 1.0


def test_time_may_not_run_backwards() -> None:
    sheet = CreepStates()
    sheet.step(1.0, [1.0])
    with pytest.raises(ValueError, match="runs backwards"):
        sheet.step(0.5, [1.0])


def test_sensitivity_is_the_exponent_of_a_steady_loading() -> None:
    time_s = np.arange(0.0, 2.0, 0.005)
    since = np.maximum(time_s - 1.0, 0.0)
    found = [
        loading_sensitivity(time_s, np.log((20 * since) ** n + 0.1)[:, None])[0]
        for n in (0.5, 1.0, 2.0)
    ]
    assert found == pytest.approx([0.5, 1.0, 2.0], rel=0.3)
    assert np.all(np.diff(found) > 0.3)


def test_sensitivity_is_bounded_where_nothing_is_known() -> None:
    assert loading_sensitivity(np.array([0.0]), np.array([[1.0]])).tolist() == [0.1]
