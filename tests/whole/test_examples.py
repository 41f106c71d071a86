"""Every example runs as for a user and prints the documented output."""

from __future__ import annotations

import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.commands import Command

from palpate.rig import Rig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    def run_example(name: str, *arguments: str, as_main: bool = True) -> dict[str, Any]:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        return runpy.run_path(str(EXAMPLES / name), run_name="__main__" if as_main else "example")

    return run_example


@pytest.mark.slow
def test_own_gripper_grasps_and_measures(run: Any, capsys: pytest.CaptureFixture[str]) -> None:
    run("own_gripper.py")
    printed = capsys.readouterr().out
    assert printed.startswith("held (simulated)")
    found = re.findall(r"(\w+): ([\d.]+) \(([\d.]+) to ([\d.]+)\), true value ([\d.]+)", printed)
    assert [name for name, *_ in found] == ["size_mm", "stiffness_n_per_mm"]
    for _, value, low, high, true in found:
        assert float(low) <= float(value) <= float(high)
        assert float(low) <= float(true) <= float(high)


def test_own_gripper_is_open_after_its_grasp(run: Any) -> None:
    import palpate

    rig = run("own_gripper.py", as_main=False)["open_mine"](seed=4)
    plan = palpate.plan_grasp(rig.calibration, gripper=rig.gripper)
    palpate.run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
    assert rig.gripper.state().width_mm == pytest.approx(rig.gripper.limits.highest, abs=0.5)


@pytest.mark.slow
def test_own_rig_from_an_entry_point_grasps_on_the_command_line(
    run: Any, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_mine = run("own_gripper.py", as_main=False)["open_mine"]

    def open_untold(**options: Any) -> Rig:
        return replace(open_mine(**options), truth=None)

    entries = [
        SimpleNamespace(name="mine", load=lambda: open_mine),
        SimpleNamespace(name="untold", load=lambda: open_untold),
    ]
    monkeypatch.setattr("palpate.rig.entry_points", lambda *, group: entries)
    words = ("grasp", "--seed", "1", "--target-force-n", "6", "--rig")
    card = palpate(*words, "mine").out
    assert "SIMULATED" in card
    assert "true" in card
    document = palpate(*words, "untold", "--json").document
    assert document["simulated"] is True
    assert "truth" not in document


@pytest.mark.slow
def test_offline_analysis_prints_settled_values_and_scores_and_draws(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("offline_analysis.py")
    printed = capsys.readouterr().out
    assert printed.startswith("simulated recordings")
    errors: dict[str, list[float]] = {}
    for name, median in re.findall(r"(\w+) +[\d.]+ s +12 +([\d.]+) ", printed):
        errors.setdefault(name, []).append(float(median))
    assert errors["relaxation"][0] < 0.5 * min(errors["exponential"][0], errors["recorded"][0])
    assert errors["relaxation"][1] < min(errors["exponential"][1], errors["recorded"][1])
    answers = re.findall(r"Hold\(.*: (\d+) \((\d+) to (\d+)\)", printed)
    assert len(answers) == 12
    for value, low, high in answers:
        assert float(low) < float(value) < float(high)
    assert (tmp_path / "holds.png").stat().st_size > 10_000


def test_offline_analysis_accepts_user_recording(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"{0.1 * k:.1f},{90 if k < 20 else 50 + 5 * 0.9 ** (k - 20):.3f}" for k in range(80)]
    (tmp_path / "mine.csv").write_text("\n".join(["time_s,ohm", *lines]))
    run("offline_analysis.py", "mine.csv")
    printed = capsys.readouterr().out
    assert printed.count("mine:ohm:1") == 1
    assert "simulated" not in printed


@pytest.mark.slow
def test_understand_prediction_draws_four_pictures(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("understand_prediction.py", "pictures")
    drawn = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert [name[:2] for name in drawn] == ["1-", "2-", "3-", "4-"]
    errors = dict(re.findall(r"  (\w+): ([\d.]+) %", capsys.readouterr().out))
    assert float(errors["relaxation"]) < float(errors["exponential"]) < float(errors["recorded"])


@pytest.mark.slow
def test_pick_and_place_prints_forces_and_releases(
    run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    run("pick_and_place.py")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("Grip(held, size ")
    forces = [float(line.split()[2]) for line in lines[1:-1]]
    assert len(forces) == 10
    assert all(1.0 < force < 4.0 for force in forces)
    assert lines[-1] == "held (simulated)"


@pytest.mark.slow
def test_learn_from_grasps_force_cap_prevents_damage(
    run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    run("learn_from_grasps.py", "1", "1")
    free, capped = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"no cap: \d of 1 held undamaged at 1 N or more, \d damaged; .*", free)
    assert re.match(r"cap 4 N: \d of 1 held undamaged", capped)
    # The cap is kept by the calibration's 90 % interval.
    assert float(re.findall(r"largest ([\d.]+) N", capped)[0]) < 4.8
