"""Scores: settled values, percentages, unknown values and bootstrap intervals."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.holds import find_recorded_value, measure_settled_value
from palpate.measurement import Status
from palpate.scoring.predictions import Prediction, summarise
from palpate_studies.bootstrap import bootstrap_interval


def test_measure_settled_value_is_the_mean_of_the_last_half_second_up_to_the_horizon() -> None:
    time_s = np.array([0.0, 19.4, 19.5, 19.75, 20.0, 20.25])
    values = np.array([9.0, 8.0, 1.0, 2.0, 6.0, 100.0])
    assert measure_settled_value(time_s, values, horizon_s=20.0) == 3.0
    for time_s, reaches in (
        (np.array([0.0, 10.0, 30.0]), False),
        (np.arange(0, 19.91, 0.05), False),
        (np.arange(0, 19.96, 0.05), True),
    ):
        settled = measure_settled_value(time_s, np.ones(time_s.size), horizon_s=20.0)
        assert np.isfinite(settled) == reaches


def test_find_recorded_value_includes_the_sample_at_the_cutoff() -> None:
    time_s = np.array([0.5, 1.0, 2.0])
    assert find_recorded_value(time_s, 10 * time_s, cutoff_s=2.0) == 20.0
    assert find_recorded_value(time_s, 10 * time_s, cutoff_s=1.99) == 10.0
    assert np.isnan(find_recorded_value(time_s, time_s, cutoff_s=0.4))


def test_summarise_ignores_unknown_values() -> None:
    fixed = {"hold_id": "a", "method": "m", "cutoff_s": 1.0, "status": Status.OK}
    rows = [
        Prediction(
            predicted=value,
            low=value - half,
            high=value + half,
            settled=known,
            recorded=last,
            **fixed,
        )
        for value, half, known, last in (
            (101.0, 2.0, 100.0, 110.0),
            (98.0, 1.0, 100.0, 104.0),
            (103.0, 1.0, 100.0, 106.0),
            (7.0, 1.0, np.nan, 9.0),
            (1.0, 1.0, 0.0, 1.0),
        )
    ]
    *scores, no_base = rows
    summary = summarise(scores)
    assert summary["median_abs_error_percent"] == 2.0
    assert summary["mean_abs_error_percent"] == 2.0
    assert summary["p90_abs_error_percent"] == pytest.approx(2.8)
    assert summary["median_error_of_remaining_percent"] == 50.0
    assert summary["coverage"] == pytest.approx(1 / 3)
    assert summary["median_half_width_percent"] == 1.0
    assert np.isnan(no_base.error_percent)
    assert (no_base.of_remaining_percent, no_base.coverage) == (100.0, 1.0)


def test_bootstrap_interval_resamples_specimens_not_holds() -> None:
    values = np.repeat([0.0, 1.0], 50)
    groups = ["a"] * 50 + ["b"] * 50
    by_specimen = bootstrap_interval(values, groups, statistic=np.mean)
    by_hold = bootstrap_interval(values, [str(i) for i in range(100)], statistic=np.mean)
    assert by_specimen == (0.0, 1.0)
    assert 0.4 < by_hold[0] < by_hold[1] < 0.6
