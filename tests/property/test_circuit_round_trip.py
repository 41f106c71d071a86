"""Resistance to counts and back: the error is within one converter step for any divider."""

from __future__ import annotations

from typing import Literal

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from palpate.signal.circuit import (
    Divider,
    ohm_to_volts,
    resistance_ohm,
    resolution_ohm,
    volts_to_counts,
)


@given(
    ratio=st.floats(0.01, 100.0),
    reference_ohm=st.floats(10.0, 1e6),
    supply_v=st.floats(1.0, 12.0),
    adc_bits=st.integers(8, 24),
    leg=st.sampled_from(["upper", "lower"]),
)
def test_counts_of_a_resistance_roundtrip_within_half_a_step(
    ratio: float,
    reference_ohm: float,
    supply_v: float,
    adc_bits: int,
    leg: Literal["upper", "lower"],
) -> None:
    divider = Divider(
        reference_ohm=reference_ohm, supply_v=supply_v, adc_bits=adc_bits, taxel_leg=leg
    )
    ohm = ratio * reference_ohm
    counts = volts_to_counts(ohm_to_volts(ohm, divider=divider), divider=divider)
    assume(0 < counts < divider.full_scale - 1)
    step_ohm = resolution_ohm(ohm, divider=divider)
    # Half a step, plus the curvature within a coarse step.
    distance = min(counts, divider.full_scale - counts)
    assert abs(resistance_ohm(counts, divider=divider) - ohm) <= 0.5 * step_ohm * (1 + 1 / distance)


@given(counts=st.lists(st.integers(1, 1022), min_size=2, max_size=20, unique=True))
def test_resistance_ohm_is_monotonic_in_counts(counts: list[int]) -> None:
    ordered = np.sort(counts)
    assert np.all(np.diff(resistance_ohm(ordered, divider=Divider())) < 0)
    assert np.all(np.diff(resistance_ohm(ordered, divider=Divider(taxel_leg="lower"))) > 0)
