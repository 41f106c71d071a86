"""Peak and fit window of a hold."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.signal.transient import find_hold_window, find_peak


@pytest.mark.parametrize(
    ("values", "peak"),
    [
        ([0.0, 4.0, 9.0, -3.0, -20.0], 2),
        ([5.0, 1.0, 3.0, 20.0], 1),
        ([9.0, 5.0, 3.0, 2.9, 3.05], 0),
    ],
    ids=["falling", "rising", "noise at the end"],
)
def test_find_peak_is_where_the_hold_begins_to_settle(values: list[float], peak: int) -> None:
    assert find_peak(values) == peak


def test_find_hold_window_starts_the_wait_after_the_peak_of_each_hold() -> None:
    time_s = np.arange(10) / 10
    values = np.stack([-time_s, np.where(time_s < 0.2, 0, 1 - time_s)])
    window = find_hold_window(time_s, values, wait_s=0.5)
    assert window.peak_s.tolist() == [0.0, 0.2]
    assert window.first.tolist() == [5, 7]


def test_find_hold_window_includes_a_sample_at_the_end_of_the_wait_despite_rounding() -> None:
    assert 0.1 + 0.2 > 0.3
    window = find_hold_window([0.0, 0.1, 0.2, 0.3, 0.4], [[0.0, 9.0, 1.0, -3.0, -9.0]], wait_s=0.2)
    assert window.first.tolist() == [3]
