"""`palpate calibrate force | compliance | settling`, on the twin."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.cli import build_app, calibrate_settling, run
from palpate.cli.calibrate_bench import resolve_calibration_file
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.calibration import Calibration, RestValues
from palpate.sensor.rest_calibration import replace_rest


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibrated") / "pad.json"
    arguments = ["calibrate", "force", "--seed", "3", "--out", str(path)]
    assert run(build_app(), arguments, name="palpate") == 0
    return path


def test_calibrate_force_file_contains_rest_and_force_readings(made: Path) -> None:
    found = Calibration.load(made)
    assert found.origin == "simulated"
    assert found.made_at is not None
    assert len(set(found.force.run)) == 6
    assert made.stat().st_size < 40_000
    for kind in ("error_percent", "early_error_percent"):
        assert 0 < found.held_out[kind]["5_n"] < 40
    assert found.force_law["residual_sd"] > 0


@pytest.mark.slow
def test_calibrate_force_prints_the_plot_file(tmp_path: Path, palpate: Command) -> None:
    plot = tmp_path / "pad.png"
    shown = palpate("calibrate", "force", "--out", tmp_path / "pad.json", "--plot", plot).out
    assert shown.splitlines()[-1] == f"Written: {plot}"
    assert plot.stat().st_size > 10_000


@pytest.mark.parametrize("loads", [[], ["--loads", "loads.csv"]])
def test_calibrate_force_advises_omitting_loads_only_if_given(
    loads: list[str], palpate: Command
) -> None:
    error = palpate("calibrate", "force", "--rig", "sim-soft", *loads, status=2).err
    assert "can't be loaded with weights" in error
    assert ("omit --loads" in error) == bool(loads)


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
    ("arguments", "status", "message"),
    [
        (("--block-mm", "4"), 2, "give the thickness in millimetres"),
        (("--out", "none.json"), 2, "none.json does not exist yet"),
        (("--rig", "sim-soft"), 3, "no load cell"),
    ],
)
def test_calibrate_compliance_invalid_input_is_refused_in_one_line(
    arguments: tuple[str, ...], status: int, message: str, palpate: Command
) -> None:
    assert message in palpate.refused("calibrate", "compliance", *arguments, status=status)


def write_other_sensor(path: Path) -> None:
    rest = RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30)
    replace_rest(None, rest, layout=RIGID_LAYOUT, simulated=False).save(path)


def truncate_file(path: Path) -> None:
    write_other_sensor(path)
    path.write_text(path.read_text()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("prepare", "message"),
    [(write_other_sensor, "give another --out"), (truncate_file, "incomplete or invalid JSON")],
)
def test_calibrate_other_sensors_file_is_left_unchanged(
    tmp_path: Path, prepare: object, message: str, palpate: Command
) -> None:
    path = tmp_path / "pad.json"
    prepare(path)  # type: ignore[operator]
    before = path.read_bytes()
    assert message in palpate("calibrate", "force", "--out", path, status=2).err
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load_n\n1\n5\n", "at least 3 different weights are needed, not 2"),
        ("load_n\n5\n5\n5\n5\n", "not 1 (5 N)"),
        ("load_n\n100\n250\n500\n1000\n", "in grams"),
        ("weight\n1\n2\n3\n4\n", "no column load_n"),
    ],
)
def test_calibrate_force_bad_loads_preserve_the_old_file(
    tmp_path: Path, text: str, message: str, palpate: Command
) -> None:
    path, loads = tmp_path / "pad.json", tmp_path / "loads.csv"
    write_other_sensor(path)
    before = path.read_bytes()
    loads.write_text(text)
    error = palpate(
        "calibrate",
        "force",
        "--rig",
        "real.toml",
        "--loads",
        loads,
        "--out",
        path,
        status=2,
    ).err
    assert message in error
    assert path.read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("step", ["rest", "force", "compliance"])
def test_calibrate_unwritable_output_is_refused_before_measuring(
    step: str, tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measure(*_: object, **__: object) -> None:
        raise AssertionError("measured before the output was checked")

    monkeypatch.setattr("palpate.cli.sensor_source.SensorSource.frames", measure)
    monkeypatch.setattr("palpate.cli.calibrate_bench.open_bench", measure)
    path = tmp_path / "none" / "pad.json"
    error = palpate("calibrate", step, "--rig", "sim-rigid", "--out", path, status=2).err
    assert f"the folder {path.parent} does not exist" in error


def test_resolve_calibration_file_prefers_option_then_rig_file(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('calibration = "mine.json"\n')
    assert resolve_calibration_file(str(rig), None) == tmp_path / "mine.json"
    assert resolve_calibration_file(str(rig), tmp_path / "pad.json") == tmp_path / "pad.json"
    rig.write_text('use = "sim-rigid"\n')
    assert resolve_calibration_file(str(rig), None) == Path("calibration.json")
    assert resolve_calibration_file("sim-rigid", None) == Path("calibration.json")


def test_calibrate_force_refuses_weights_on_a_simulated_rig(
    tmp_path: Path, palpate: Command
) -> None:
    error = palpate("calibrate", "force", "--loads", tmp_path / "loads.csv", status=2).err
    assert "simulated" in error


@pytest.mark.slow
def test_calibrate_settling_stores_only_long_holds(
    tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.holds import read_holds

    path, out = record_holds(tmp_path), tmp_path / "fit.csv"
    assert "1 long enough" in palpate("calibrate", "settling", path, "--out", out).err
    holds = list(read_holds(out))
    assert {hold.channel for hold in holds} >= {"mean"}
    assert all(hold.time_s[-1] >= 19.5 for hold in holds)
    error = palpate("calibrate", "settling", path, "--out", tmp_path / "fit.txt", status=2).err
    assert ".csv or .parquet" in error
    monkeypatch.setattr(calibrate_settling, "_MIN_HOLD_S", 60.0)
    assert (
        "record longer holds" in palpate("calibrate", "settling", path, "--out", out, status=2).err
    )


def test_settle_learns_from_the_rigs_settled_holds(tmp_path: Path, palpate: Command) -> None:
    from palpate.holds import read_holds

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
    error = palpate("calibrate", "settling", new, "--rig", "sim-rigid", status=2).err
    assert "simulated rigs have no holds file" in error


def record_holds(folder: Path) -> Path:
    """Record a short and a long hold on the twin."""
    import numpy as np

    from palpate.gripper.interface import GripperCommand
    from palpate.recording import RecordingInfo, RecordingWriter
    from palpate.twin.devices import TwinArray, TwinGripper
    from palpate.twin.objects import draw_object
    from palpate.twin.world import World

    obj = draw_object(np.random.default_rng(1), "dragonskin-20")
    world = World(obj, seed=1)
    gripper, array, path = TwinGripper(world), TwinArray(world), folder / "day1.mcap"
    info = RecordingInfo(layout=world.layout, origin="twin")
    with RecordingWriter(path, info=info) as writer:
        for width_mm, until_s in ((74.0, 2.0), (38.0, 6.0), (74.0, 20.0), (37.5, 41.5)):
            gripper.command(GripperCommand(target=width_mm, rate=40.0))
            while world.clock.now_s() < until_s:
                frame = array.read(timeout_s=1.0)
                writer.add_observation(frame, gripper=gripper.state())
    return path
