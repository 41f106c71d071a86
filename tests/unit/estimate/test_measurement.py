"""Values and bounds of measurements."""

from __future__ import annotations

import pytest

from palpate.grasp.verdict import firmness
from palpate.measurement import Measurement


def stiffness(low: float, high: float) -> Measurement:
    found = Measurement(value=(low * high) ** 0.5, low=low, high=high, unit="n_per_mm")
    return found.or_bound("it gave way too little", least=0.02, most=500.0)


@pytest.mark.parametrize(
    ("low", "high", "status", "ends", "word"),
    [
        (2.0, 8.0, "ok", (2.0, 8.0), "soft to medium"),
        (2.0, 8.1, "at_least", (2.0, None), "at least soft"),
        (0.36, 500.0, "at_least", (0.36, None), "firmness not measured"),
        (0.02, 0.5, "at_most", (None, 0.5), "very soft"),
        (0.02, 500.0, "not_measured", (None, None), "firmness not measured"),
        (0.0, 1.0, "at_most", (None, 1.0), "very soft"),
    ],
)
def test_or_bound_returns_value_or_bound(
    low: float, high: float, status: str, ends: tuple[float | None, ...], word: str
) -> None:
    found = stiffness(low, high)
    said = found.to_dict()
    assert (said["low"], said["high"]) == ends == found.known_ends
    assert said["status"] == status
    assert (said["value"] is None) == (found.value is None) == (status != "ok")
    assert found.middle == pytest.approx((low * high) ** 0.5 if found.has_value or low > 0 else 0.5)
    assert (said["reason"] is None) == (status == "ok")
    assert firmness(found) == word
