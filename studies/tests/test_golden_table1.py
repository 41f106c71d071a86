"""The paper's Table 1 on the twin: fitted entries are reproduced, the others scored."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest

from palpate_studies import table1
from palpate_studies.report import StudyReport
from palpate_studies.twin_session import twin_holds


@pytest.fixture(scope="module")
def report() -> StudyReport:
    """Run the study on two sensors: 40 holds."""
    return table1.report(repeats=2)


@pytest.fixture(scope="module")
def payload(report: StudyReport) -> dict[str, Any]:
    return dict(report.payload)


def means(payload: dict[str, Any], method: str) -> np.ndarray:
    rows = payload["families"]["two-mode"][method]
    return np.array([row["mean_abs_error_percent"] for row in rows])


@pytest.mark.slow
def test_table1_fitted_family_reproduces_recorded_row(payload: dict[str, Any]) -> None:
    # With 40 holds of random relaxation, the standard error is about 4 % of each entry. The twin
    # also has effects that its fit did not have (relaxation of the pads, closing time).
    ours, published = means(payload, "recorded"), np.array(table1.PUBLISHED["recorded"])
    np.testing.assert_allclose(ours, published, rtol=0.2, atol=0.1)


def test_table1_exponential_is_near_published_errors(payload: dict[str, Any]) -> None:
    # The published values are means. A short window does not determine C on some single holds,
    # which dominate the mean of 40: from 2 to 3 s the family misses the published values (3.4 on
    # ten sensors instead of 2.5, see docs/paper-notes.md). The medians are near everywhere.
    published = np.array(table1.PUBLISHED["exponential"])
    rows = payload["families"]["two-mode"]["exponential"]
    medians = np.array([row["median_abs_error_percent"] for row in rows]) / published
    assert np.all((medians > 0.7) & (medians < 1.5))
    ratio = means(payload, "exponential") / published
    assert np.all((ratio > 0.6) & (ratio < np.where(np.arange(ratio.size) < 4, 1.8, 1.2)))


def test_table1_payload_names_calibration_inputs(payload: dict[str, Any]) -> None:
    used = payload["calibration_inputs"]["two-mode"]
    assert used == {"recorded": list(table1.CUTOFFS_S), "exponential": [2.5, 10.0]}
    misfit = payload["misfit"]["two-mode"]
    assert (misfit["fitted"]["entries"], misfit["predicted"]["entries"]) == (14, 11)
    assert payload["origin"] == "twin"
    assert set(payload["families"]["two-mode"]) >= {"recorded", "exponential", "relaxation"}


def test_twin_holds_fall_and_settle() -> None:
    first, *_, last = islice(twin_holds(repeats=1), 5)
    assert (first.hold_id, last.hold_id) == ("0/ecoflex-10/2", "0/ecoflex-10/4")
    for hold in (first, last):
        assert hold.time_s[-1] >= 20.0
        assert np.argmax(hold.values) < 15
        assert hold.values[-1] < hold.values[30] < hold.values[15]
    assert last.values[-1] < first.values[-1]
