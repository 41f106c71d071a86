"""Relative changes of a table's columns, and their mean (the quantity of the paper)."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.holds.recordings import read_recording
from palpate.holds.relative_readings import relative_readings
from palpate.signal.circuit import Divider

TIME_S = np.arange(0, 25, 0.1)


def pixels(*rests_ohm: float) -> dict[str, np.ndarray]:
    """Return two seconds of rest and a hold in which the first pixel falls most."""
    held = TIME_S > 2.0
    fall = np.where(held, 0.5 - 0.05 * np.exp(-(TIME_S - 2.0) / 3.0), 0.0)
    fractions = np.linspace(1.0, 0.2, len(rests_ohm))
    return {
        f"p{number}_ohm": rest_ohm * (1.0 - fraction * fall)
        for number, (rest_ohm, fraction) in enumerate(zip(rests_ohm, fractions, strict=True))
    }


def test_mean_change_is_independent_of_rest_values() -> None:
    found = [
        relative_readings(
            read_recording({"time_s": TIME_S, **pixels(*rests)}), rest_s=(0, 1.9), mean=True
        ).columns["mean change"]
        for rests in ((1e3, 1e3), (1e3, 9e4))
    ]
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)
    assert found[0][-1] == pytest.approx(-30.0, abs=0.1)


@pytest.mark.parametrize("unit", ["counts", None])
def test_relative_readings_convert_counts_with_divider(unit: str | None) -> None:
    counts = np.where(TIME_S > 2.0, 768.0, 512.0)
    divider = Divider(adc_bits=10, reference_ohm=4700.0, taxel_leg="upper")
    readings = read_recording({"time_s": TIME_S, "a": counts}, unit=unit, divider=divider)
    change = relative_readings(readings, rest_s=(0, 1.9), mean=False).columns["a"]
    assert change[-1] == pytest.approx(-66.7, abs=0.1)


@pytest.mark.parametrize(
    ("rest_s", "unit", "message"),
    [
        ((90, 99), "ohm", "0 readings at rest"),
        ((0, 1.9), "counts", "the unit is counts; add --adc-bits"),
    ],
)
def test_relative_readings_without_rest_or_divider_are_refused(
    rest_s: tuple[float, float], unit: str, message: str
) -> None:
    readings = read_recording({"time_s": TIME_S, "a": np.full(TIME_S.size, 512.0)}, unit=unit)
    with pytest.raises(InputError, match=message):
        relative_readings(readings, rest_s=rest_s, mean=True)
