"""Counts, volts and ohms, compared with hand-calculated values."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from palpate.signal.circuit import (
    Divider,
    ohm_to_volts,
    resistance_ohm,
    resolution_ohm,
    volts_to_counts,
)


def test_paper_divider_matches_hand_calculated_values() -> None:
    # 5 V, 4.7 kohm, 10 bits, pixel in the upper leg: 14.1 kohm is three times the reference.
    assert ohm_to_volts(14_100.0, divider=Divider()) == pytest.approx(1.25)
    assert resistance_ohm(256, divider=Divider()) == pytest.approx(14_100.0)


def test_divider_with_lower_leg_mirrors_the_upper_leg() -> None:
    lower = Divider(taxel_leg="lower")
    assert ohm_to_volts(14_100.0, divider=lower) == pytest.approx(3.75)
    assert resistance_ohm(768, divider=lower) == pytest.approx(14_100.0)


def test_resistance_ohm_uses_reference_supply_and_resolution() -> None:
    divider = Divider(reference_ohm=1000.0, supply_v=3.3, adc_bits=12)
    assert resistance_ohm(1024, divider=divider) == pytest.approx(3000.0)


def test_resistance_ohm_divides_counts_by_the_oversampling() -> None:
    assert resistance_ohm(8 * 512, divider=Divider(), oversampling=8) == pytest.approx(4700.0)


@pytest.mark.parametrize(
    ("leg", "counts", "ohm"),
    [("upper", 0, np.inf), ("upper", 1023, 0.0), ("lower", 0, 0.0), ("lower", 1023, np.inf)],
)
def test_resistance_ohm_at_the_ends_of_the_range_is_infinite_or_zero(
    leg: Literal["upper", "lower"], counts: int, ohm: float
) -> None:
    assert resistance_ohm([counts], divider=Divider(taxel_leg=leg)).tolist() == [ohm]


def test_resistance_ohm_is_infinite_only_if_all_conversions_are_open() -> None:
    ohm = resistance_ohm([0, 1, 4 * 1023 - 1, 4 * 1023], divider=Divider(), oversampling=4)
    assert np.isinf(ohm).tolist() == [True, False, False, False]
    assert (ohm == 0).tolist() == [False, False, False, True]


def test_resistance_ohm_with_counts_out_of_range_raises() -> None:
    with pytest.raises(ValueError, match="10 bit"):
        resistance_ohm([1024], divider=Divider())
    with pytest.raises(ValueError, match="-1"):
        resistance_ohm([-1], divider=Divider())
    with pytest.raises(ValueError, match="nan"):
        resistance_ohm([np.nan], divider=Divider())


def test_resolution_ohm_equals_the_difference_of_one_count() -> None:
    ohm = resistance_ohm([511, 512, 513], divider=Divider())
    assert resolution_ohm(ohm[1], divider=Divider()) == pytest.approx(
        (ohm[0] - ohm[2]) / 2, rel=1e-3
    )


def test_volts_to_counts_rounds_and_clips() -> None:
    volts = np.array([-0.1, 2.4999, 5.2])
    assert volts_to_counts(volts, divider=Divider()).tolist() == [0, 512, 1023]
    assert volts_to_counts(2.5, divider=Divider(), noise_counts=0.6) == 513
