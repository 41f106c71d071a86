"""The study of settled values: output, held-out materials, rules and refusals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies import settled

CREEP = {"a": (0.03, 0.3), "b": (0.06, 1.0), "c": (0.1, 0.1)}


def write_holds(folder: Path, name: str, count: int = 5) -> Path:
    rng = np.random.default_rng([*name.encode()])
    slope, from_s = CREEP[name]
    time_s = np.arange(0.0, 20.5, 0.1)
    lines = ["hold_id,time_s,value"]
    for number in range(count):
        noise = 2e-4 * rng.standard_normal(time_s.size)
        values = rng.uniform(50, 500) * np.exp(-slope * np.log(time_s + from_s) + noise)
        pairs = zip(time_s, values, strict=True)
        lines += [f"{name}_h{number},{t:.2f},{v}" for t, v in pairs]
    path = folder / f"holds_{name}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_settled_study_scores_every_method_on_every_material(
    tmp_path: Path, document: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settled, "DRAWN_HOLDS", 2)
    a, b, c = (write_holds(tmp_path, name) for name in "abc")
    found = document("settled", "--holds", a, "--holds", b, "--held-out", c)
    rows = found["rows"]
    without = [row for row in rows if row["own_holds"] == 0]
    methods = {settled.PALPATE, *settled.PLAIN, "log_law_fitted", "multiple", "ridge"}
    for material in "abc":
        assert {row["method"] for row in without if row["material"] == material} == methods
        own = [row for row in rows if (row["material"], row["own_holds"]) == (material, 3)]
        assert {row["method"] for row in own} == {settled.PALPATE, "log_law"}
    drawn = {row["material"] for row in without} - {*"abc"}
    assert len(drawn) == 5
    # All three materials follow a logarithm, and end before the far horizon.
    assert {one["material"]: round(one["median"]) for one in found["pace"]} == dict.fromkeys(
        "abc", 1
    )
    assert found["far"] == []
    assert sum(one["predictions"] for one in found["statuses"]) == 45
    # The law with a fitted offset is exact here, and not among the simple rules.
    rules = [row["regret"] for row in found["regret"] if row["method"] != "log_law_fitted"]
    assert min(rules) == pytest.approx(1.0, abs=0.5)


def test_settled_study_of_one_material_or_negative_values_is_refused(
    tmp_path: Path, refusal: Callable[..., str]
) -> None:
    path = write_holds(tmp_path, "a")
    assert "two materials" in refusal("settled", "--holds", path)
    negative = tmp_path / "holds_n.csv"
    negative.write_text(path.read_text().replace("_h0,0.50,", "_h0,0.50,-"))
    assert "not positive" in refusal("settled", "--holds", path, "--holds", negative)
