"""`palpate inspect`, `export`, `replay`, `record` and `ports`."""

from __future__ import annotations

import csv
import json
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command

from palpate.gripper.interface import GripperState
from palpate.plots.style import PAGE_WIDTH_IN
from palpate.recording import (
    RecordingInfo,
    RecordingReader,
    RecordingWriter,
)
from palpate.sensor.array import RIGID_LAYOUT, Frame


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin", seed=3)
    with RecordingWriter(path, info=info) as writer:
        for k in range(100):
            frame = Frame(time_s=k / 50, sequence=k + (k > 50), counts=np.full((4, 2), 300 + k))
            writer.add(frame)
    return path


def truncate(path: Path, *, fraction: float) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * fraction)])


def test_inspect_counts_frames_and_losses(recorded: Path, palpate: Command) -> None:
    found = palpate("inspect", recorded, "--json").document
    assert (found["frames"], found["frames_lost"], found["intact"]) == (100, 1, True)
    assert found["rate_hz"] == pytest.approx(50.0)
    assert (found["origin"], found["seed"], found["layout"]["rows"]) == ("twin", 3, 4)


def test_inspect_of_a_truncated_recording_suggests_recover(
    recorded: Path, palpate: Command
) -> None:
    truncate(recorded, fraction=0.6)
    text = palpate("inspect", recorded).out
    assert "twin (simulated)" in text
    assert "not finished" in text
    assert f"`palpate inspect {recorded} --recover FILE`" in text


def test_inspect_recover_completes_a_truncated_recording(recorded: Path, palpate: Command) -> None:
    truncate(recorded, fraction=0.6)
    shown = palpate("inspect", recorded, "--recover", recorded, "--json")
    assert json.loads(shown.out)["intact"] is True
    assert "recovered; lost: 0 damaged chunks" in shown.err
    again = palpate("inspect", recorded, "--recover", recorded)
    assert again.err == f"{recorded} was already complete\n"
    copy = recorded.with_name("copy.mcap")
    shown = palpate("inspect", recorded, "--recover", copy, "--json")
    assert json.loads(shown.out)["path"] == str(copy)
    assert "was already complete" in shown.err


def test_export_of_a_table_is_refused_as_no_recording(tmp_path: Path, palpate: Command) -> None:
    (tmp_path / "run.csv").write_text("time_s,ohm\n")
    assert "not an MCAP recording" in palpate.refused("export", tmp_path / "run.csv")


def test_settle_names_an_unreadable_recording_once(recorded: Path, palpate: Command) -> None:
    truncate(recorded, fraction=0.01)
    error = palpate.refused("settle", recorded)
    assert error.count(f"{recorded}") == 1
    assert "missing or damaged" in error


def test_export_default_output_is_next_to_the_recording(recorded: Path, palpate: Command) -> None:
    palpate("export", recorded)
    with recorded.with_suffix(".csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["r3c1_counts"]) for row in rows] == list(range(300, 400))


def test_export_does_not_overwrite_a_recording(recorded: Path, palpate: Command) -> None:
    before = recorded.read_bytes()
    error = palpate("export", recorded, "--out", recorded, status=2).err
    assert "must end in .csv or .parquet" in error
    error = palpate("export", recorded, "--to", "parquet", "--out", "run.csv", status=2).err
    assert "must end in .parquet" in error
    assert recorded.read_bytes() == before


def test_export_infers_format_from_the_file_name(
    recorded: Path, tmp_path: Path, palpate: Command
) -> None:
    palpate("export", recorded, "--out", tmp_path / "run.parquet")
    assert (tmp_path / "run.parquet").read_bytes().startswith(b"PAR1")


def test_record_refuses_other_file_types(tmp_path: Path, palpate: Command) -> None:
    table = tmp_path / "run.csv"
    error = palpate("record", table, "--rig", "sim-rigid", "--duration", "1", status=2).err
    assert "recordings must end in .mcap" in error
    assert not table.exists()


def test_settle_reports_recording_without_rest(recorded: Path, palpate: Command) -> None:
    error = palpate("settle", recorded, status=2).err
    assert f"{recorded}: no rest at the beginning" in error
    assert "Record a second of rest before the first contact" in error


def test_inspect_recover_does_not_overwrite_another_recording(
    recorded: Path, tmp_path: Path, palpate: Command
) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"other data")
    assert "not overwritten" in palpate("inspect", recorded, "--recover", other, status=2).err
    assert other.read_bytes() == b"other data"
    palpate("inspect", recorded, "--recover", recorded)


def test_export_of_holds_names_the_file_in_its_error(recorded: Path, palpate: Command) -> None:
    assert palpate.refused("export", recorded, "--holds").startswith(
        f"palpate: {recorded}: no rest at the beginning"
    )


def test_replay_of_a_recording_without_a_grasp_prints_frames(
    recorded: Path, palpate: Command
) -> None:
    frames = palpate("replay", recorded, "--json").document["frames"]
    assert [frame["counts"][0][0] for frame in frames] == list(range(300, 400))
    printed = palpate("replay", recorded)
    assert len(printed.out.splitlines()) == 100
    assert "no gripper and no calibration" in printed.err
    assert palpate("replay", recorded, "--frames").err == ""


@pytest.mark.parametrize("words", [["replay"], ["export", "--out", "t.csv"], ["export", "--holds"]])
def test_damage_is_named_once_before_anything_is_computed(
    words: list[str], recorded: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(recorded.parent)
    truncate(recorded, fraction=0.7)
    printed, status = palpate.ended(words[0], recorded, *words[1:])
    first, *_ = printed.err.splitlines()
    assert first.startswith(f"palpate: warning: {recorded}: not finished, 0 damaged chunks")
    assert printed.err.count("warning") == 1
    assert status == (2 if "--holds" in words else 0)  # no rest before the first contact


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "missing.mcap"],
        ["replay", "missing.mcap"],
        ["export", "missing.mcap"],
        ["export", "missing.mcap", "--holds"],
        ["inspect", "missing.mcap", "--recover", "whole.mcap"],
    ],
)
def test_reader_missing_file_is_refused_in_one_line(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    assert palpate.refused(*arguments).startswith("palpate: missing.mcap: ")


def test_folder_as_recording_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    for verb in (["inspect"], ["replay"], ["export"], ["inspect", "--recover", "whole.mcap"]):
        error = palpate.refused(*verb, ".")
        assert error.startswith("palpate: .: ")
        assert error.endswith("Is a directory\n")


def test_export_to_a_missing_folder_is_refused(recorded: Path, palpate: Command) -> None:
    out = recorded.parent / "missing" / "run.csv"
    message = f"palpate: {out}: the folder {out.parent} does not exist; create it first\n"
    assert palpate.refused("export", recorded, "--out", out) == message


def test_record_missing_port_is_reported(tmp_path: Path, palpate: Command) -> None:
    port = tmp_path / "ttyACM9"
    assert palpate("record", tmp_path / "new.mcap", "--port", port, status=3).err.startswith(
        f"palpate: no port {port}"
    )
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rig", "sim-rigid"], "would never end; give a --duration"),
        (["--rig", "sim-rigid", "--port", "x"], "--port can't be combined with --rig"),
        (["--rig", "nothing"], "no rig 'nothing'"),
        (["--rig", "missing.toml"], "missing.toml: no such file"),
        (["--duration", "0"], "--duration 0: must be above 0"),
    ],
)
def test_record_refuses_invalid_options(
    options: list[str], message: str, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "new.mcap"
    assert message in palpate.refused("record", path, *options)
    assert not path.exists()


def test_record_from_a_rig_file_without_a_gripper(tmp_path: Path, palpate: Command) -> None:
    rig = tmp_path / "rig.toml"
    port = tmp_path / "ttyACM9"
    palpate("init", rig, "--port", port)
    assert f"no port {port}" in palpate("record", tmp_path / "new.mcap", "--rig", rig, status=3).err


@pytest.mark.slow
def test_record_ctrl_c_completes_the_file_of_a_rig(tmp_path: Path) -> None:
    path = tmp_path / "new.mcap"
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "record", str(path)]
    options = ["--rig", "sim-rigid", "--seed", "4", "--duration", "1e9"]
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as recorder:
        assert "Ctrl-C ends it" in recorder.stderr.readline()
        # Well beyond the start of the file, which contains the whole calibration.
        while path.stat().st_size < 200_000:
            os.sched_yield()
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait() == 130
        assert recorder.stderr.read() == f"{path}: recorded\n"
    with RecordingReader(path) as reader:
        kinds = [type(message) for message in reader.messages()]
        info, state = reader.info, reader.state
    assert state.is_intact
    assert kinds.count(Frame) == kinds.count(GripperState) > 30
    assert (info.origin, info.rig, info.seed) == ("twin", "sim-rigid", 4)
    assert info.calibration is not None
    assert info.gripper is None, "without a grasp, a replay makes no decisions"


def test_ports_is_one_json_document(palpate: Command) -> None:
    assert isinstance(palpate("ports", "--json").document["ports"], list)


@pytest.mark.parametrize("verb", ["record", "inspect", "replay", "export", "ports"])
def test_help_shows_an_example(verb: str, palpate: Command) -> None:
    assert "Example: palpate" in palpate(verb, "--help").out


def test_inspect_writes_a_plot(recorded: Path, tmp_path: Path, palpate: Command) -> None:
    palpate("inspect", recorded, "--plot", tmp_path / "run.png")
    png = (tmp_path / "run.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    width, _ = struct.unpack(">II", png[16:24])
    assert width == pytest.approx(300 * PAGE_WIDTH_IN, abs=3), "300 dots per inch"


def test_inspect_plot_without_data_is_refused(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "empty.mcap"
    with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")):
        pass
    error = palpate("inspect", path, "--plot", tmp_path / "run.png", status=2).err
    assert "no frames to plot" in error
    assert not (tmp_path / "run.png").exists()


@pytest.mark.parametrize(
    "name", ["x" * 252 + ".mcap", "é" * 130 + ".mcap", "a\0b.mcap", "no-such-folder/a.mcap"]
)
@pytest.mark.parametrize(
    "words",
    [
        ["record", "NAME", "--rig", "sim-rigid", "--duration", "1"],
        ["grasp", "--rig", "sim-rigid", "--record", "NAME"],
        ["inspect", "NAME"],
        ["inspect", "whole.mcap", "--recover", "NAME"],
        ["replay", "NAME"],
        ["export", "whole.mcap", "--out", "NAME.csv"],
    ],
)
def test_impossible_name_is_refused_in_one_line(
    name: str,
    words: list[str],
    recorded: Path,
    palpate: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(recorded.parent)
    recorded.rename("whole.mcap")
    refused = palpate.refused(*(word.replace("NAME", name) for word in words))
    assert Path(name).parent.name in refused
    assert [path.name for path in Path.cwd().iterdir()] == ["whole.mcap"]
