"""The study of ripeness at its smallest size."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from palpate_studies import ripeness, ripeness_station

pytestmark = pytest.mark.slow


def test_ripeness_study_judges_every_fruit_day_with_every_method(
    document: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ripeness, "LABELLED", 4)
    monkeypatch.setattr(ripeness_station, "LABELLED_GRASPS", 2)
    monkeypatch.setattr(ripeness_station, "MOST_GRASPS", 1)
    one = ["--level", "lab", "--gripper", "rigid", "--no-aging", "--fruits", "2"]
    (found,) = document("ripeness", *one)["conditions"]
    assert (found["aging"], found["fruits"], found["fruit_days"]) == (False, 2, 8)
    assert found["ours"]["exact"] >= 0.5
    assert {row["rival"] for row in found["compared"]} >= {"settled change", "trees"}


def test_ripeness_command_without_matching_condition_is_refused(
    refusal: Callable[..., str],
) -> None:
    asked = ["--level", "field", "--gripper", "soft", "--no-aging"]
    assert "leave --no-aging out" in refusal("ripeness", *asked)
