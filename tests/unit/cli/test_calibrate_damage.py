"""`palpate calibrate damage`, and `palpate grasp` with a learned damage limit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.closings import write_closings, write_damage_file
from tests.commands import Command

from palpate.object.damage_file import DamageFile


@pytest.fixture(scope="module")
def damage_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_damage_file(tmp_path_factory.mktemp("damage"), melons=20)


@pytest.mark.slow
def test_calibrate_damage_real_fruit_excludes_the_duplicate(
    real_data: Path, tmp_path: Path, palpate: Command
) -> None:
    options = [
        *("--curves", str(real_data / "fruit_rupture.csv.gz")),
        *("--index", str(real_data / "fruit_rupture_index.csv")),
        *("--out", str(tmp_path / "damage.json")),
    ]
    output = palpate("calibrate", "damage", *options).out
    assert "learned from 162 closings (68 banana, 32 kiwi, 62 mango)" in output
    assert "excluded: banana-55, the same recording as banana-54" in output
    assert "usable: stiffness predicts the strength of banana, kiwi, mango" in output
    made = DamageFile.load(tmp_path / "damage.json")
    assert made.kinds == ("banana", "kiwi", "mango")
    assert set(made.learned_from) == {"fruit_rupture.csv.gz", "fruit_rupture_index.csv"}
    for kind in made.kinds:
        assert made.held_out[kind].error_percent < made.held_out[kind].median_error_percent


def test_calibrate_damage_reports_weak_evidence(tmp_path: Path, palpate: Command) -> None:
    """The strength is independent of the stiffness, and one kind has few closings."""
    rng = np.random.default_rng(1)
    curves, index = ["grasp_id,closure_mm,force_n"], ["grasp_id,fruit,rupture_force_n"]
    for number in range(44):
        stiffness, fruit = np.exp(0.5 * rng.standard_normal()), "plum" if number < 40 else "pear"
        index.append(f"p{number},{fruit},{4.0 + 0.05 * rng.standard_normal():.3f}")
        curves += [f"p{number},{x:.2f},{stiffness * x:.4f}" for x in np.linspace(0.1, 15, 300)]
    (tmp_path / "curves.csv").write_text("\n".join(curves) + "\n")
    (tmp_path / "index.csv").write_text("\n".join(index) + "\n")
    files = ["--curves", str(tmp_path / "curves.csv"), "--index", str(tmp_path / "index.csv")]
    output = palpate("calibrate", "damage", *files, "--out", tmp_path / "damage.json").out
    assert "plum: stiffness does not predict the strength" in output
    assert "pear: too few closings for a separate limit (4)" in output
    assert "usable" not in output
    options = write_closings(tmp_path, count=12)
    shown = palpate("calibrate", "damage", *options, "--out", tmp_path / "damage.json").out
    assert "kiwi: too few closings for held-out validation (12)" in shown


@pytest.mark.parametrize(
    ("count", "out", "message"),
    [
        (11, "damage.json", "11 usable closings, but at least 12 are needed"),
        (12, "index.csv", "index.csv is an input"),
    ],
)
def test_calibrate_damage_refused_writes_nothing(
    count: int, out: str, message: str, tmp_path: Path, palpate: Command
) -> None:
    options = write_closings(tmp_path, count=count)
    index = (tmp_path / "index.csv").read_text()
    assert message in palpate.refused("calibrate", "damage", *options, "--out", tmp_path / out)
    assert not (tmp_path / "damage.json").exists()
    assert (tmp_path / "index.csv").read_text() == index


@pytest.mark.slow
def test_grasp_damage_limit_protects_kiwi_and_is_replayed(
    damage_file: Path, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "grasp.mcap"
    grasp = ["grasp", "--object", "kiwi", "--seed", "3", "--rate-hz", "50", "--json"]
    grasp += ["--target-force-n", "4"]
    # A crushed kiwi yields, which ends the grasp.
    unlimited = palpate(*grasp, status=3).document
    assert unlimited["outcome"] == "sensor_lost"
    assert unlimited["damage_limit"] is None
    assert unlimited["truth"]["damaged"] is True
    limits = ("--damage", damage_file, "--kind", "kiwi")
    limited = palpate(*grasp, *limits, "--record", path).document
    assert limited["truth"]["damaged"] is False
    limit = limited["damage_limit"]
    assert (limit["kind"], limit["closings"], limit["rate"]) == ("kiwi", 40, 0.01)
    assert limit["kept_below_target"] is True
    assert 0 < limit["low_n"] < 4
    # The limit is below the smallest force that the sheet resolves, so the first touch exceeds it.
    assert limit["passed"] is (limited["peak_force_n"] > limit["low_n"]) is True
    assert limited["truth"]["peak_force_n"] < 0.7 * unlimited["truth"]["peak_force_n"]
    again = palpate("replay", path, "--json").document
    for name in ("outcome", "force_n", "peak_force_n", "moments"):
        assert again[name] == limited[name]
