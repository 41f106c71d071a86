"""`palpate bench`: every figure is a ratio to a peer of the same run."""

from __future__ import annotations

import importlib.util
import json

import pytest
from tests.commands import run_palpate

from palpate_studies.benchmarks.running import Ratio, row
from palpate_studies.catalogue import BENCHMARKS


@pytest.fixture
def frames_alone(monkeypatch) -> None:
    """Register only the quickest benchmark, and hide FlexiTac's package."""
    for name in set(BENCHMARKS) - {"all", "frames"}:
        monkeypatch.delitem(BENCHMARKS, name)
    known = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "flexitac" else known(name)
    )


def ratio(**changed: object) -> Ratio:
    defaults = {"what": "act", "size": 1, "of": "holds", "peer": "p", "ours": 2.0, "theirs": 3.0}
    return Ratio(**(defaults | changed))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.usefixtures("frames_alone")
def test_bench_without_name_runs_all_and_shows_how_to_install_a_missing_peer(
    tmp_path, capsys
) -> None:
    assert run_palpate("bench", "--json", "--out", str(tmp_path)) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"machine", "full", "benchmarks"}
    [found] = document["benchmarks"]
    assert found["name"] == "frames"
    assert {one["peer"] for one in found["ratios"]} == {"readline of CSV", "FlexiTac's package"}
    assert all(one["ours"] > 0 for one in found["ratios"])
    shown = (tmp_path / "bench.md").read_text()
    for words in ("not installed", "flexitac", "pip install flexitac"):
        assert words in shown


def test_ratio_is_missed_only_below_requirement_of_installed_peer() -> None:
    assert ratio().times == 1.5
    assert not ratio(wanted=1.5).is_missed
    assert ratio(wanted=1.6).is_missed
    assert not ratio(wanted=9.0, theirs=None).is_missed
    assert row(ratio(wanted=1.6)) == ("act", "1 hold", "p", "2 s", "3 s", "1.5", "1.6, missed")
