"""Scores: settled values, percentages, unknown values and bootstrap intervals."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.holds import find_recorded_value, measure_settled_value
from palpate.scoring.predictions import Prediction, summarise
from palpate.settling.result import Status
from palpate_studies.bootstrap import bootstrap_interval


def predictions(predicted, *, low, high, settled, recorded) -> list[Prediction]:
    return [
        Prediction(
            hold_id="a",
            method="m",
            cutoff_s=1.0,
            status=Status.OK,
            predicted=one,
            low=bottom,
            high=top,
            settled=target,
            recorded=last,
        )
        for one, bottom, top, target, last in zip(
            predicted, low, high, settled, recorded, strict=True
        )
    ]


def test_measure_settled_value_is_the_mean_of_the_last_half_second() -> None:
    time_s = np.array([0.0, 19.4, 19.5, 19.75, 20.0, 20.25])
    values = np.array([9.0, 8.0, 1.0, 2.0, 6.0, 100.0])
    assert measure_settled_value(time_s, values, horizon_s=20.0) == 3.0


@pytest.mark.parametrize(
    ("last_s", "reaches"), [(19.9, False), (19.95, True), (20.0, True), (25.0, True)]
)
def test_measure_settled_value_requires_samples_up_to_the_horizon(
    last_s: float, reaches: bool
) -> None:
    time_s = np.arange(0, last_s + 0.01, 0.05)
    settled = measure_settled_value(time_s, np.ones(time_s.size), horizon_s=20.0)
    assert np.isfinite(settled) == reaches


def test_measure_settled_value_without_samples_near_the_horizon_is_nan() -> None:
    time_s = np.array([0.0, 10.0, 30.0])
    assert np.isnan(measure_settled_value(time_s, time_s, horizon_s=20.0))
    assert np.isnan(measure_settled_value(time_s[:1], time_s[:1], horizon_s=20.0))


def test_find_recorded_value_includes_the_sample_at_the_cutoff() -> None:
    time_s = np.array([0.5, 1.0, 2.0])
    assert find_recorded_value(time_s, 10 * time_s, cutoff_s=2.0) == 20.0
    assert find_recorded_value(time_s, 10 * time_s, cutoff_s=1.99) == 10.0
    assert np.isnan(find_recorded_value(time_s, time_s, cutoff_s=0.4))


def test_prediction_percentages_without_a_base_are_nan() -> None:
    scores = predictions(
        [1.0, 1.0, 1.0],
        low=[np.nan, 0.0, 0.0],
        high=[np.nan, 2.0, 2.0],
        settled=[2.0, 0.0, np.nan],
        recorded=[2.0, 1.0, 1.0],
    )
    np.testing.assert_array_equal([row.error_percent for row in scores], [-50.0, np.nan, np.nan])
    np.testing.assert_array_equal(
        [row.of_remaining_percent for row in scores], [np.nan, 100.0, np.nan]
    )
    np.testing.assert_array_equal([row.coverage for row in scores], [np.nan, 1.0, np.nan])


def test_summarise_ignores_unknown_values() -> None:
    scores = predictions(
        [101.0, 98.0, 103.0, 7.0],
        low=[99.0, 97.0, 102.0, 6.0],
        high=[103.0, 99.0, 104.0, 8.0],
        settled=[100.0, 100.0, 100.0, np.nan],
        recorded=[110.0, 104.0, 106.0, 9.0],
    )
    summary = summarise(scores)
    assert summary["median_abs_error_percent"] == 2.0
    assert summary["mean_abs_error_percent"] == 2.0
    assert summary["p90_abs_error_percent"] == pytest.approx(2.8)
    assert summary["median_error_of_remaining_percent"] == 50.0
    assert summary["coverage"] == pytest.approx(1 / 3)
    assert summary["median_half_width_percent"] == 1.0


def test_bootstrap_interval_resamples_specimens_not_holds() -> None:
    values = np.repeat([0.0, 1.0], 50)
    groups = ["a"] * 50 + ["b"] * 50
    by_specimen = bootstrap_interval(values, groups, statistic=np.mean)
    by_hold = bootstrap_interval(values, [str(i) for i in range(100)], statistic=np.mean)
    assert by_specimen == (0.0, 1.0)
    assert 0.4 < by_hold[0] < by_hold[1] < 0.6


def test_bootstrap_interval_of_one_specimen_is_nan() -> None:
    assert np.isnan(bootstrap_interval(np.arange(5.0), ["a"] * 5, statistic=np.median)).all()
