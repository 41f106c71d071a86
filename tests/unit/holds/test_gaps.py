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


def test_lost_readings_during_a_hold_do_not_end_it() -> None:
    values = np.where((TIME_S > 12.0) & (TIME_S < 13.0), np.nan, OHM)
    [readings] = read_recordings({"time_s": TIME_S, "R_ohm": values})
    [cut] = cut_columns(readings)
    assert [round(end_s) for _, end_s in cut.spans] == [25, 54, 83]
    assert not any("rest" in remark for remark in cut.remarks)


def test_readings_that_begin_late_at_rest_are_no_contact() -> None:
    values = np.where(TIME_S < 1.0, np.nan, OHM)
    [readings] = read_recordings({"time_s": TIME_S, "R_ohm": values})
    [cut] = cut_columns(readings)
    assert [round(begin_s) for begin_s, _ in cut.spans] == [2, 30, 60]
