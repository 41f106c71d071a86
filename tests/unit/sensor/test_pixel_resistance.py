"""Conversion of counts to pixel resistances for each wiring of the idle lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.held_readings import held_readings_ohm

from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, IdleLines
from palpate.sensor.sample import pixel_resistance_ohm
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts

#: High resolution, so that rounding is negligible in the comparisons.
FINE = Divider(adc_bits=24)


def layout(idle_lines: IdleLines, *, line_ohm: float = 0.0) -> ArrayLayout:
    return replace(RIGID_LAYOUT, divider=FINE, idle_lines=idle_lines, line_ohm=line_ohm)


def pixels(*shape: int) -> NDArray[np.float64]:
    return 2000.0 * np.exp(np.random.default_rng(4).normal(0, 0.7, (*shape, 4, 2)))


def counts_of(read_ohm: NDArray[np.float64]) -> NDArray[np.int32]:
    return volts_to_counts(ohm_to_volts(read_ohm, divider=FINE), divider=FINE)


@pytest.mark.parametrize("line_ohm", [0.0, 70.0])
def test_pixel_resistance_with_isolated_lines_subtracts_the_series_resistance(
    line_ohm: float,
) -> None:
    ohm = pixels(5)
    found = pixel_resistance_ohm(
        counts_of(ohm + line_ohm), layout=layout("isolated", line_ohm=line_ohm)
    )
    assert found == pytest.approx(ohm, rel=1e-4)


def test_pixel_resistance_with_held_lines_removes_the_crosstalk_of_a_multiplexed_column() -> None:
    # Kirchhoff: the column line feeds the idle pixels, and the multiplexer in series with the
    # reference resistor.
    line_ohm, ohm = 70.0, pixels(5)
    conductance = 1.0 / ohm
    to_ground = 1.0 / (FINE.reference_ohm + line_ohm)
    line = conductance / (conductance.sum(axis=-2, keepdims=True) + to_ground)
    adc = line * FINE.reference_ohm * to_ground
    counts = volts_to_counts(FINE.supply_v * adc, divider=FINE)
    found = pixel_resistance_ohm(counts, layout=layout("held", line_ohm=line_ohm))
    assert found == pytest.approx(ohm, rel=1e-3)


def test_pixel_resistance_with_held_lines_is_nan_only_in_the_column_of_a_short() -> None:
    read = held_readings_ohm(pixels(), reference_ohm=FINE.reference_ohm)
    counts = counts_of(read)
    counts[1, 0] = FINE.full_scale - 1
    found = pixel_resistance_ohm(counts, layout=layout("held"))
    assert np.isnan(found[:, 0]).all()
    assert found[:, 1] == pytest.approx(pixels()[:, 1], rel=1e-4)


def test_pixel_resistance_for_counts_of_another_layout_raises() -> None:
    with pytest.raises(ValueError, match=r"not frames of layout rigid-2x2 \(4 x 2\)"):
        pixel_resistance_ohm(np.zeros((2, 4)), layout=RIGID_LAYOUT)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("idle_lines", "grounded", "isolated, floating, held"),
        ("line_ohm", -1.0, "0 or more"),
        ("line_ohm", float("nan"), "0 or more"),
    ],
)
def test_array_layout_with_invalid_wiring_is_refused(
    field: str, value: object, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        replace(RIGID_LAYOUT, **{field: value})  # type: ignore[arg-type]
