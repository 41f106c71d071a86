"""`predict_settled`: shapes, cut-off, and errors for invalid input."""

from __future__ import annotations

import numpy as np
import pytest

import palpate
from palpate.errors import InputError
from palpate.measurement import Status
from palpate.settling.baselines import LogLaw
from palpate.settling.predict import METHODS, predict_settled

TIME_S = np.arange(0, 20, 0.1)
HOLD = 30 * np.exp(-TIME_S / 1.5) - 4 * np.log(TIME_S + 0.5) - 40


@pytest.mark.parametrize("method", METHODS)
def test_predict_settled_of_one_hold_equals_its_row_in_a_batch(method: str) -> None:
    one = predict_settled(TIME_S, HOLD, cutoff_s=2.5, method=method)
    batch = predict_settled(TIME_S, np.stack([HOLD, 2 * HOLD]), cutoff_s=2.5, method=method)
    assert np.ndim(one.value) == 0
    assert batch.value.shape == (2,)
    assert one.value == pytest.approx(batch.value[0], rel=1e-9)
    assert isinstance(one.status, Status)
    assert one.method == method


@pytest.mark.parametrize("method", METHODS)
def test_predict_settled_ignores_samples_after_the_cutoff(method: str) -> None:
    changed = np.where(TIME_S > 2.5, np.nan, HOLD)
    original = predict_settled(TIME_S, HOLD, cutoff_s=2.5, method=method)
    without_later = predict_settled(TIME_S, changed, cutoff_s=2.5, method=method)
    assert original.value == without_later.value


def test_predict_settled_uses_relaxation_by_default_and_accepts_a_method_object() -> None:
    assert predict_settled(TIME_S, HOLD, cutoff_s=2.5).method == "relaxation"
    patient = predict_settled(TIME_S, HOLD, cutoff_s=2.5, method=LogLaw(wait_s=1.0))
    assert patient.window_s == pytest.approx(1.5)
    assert palpate.predict_settled is predict_settled


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 2, 3])
def test_predict_settled_of_few_or_constant_samples_is_finite(method: str, samples: int) -> None:
    for values in (HOLD[:samples], np.full(samples, 3.0)):
        found = predict_settled(TIME_S[:samples], values, cutoff_s=1.0, method=method)
        assert np.isfinite(found.value)
        assert method == "recorded" or found.status != Status.OK
        assert samples > 1 or found.value == values[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": HOLD[:-1]}, "don't fit"),
        ({"time_s": np.stack([TIME_S, TIME_S])}, "don't fit"),
        ({"values": 3.0}, "don't fit"),
        ({"time_s": np.where(TIME_S[7] == TIME_S, 0.0, TIME_S)}, r"time_s\[7\] is 0 s after 0.6 s"),
        ({"time_s": np.where(TIME_S[7] == TIME_S, np.nan, TIME_S)}, r"time_s\[7\] is nan s"),
        ({"time_s": np.append(TIME_S[:-1], np.inf)}, r"time_s\[199\] is inf"),
        ({"values": np.where(TIME_S == 1.0, np.inf, HOLD)}, "hold 0 at 1 s: inf"),
        ({"cutoff_s": -1.0}, "no sample at or before cutoff_s -1"),
        ({"cutoff_s": 25.0}, "cutoff_s 25 and horizon_s 20"),
        ({"cutoff_s": np.nan}, "cutoff_s nan"),
        ({"horizon_s": np.inf}, "horizon_s inf"),
        ({"level": 1.0}, "level 1"),
        (
            {"method": "magic"},
            "no method 'magic'; available: recorded, exponential, log_law, log_law_early",
        ),
        ({"time_s": [], "values": []}, "no sample"),
    ],
)
def test_predict_settled_with_invalid_input_raises_a_one_line_error(
    change: dict, message: str
) -> None:
    arguments = {"time_s": TIME_S, "values": HOLD, "cutoff_s": 2.5, "method": "exponential"}
    arguments |= change
    with pytest.raises(InputError, match=message) as refusal:
        predict_settled(arguments.pop("time_s"), arguments.pop("values"), **arguments)
    assert isinstance(refusal.value, ValueError)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("method", "from_s"), [("log_law", 0.2), ("log_law_early", 0.4)])
def test_log_law_is_exact_for_logarithmic_creep(method: str, from_s: float) -> None:
    creep = 50.0 - 3.0 * np.log(TIME_S + from_s)
    for cutoff_s in (1.0, 2.5):
        found = predict_settled(TIME_S, creep, cutoff_s=cutoff_s, method=method)
        assert found.value == pytest.approx(50.0 - 3.0 * np.log(20.0 + from_s), rel=1e-9)


def test_log_law_extrapolates_a_logarithm_from_the_peak_of_each_hold() -> None:
    time_s = np.arange(0, 4, 0.1)
    since = np.stack([time_s, time_s - time_s[3]])
    holds = np.where(since < 0, 8.0, 9 - 0.7 * np.log(np.maximum(since, 0) + 0.2))
    found = predict_settled(time_s, holds, cutoff_s=4.0, method="log_law")
    assert found.value == pytest.approx(9 - 0.7 * np.log(20.2 - np.array([0, time_s[3]])))
    assert found.status.tolist() == [Status.OK, Status.OK]
