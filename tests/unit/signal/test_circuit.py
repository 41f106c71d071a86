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


# 5 V, 4.7 kohm, 10 bits, pixel in the upper leg: 14.1 kohm is three times the reference.
@pytest.mark.parametrize(
    ("divider", "counts", "oversampling", "ohm"),
    [
        (Divider(), 256, 1, 14_100.0),
        (Divider(taxel_leg="lower"), 768, 1, 14_100.0),
        (Divider(reference_ohm=1000.0, supply_v=3.3, adc_bits=12), 1024, 1, 3000.0),
        (Divider(), 8 * 512, 8, 4700.0),
    ],
)
def test_resistance_ohm_matches_hand_calculated_values(
    divider: Divider, counts: int, oversampling: int, ohm: float
) -> None:
    found = resistance_ohm(counts, divider=divider, oversampling=oversampling)
    assert found == pytest.approx(ohm)
    volts = counts / oversampling / divider.full_scale * divider.supply_v
    assert ohm_to_volts(ohm, divider=divider) == pytest.approx(volts)


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


@pytest.mark.parametrize(("count", "message"), [(1024, "10 bit"), (-1, "-1"), (np.nan, "nan")])
def test_resistance_ohm_with_counts_out_of_range_raises(count: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        resistance_ohm([count], divider=Divider())


def test_resolution_ohm_equals_the_difference_of_one_count() -> None:
    ohm = resistance_ohm([511, 512, 513], divider=Divider())
    assert resolution_ohm(ohm[1], divider=Divider()) == pytest.approx(
        (ohm[0] - ohm[2]) / 2, rel=1e-3
    )


def test_volts_to_counts_rounds_and_clips() -> None:
    volts = np.array([-0.1, 2.4999, 5.2])
    assert volts_to_counts(volts, divider=Divider()).tolist() == [0, 512, 1023]
    assert volts_to_counts(2.5, divider=Divider(), noise_counts=0.6) == 513
