"""`palpate calibrate rest | force | compliance | settling`, on the twin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command, run_palpate

from palpate.calibrate.rest import replace_rest
from palpate.calibration import Calibration, ForcePairs, RestValues
from palpate.cli.calibrate_force import WeightSeries, _iterate_until_tolerance, _prompt_for_loads
from palpate.force.of_calibration import sheet_law_of
from palpate.holds import read_holds
from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.world import World


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibrated") / "pad.json"
    arguments = ["calibrate", "force", "--seed", "3", "--out", str(path)]
    arguments += ["--plot", str(path.with_name("pad.png"))]
    assert run_palpate(*arguments) == 0
    return path


@pytest.mark.slow
def test_calibrate_force_file_contains_rest_and_force_readings(made: Path) -> None:
    found = Calibration.load(made)
    assert found.origin == "simulated"
    assert found.made_at is not None
    assert len(set(found.force.run)) == 6
    assert made.stat().st_size < 40_000
    for kind in ("error_percent", "early_error_percent"):
        assert 0 < found.held_out[kind]["5_n"] < 40
    assert sheet_law_of(found).noise > 0
    assert made.with_name("pad.png").stat().st_size > 10_000


@pytest.mark.slow
def test_calibrate_compliance_updates_the_force_file(made: Path, palpate: Command) -> None:
    before = Calibration.load(made)
    document = palpate("calibrate", "compliance", "--seed", "3", "--out", made, "--json").document
    assert document["simulated"] is True
    assert 0.1 < document["fingers_mm_per_n"] < 0.4
    after = Calibration.load(made)
    assert after.force == before.force
    assert len(after.block.force_n) == document["readings"]
    assert len(after.current.force_n) == document["current_readings"] > 50


@pytest.mark.parametrize(
    ("loads", "half", "message"),
    [
        ("", False, "give another --out"),
        ("", True, "incomplete or invalid JSON"),
        ("load_n\n5\n5\n5\n5\n", False, "at least 3 different weights are needed, not 1 (5 N)"),
        ("load_n\n100\n250\n500\n1000\n", False, "in grams"),
    ],
)
def test_calibrate_force_refused_leaves_the_file_of_another_sensor(
    tmp_path: Path, loads: str, half: bool, message: str, palpate: Command
) -> None:
    path, table = tmp_path / "pad.json", tmp_path / "loads.csv"
    rest = RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30)
    replace_rest(None, rest, layout=RIGID_LAYOUT, simulated=False).save(path)
    before = path.read_bytes()[: path.stat().st_size // (1 + half)]
    path.write_bytes(before)
    table.write_text(loads)
    options = ("--rig", "real.toml", "--loads", table) if loads else ()
    assert message in palpate("calibrate", "force", *options, "--out", path, status=2).err
    assert path.read_bytes() == before


def test_settle_learns_from_the_rigs_settled_holds(tmp_path: Path, palpate: Command) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('calibration = "cal.json"\n[array]\nopen = "a:b"\n[gripper]\nopen = "a:b"\n')
    time_s = [step / 10 for step in range(206)]
    for name in ("one", "two", "new"):
        rows = (f"{name},{t},{9 - 0.5 * math.log(t + 1)}" for t in time_s)
        (tmp_path / f"{name}.csv").write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    new = str(tmp_path / "new.csv")
    assert "palpate calibrate settling" in palpate("settle", new, "--rig", rig, status=2).err
    for name in ("one", "two"):
        palpate("calibrate", "settling", tmp_path / f"{name}.csv", "--rig", rig)
    stored = read_holds(tmp_path / "cal-settling.csv")
    assert [hold.hold_id for hold in stored] == ["one", "two"]
    error = palpate("calibrate", "settling", tmp_path / "two.csv", "--rig", rig, status=2).err
    assert "hold two is already in" in error
    [row] = palpate("settle", new, "--rig", rig, "--json").document["rows"]
    assert abs(row["error_percent"]) < 0.2


PAIRS = ForcePairs(
    run=(0,), since_move_s=(20.0,), excess=(1.0,), relative_percent=(-50.0,), force_n=(2.0,)
)


def test_calibrate_rest_writes_the_calibration_file_unless_the_sensor_is_loaded(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    rig = rig_file(seed=3)
    shown = palpate("calibrate", "rest", "--rig", rig).out
    made = Calibration.load(rig.parent / "sensor.json")
    assert made.rest_ohm == pytest.approx(World(None, seed=3).pixel_resistance_ohm(0.0), rel=0.01)
    assert made.rest.frames >= 75
    assert made.made_at is not None
    assert 0 < min(map(min, made.rest.spread_percent)) < 1
    assert "R3 C1" in shown
    before = (rig.parent / "sensor.json").read_text()
    err = palpate("calibrate", "rest", "--rig", rig_file(pressed=True), status=2).err
    assert "%" in err.splitlines()[-1]
    assert (rig.parent / "sensor.json").read_text() == before


def test_calibrate_rest_of_a_calibrated_rig_renews_the_rest_alone(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    rig = rig_file()
    path = rig.parent / "sensor.json"
    calibrate = ("calibrate", "rest", "--rig", rig)
    palpate(*calibrate)
    first = replace(Calibration.load(path), force=PAIRS, made_at="2020-01-01T00:00:00+00:00")
    first.save(path)
    assert palpate(*calibrate, "--json").document["renewed"] is True
    renewed = Calibration.load(path)
    assert (renewed.force, renewed.made_at) == (PAIRS, first.made_at)
    # As if the sheet had been drier at the first calibration.
    drier = tuple(tuple(1.3 * ohm for ohm in row) for row in first.rest.ohm)
    replace(first, rest=replace(first.rest, ohm=drier)).save(path)
    assert "--empty" in palpate(*calibrate, status=2).err.splitlines()[-1]
    palpate(*calibrate, "--empty")
    renewed = Calibration.load(path)
    assert renewed.force == PAIRS
    assert renewed.rest.ohm[0][0] == pytest.approx(first.rest.ohm[0][0], rel=0.02)
    # A file of another layout.
    divider = replace(first.layout.divider, reference_ohm=1e3)
    replace(first, layout=replace(first.layout, divider=divider)).save(path)
    assert "--new" in palpate(*calibrate, status=2).err
    palpate(*calibrate, "--new")
    assert Calibration.load(path).force.force_n == ()


def test_calibrate_force_stops_prompting_within_the_tolerance() -> None:
    series, placed = WeightSeries(layout=RIGID_LAYOUT, tolerance_percent=150.0), list[float]()
    for load_n in _iterate_until_tolerance([1.5, 4.0, 9.0, 6.0, 2.0], series):
        placed.append(load_n)
        # Each weight has an early and a settled reading.
        pixels = [(part * one**1.2,) * 8 for one in placed for part in (0.8, 1.0)]
        series.add(
            ForcePairs(
                run=tuple(np.repeat(range(len(placed)), 2).tolist()),
                since_move_s=(2.0, 20.0) * len(placed),
                excess=tuple(map(sum, pixels)),
                relative_percent=(-50.0,) * len(pixels),
                force_n=tuple(np.repeat(placed, 2).tolist()),
                pixel_excess=tuple(pixels),
            )
        )
    assert placed == [1.5, 4.0, 9.0]


def test_calibrate_force_mistyped_weight_is_requested_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = iter(["1.5", "4,0", "-4", "408", "5 mm", "400 g", "0.9kg", ""])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    given = list(_prompt_for_loads(WeightSeries(layout=RIGID_LAYOUT, tolerance_percent=0.0)))
    assert given == pytest.approx([1.5, 3.92266, 8.825985])
    answers = [line.split(";")[0] for line in capsys.readouterr().err.splitlines()]
    refused = [line.split(": ", 1)[0] for line in answers if line.startswith("load ")]
    assert refused == ["load '4,0'", "load '-4'", "load '408'", "load '5 mm'"]
    # What was understood is shown.
    assert [line for line in answers if not line.startswith("load ")] == [
        "1.5: 1.5 N",
        "400 g: 3.923 N",
        "0.9kg: 8.826 N",
    ]
