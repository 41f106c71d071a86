"""The logarithmic baseline predictor."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.measurement import Status
from palpate.settling.baselines import LogLaw


def test_log_law_extrapolates_a_logarithm_from_the_peak_of_each_hold() -> None:
    time_s = np.arange(0, 4, 0.1)
    since = np.stack([time_s, time_s - time_s[3]])
    holds = np.where(since < 0, 8.0, 9 - 0.7 * np.log(np.maximum(since, 0) + 0.2))
    estimate = LogLaw().predict(time_s, holds, horizon_s=20.0, level=0.9)
    expected = 9 - 0.7 * np.log(20.2 - np.array([0, time_s[3]]))
    assert estimate.value == pytest.approx(expected)
    assert estimate.status.tolist() == [Status.OK, Status.OK]


def test_log_law_with_two_samples_returns_the_last_sample() -> None:
    estimate = LogLaw().predict(
        np.array([0.0, 0.5, 0.7]), np.array([[5.0, 4.0, 3.0]]), horizon_s=20.0, level=0.9
    )
    assert estimate.value.tolist() == [3.0]
    assert estimate.status.tolist() == [Status.TOO_SHORT]
