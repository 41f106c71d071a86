"""Predictions of relative changes in percent equal predictions of the resistances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.holds import Hold
from palpate.scoring.predictions import predict_holds
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation

TIME_S = np.arange(1, 301) / 15
REST_OHM = 40e3


def resistance_ratio(level: float) -> NDArray[np.float64]:
    """Return R / R_rest of a hold with a contact of 0.2 s."""
    fast, slow = 0.8 * np.exp(-TIME_S / 0.08), 0.15 * np.exp(-TIME_S / 2.0)
    return np.asarray(level * (1 + slow - 0.03 * np.log(TIME_S + 0.3)) + fast)


@pytest.mark.parametrize("level", [0.02, 0.1, 0.6])
@pytest.mark.parametrize("cutoff_s", [1.0, 2.5, 5.0])
def test_prediction_in_percent_equals_the_prediction_in_ohm(level: float, cutoff_s: float) -> None:
    ohm, percent = REST_OHM * resistance_ratio(level), 100 * (resistance_ratio(level) - 1)
    by_ohm = predict_settled(TIME_S, ohm, cutoff_s=cutoff_s)
    by_percent = predict_settled(TIME_S, percent, cutoff_s=cutoff_s, unit="percent")
    for end in ("low", "value", "high"):
        expected = 100 * (getattr(by_ohm, end) / REST_OHM - 1)
        assert getattr(by_percent, end) == pytest.approx(expected, abs=1e-6)
    assert by_percent.status == by_ohm.status


def test_prediction_in_percent_is_above_minus_100() -> None:
    percent = 100 * (resistance_ratio(0.004) - 1)
    found = predict_settled(TIME_S, percent, cutoff_s=1.0, unit="percent", level=0.999)
    assert -100 < found.low < found.high


def test_predict_holds_uses_the_unit_of_the_hold() -> None:
    percent = 100 * (resistance_ratio(0.05) - 1)
    hold = Hold(hold_id="a", channel=None, time_s=TIME_S, values=percent, unit="percent")
    methods = {"relaxation": Relaxation()}
    rows = [
        row
        for unit in ("percent", None)
        for row in predict_holds(
            [replace(hold, unit=unit)], methods=methods, cutoffs_s=[2.5], horizon_s=20.0, level=0.9
        )
    ]
    expected = predict_settled(TIME_S, percent, cutoff_s=2.5, unit="percent")
    assert rows[0].predicted == float(expected.value)
    assert rows[1].predicted != rows[0].predicted
