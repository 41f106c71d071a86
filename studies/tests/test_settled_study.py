"""The study of settled values: output, held-out materials, rules and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate.holds import Hold
from palpate_studies import settled

CREEP = {"a": (0.03, 0.3), "b": (0.06, 1.0), "c": (0.1, 0.1)}


def run_study(*arguments: object) -> int:
    return run(build_app(), ["study", "settled", *map(str, arguments)], name="palpate")


def holds(name: str, count: int) -> list[Hold]:
    rng = np.random.default_rng([*name.encode()])
    slope, from_s = CREEP[name]
    time_s = np.arange(0.0, 20.5, 0.1)
    return [
        Hold(
            hold_id=f"{name}_h{number}",
            channel=None,
            time_s=time_s,
            values=rng.uniform(50, 500)
            * np.exp(-slope * np.log(time_s + from_s) + 2e-4 * rng.standard_normal(time_s.size)),
        )
        for number in range(count)
    ]


def write_holds(folder: Path, name: str, count: int = 5) -> Path:
    lines = ["hold_id,time_s,value"]
    for hold in holds(name, count):
        pairs = zip(hold.time_s, hold.values, strict=True)
        lines += [f"{hold.hold_id},{t:.2f},{v}" for t, v in pairs]
    path = folder / f"holds_{name}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_settled_study_scores_every_method_on_every_material(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settled, "SINGLE_HOLDS", 2)
    a, b, c = (write_holds(tmp_path, name) for name in "abc")
    assert run_study("--holds", a, "--holds", b, "--held-out", c, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    rows = document["rows"]
    without = [row for row in rows if row["own_holds"] == 0]
    rules = {settled.PALPATE, *settled.PLAIN, "multiple", "ridge"}
    for material in "abc":
        found = {row["method"] for row in without if row["material"] == material}
        assert found == rules
        own = [row for row in rows if (row["material"], row["own_holds"]) == (material, 3)]
        assert {row["method"] for row in own} == {settled.PALPATE, "log_law"}
    assert {row["material"] for row in without} == {*"abc", settled.SINGLE}
    assert set(rows[0]) == {
        "material",
        "cutoff_s",
        "method",
        "holds",
        "median_abs_error_percent",
        "p90_abs_error_percent",
        "bias_percent",
        "coverage",
        "half_width_percent",
        "share_ok",
        "own_holds",
    }
    assert min(row["regret"] for row in document["regret"]) == pytest.approx(1.0, abs=0.5)


def test_fit_multiple_uses_other_materials_only() -> None:
    shown = {name: [settled.extract_features(h, 2.5) for h in holds(name, 4)] for name in "ab"}
    [one] = [settled.extract_features(h, 2.5) for h in holds("c", 1)]
    rule = settled.fit_multiple(shown)
    changes = [each.change for some in shown.values() for each in some]
    assert min(changes) <= rule(one) <= max(changes)
    assert abs(rule(one) - one.change) > 0.02


def test_share_holds_detects_files_with_common_holds() -> None:
    assert settled._share_holds(holds("a", 2), holds("a", 3))
    assert not settled._share_holds(holds("a", 2), holds("b", 2))


def test_fit_ridge_recovers_common_relation() -> None:
    others = {name: [settled.extract_features(h, 5.0) for h in holds(name, 6)] for name in "ac"}
    rule = settled.fit_ridge(others)
    for one in (settled.extract_features(h, 5.0) for h in holds("a", 2)):
        assert rule(one) == pytest.approx(one.change, rel=0.1)


def test_settled_study_of_one_material_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_study("--holds", write_holds(tmp_path, "a")) == 2
    assert "two materials" in capsys.readouterr().err


def test_settled_study_of_negative_values_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_holds(tmp_path, "a")
    negative = tmp_path / "holds_n.csv"
    negative.write_text(path.read_text().replace("_h0,0.50,", "_h0,0.50,-"))
    assert run_study("--holds", path, "--holds", negative) == 2
    assert "not positive" in capsys.readouterr().err
