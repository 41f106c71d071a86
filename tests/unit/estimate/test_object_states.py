"""How a held object relaxes: even in ln time, anew with every move, nothing where nothing is."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.object_states import ObjectStates


def relaxed(time_s: np.ndarray, deformation: np.ndarray) -> np.ndarray:
    """Return the relaxation at each time."""
    held = ObjectStates()
    found = []
    for time, way in zip(time_s, deformation, strict=True):
        held.step(float(time), [way])
        found.append(held.states[0, 1])
        assert held.states[0, 0] == pytest.approx(np.log(way))
    return np.array(found)


def test_the_loss_is_even_in_the_log_of_time() -> None:
    time_s = np.geomspace(1.0, 32.0, 6)
    found = relaxed(np.r_[0.0, time_s], np.ones(7))[1:]
    # Within an eighth of one e-fold for every doubling.
    np.testing.assert_allclose(np.diff(found), np.log(2.0), atol=0.125)


def test_the_unit_of_the_deformation_and_the_sampling_do_not_matter() -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    steps = 1.0 + (time_s >= 4.0)
    fine = relaxed(time_s, steps)
    np.testing.assert_allclose(relaxed(time_s, 7.0 * steps), fine)
    np.testing.assert_allclose(relaxed(time_s[::10], steps[::10]), fine[::10])


def test_moves_add_up_by_their_share() -> None:
    time_s = np.arange(0.0, 10.0, 0.5)
    once = relaxed(time_s, np.ones_like(time_s))
    twice = relaxed(time_s, 1.0 + (time_s >= 4.0))
    late = np.r_[np.zeros(8), once[:12]]
    np.testing.assert_allclose(twice[8:], (0.5 * once + 0.5 * late)[8:])


def test_nothing_held_has_not_relaxed_and_time_runs_forwards() -> None:
    held = ObjectStates(objects=2)
    held.step(0.0, [1.0, 0.0])
    held.step(5.0, [0.0, 0.0])
    assert held.states.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    with pytest.raises(ValueError, match="time runs backwards"):
        held.step(4.0, [1.0, 1.0])
