"""The force law of a few dead weights: it reads its own weights, and each pad by its own gain."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.arrays import FloatArray
from palpate.calibration import ForcePairs
from palpate.errors import CalibrationError
from palpate.force.of_calibration import HORIZON_S, fit_sheet_law
from palpate.force.sheet_law import SheetLaw
from palpate.sensor.array import RIGID_LAYOUT

GRAMS = np.array([100.0, 250.0, 500.0])
WEIGHTS_N = GRAMS * 9.80665e-3
PIXELS = RIGID_LAYOUT.rows * RIGID_LAYOUT.cols
#: Whether a pixel is on the first finger.
IS_FIRST = np.repeat(RIGID_LAYOUT.finger_of_row, RIGID_LAYOUT.cols) == 0


def read_weights(gain: FloatArray, *, exponent: float, seed: int) -> FloatArray:
    """Return the settled excess of the pixels under each weight, shape (weights, pixels)."""
    rng = np.random.default_rng(seed)
    share = gain * np.exp(0.1 * rng.standard_normal((WEIGHTS_N.size, gain.size)))
    return np.asarray(share * (WEIGHTS_N**exponent)[:, None])


def fit(excess: FloatArray, force_n: FloatArray) -> SheetLaw:
    pairs = ForcePairs(
        run=tuple(range(force_n.size)),
        since_move_s=(HORIZON_S,) * force_n.size,
        excess=tuple(excess.sum(axis=1)),
        relative_percent=(-50.0,) * force_n.size,
        force_n=tuple(force_n),
        pixel_excess=tuple(map(tuple, excess.tolist())),
    )
    return fit_sheet_law(pairs, layout=RIGID_LAYOUT)


@pytest.mark.parametrize("exponent", [0.8, 1.0, 1.4])
def test_three_weights_are_read_back(exponent: float) -> None:
    excess = read_weights(np.full(PIXELS, 0.8), exponent=exponent, seed=1)
    read_n = fit(excess, WEIGHTS_N).read_settled(excess).force_n
    assert read_n == pytest.approx(WEIGHTS_N, rel=0.15)


def test_pads_of_different_gain_are_read_by_their_own() -> None:
    strong = read_weights(np.where(IS_FIRST, 1.6, 0.0), exponent=1.0, seed=2)
    weak = read_weights(np.where(IS_FIRST, 0.0, 0.8), exponent=1.0, seed=3)
    excess, force_n = np.vstack([strong, weak]), np.tile(WEIGHTS_N, 2)
    # A weight on one pad counts as half the grip force of two.
    read_n = 2.0 * fit(excess, force_n).read_settled(excess).force_n
    assert np.median(np.abs(np.log(read_n / force_n))) < 0.15


def test_weights_given_in_the_wrong_order_are_refused() -> None:
    excess = read_weights(np.full(PIXELS, 0.8), exponent=0.8, seed=4)
    with pytest.raises(CalibrationError, match="fall while the force rises; give the weights in"):
        fit(excess, WEIGHTS_N[::-1])
    with pytest.raises(CalibrationError, match="fall while the force rises"):
        fit(excess[[2, 0, 1]], WEIGHTS_N)
