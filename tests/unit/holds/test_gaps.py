"""A sensor without a reading at rest keeps all of its contacts."""

from __future__ import annotations

import numpy as np
import pytest
from tests.touches import TOUCHES, resistance_ohm

from palpate.holds.cutting import cut_columns
from palpate.holds.recordings import read_recordings

TIME_S = np.arange(0.0, 88.0, 0.05)
OHM = resistance_ohm(TIME_S)
TOUCHED = np.any([(close <= TIME_S) & (open_ > TIME_S) for close, open_ in TOUCHES], axis=0)
READINGS = {
    "R_ohm": OHM,
    "counts": np.rint(1023 * 470.0 / (470.0 + OHM)),
    "U_volt": 3.3 * OHM / (470.0 + OHM),
    "value": OHM,
    "force_n": 900.0 / OHM,
}


@pytest.mark.parametrize("column", READINGS)
@pytest.mark.parametrize("rest", [np.nan, np.inf])
def test_contacts_without_reading_at_rest_are_all_found(column: str, rest: float) -> None:
    values = np.where(TOUCHED, READINGS[column], rest)
    [readings] = read_recordings({"time_s": TIME_S, column: values})
    [cut] = cut_columns(readings)
    assert len(cut.holds) == len(TOUCHES)
    for hold, (begin_s, end_s), (close_s, open_s) in zip(
        cut.holds, cut.spans, TOUCHES, strict=True
    ):
        assert begin_s == pytest.approx(close_s + 0.2, abs=0.25)
        assert end_s == pytest.approx(open_s, abs=0.1)
        assert np.isfinite(hold.values).all()
    assert any("no readings at rest" in remark for remark in cut.remarks)
    assert np.isnan(cut.values[~TOUCHED]).all()


def test_clock_that_jumps_by_years_neither_fills_the_memory_nor_moves_a_hold() -> None:
    jumped_s = TIME_S + np.where(0.5 * (TOUCHES[-1][1] + TIME_S[-1]) < TIME_S, 1.8e9, 0.0)
    each = []
    for time_s in (TIME_S, jumped_s):
        [readings] = read_recordings({"time_s": time_s, "R_ohm": OHM})
        each.append(cut_columns(readings)[0].spans)
    np.testing.assert_allclose(*each)


def test_lost_readings_during_a_hold_do_not_end_it() -> None:
    values = np.where((TIME_S > 12.0) & (TIME_S < 13.0), np.nan, OHM)
    [readings] = read_recordings({"time_s": TIME_S, "R_ohm": values})
    [cut] = cut_columns(readings)
    assert [round(end_s) for _, end_s in cut.spans] == [25, 54, 83]
    assert not any("rest" in remark for remark in cut.remarks)


@pytest.mark.parametrize("step_s", [0.05, 0.5])
def test_equal_contacts_between_blanks_are_all_found(step_s: float) -> None:
    """The first readings of a contact soon reach the level of the contact before."""
    time_s = np.arange(0.0, 132.0, step_s)
    since_s = time_s % 33.0 - 8.0
    ohm = 4600.0 + 1e4 * np.exp(-np.maximum(since_s, 0.0) / 0.04)
    ohm -= 60.0 * np.log1p(np.maximum(since_s, 0.0))
    [readings] = read_recordings({"time_s": time_s, "R_ohm": np.where(since_s >= 0, ohm, np.nan)})
    [cut] = cut_columns(readings)
    assert [begin_s for begin_s, _ in cut.spans] == pytest.approx([8, 41, 74, 107], abs=0.75)


@pytest.mark.parametrize("column", ["R_ohm", "value"])
def test_some_readings_of_the_open_sensor_hide_no_contact(column: str) -> None:
    random = np.random.default_rng(2)
    seldom = ~TOUCHED & (random.random(TIME_S.size) < 0.1)
    noise = random.uniform(2e5, 9e5, TIME_S.size)
    values = np.where(TOUCHED, OHM, np.where(seldom, noise, np.inf))
    [readings] = read_recordings({"time_s": TIME_S, column: values})
    [cut] = cut_columns(readings)
    assert len(cut.holds) == len(TOUCHES)
    for (begin_s, end_s), (close_s, open_s) in zip(cut.spans, TOUCHES, strict=True):
        assert begin_s == pytest.approx(close_s + 0.2, abs=0.6)
        assert end_s == pytest.approx(open_s, abs=0.2)
