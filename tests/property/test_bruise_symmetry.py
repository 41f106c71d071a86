"""Bruise features do not depend on the finger, or finger end, with the bruise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from palpate.produce.bruise.shape import contrast, fit_load_shape, pixel_contrast

CHANGES = arrays(np.float64, (4, 2), elements=st.floats(-99.0, 5.0))
#: Name and operation on the pixels.
MOVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "fingers exchanged": lambda change: change[[2, 3, 0, 1]],
    "mirrored along": lambda change: change[[1, 0, 3, 2]],
    "mirrored across": lambda change: change[:, ::-1],
}


@pytest.mark.parametrize("name", MOVES)
@given(now=CHANGES, before=CHANGES)
def test_bruise_contrast_is_invariant_to_swapped_or_turned_pixels(
    name: str, now: np.ndarray, before: np.ndarray
) -> None:
    move = MOVES[name]
    plain = fit_load_shape(now, width_mm=66.0), fit_load_shape(before, width_mm=65.0)
    moved = fit_load_shape(move(now), width_mm=66.0), fit_load_shape(move(before), width_mm=65.0)
    assert contrast(*moved) == pytest.approx(contrast(*plain), abs=1e-3)


@given(change=CHANGES)
def test_bruise_contrast_of_a_shape_with_itself_is_zero(change: np.ndarray) -> None:
    shape = fit_load_shape(change, width_mm=66.0)
    assert not contrast(shape, shape).any()
    assert not pixel_contrast(shape, shape, rows=4, cols=2).any()


@given(now=CHANGES, before=CHANGES)
def test_bruise_pixel_contrast_of_facing_pixels_is_opposite(
    now: np.ndarray, before: np.ndarray
) -> None:
    found = pixel_contrast(fit_load_shape(now), fit_load_shape(before), rows=4, cols=2)
    assert found[:2] == pytest.approx(-found[2:])
