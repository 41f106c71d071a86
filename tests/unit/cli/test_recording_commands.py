"""`palpate inspect`, `export`, `replay`, `record` and `ports`."""

from __future__ import annotations

import csv
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command

from palpate.plots.style import PAGE_WIDTH_IN
from palpate.recording import RecordingInfo, RecordingWriter
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


def test_inspect_recover_completes_a_truncated_recording(recorded: Path, palpate: Command) -> None:
    truncate(recorded, fraction=0.6)
    text = palpate("inspect", recorded).out
    assert "twin (simulated)" in text
    assert f"`palpate inspect {recorded} --recover FILE`" in text
    other = recorded.with_name("other.mcap")
    other.write_bytes(b"other data")
    assert "not overwritten" in palpate("inspect", recorded, "--recover", other, status=2).err
    assert other.read_bytes() == b"other data"
    shown = palpate("inspect", recorded, "--recover", recorded, "--json")
    assert json.loads(shown.out)["intact"] is True
    assert "recovered; lost: 0 damaged chunks" in shown.err
    copy = recorded.with_name("copy.mcap")
    shown = palpate("inspect", recorded, "--recover", copy, "--json")
    assert json.loads(shown.out)["path"] == str(copy)
    assert "was already complete" in shown.err


def test_export_writes_the_format_of_the_name(recorded: Path, palpate: Command) -> None:
    palpate("export", recorded, "--out", recorded.with_suffix(".parquet"))
    assert recorded.with_suffix(".parquet").read_bytes().startswith(b"PAR1")
    palpate("export", recorded)
    with recorded.with_suffix(".csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["r3c1_counts"]) for row in rows] == list(range(300, 400))


def test_export_overwrites_neither_a_recording_nor_a_table(
    recorded: Path, palpate: Command
) -> None:
    before = recorded.read_bytes()
    table = recorded.with_suffix(".csv")
    table.write_text("mine")
    for options, message in (
        (("--out", recorded), "must end in .csv or .parquet"),
        (("--to", "parquet", "--out", "run.csv"), "must end in .parquet"),
        ((), "already exists"),
    ):
        assert message in palpate.refused("export", recorded, *options)
    assert recorded.read_bytes() == before
    assert table.read_text() == "mine"


def test_replay_of_a_recording_without_a_grasp_prints_frames(
    recorded: Path, palpate: Command
) -> None:
    frames = palpate("replay", recorded, "--json").document["frames"]
    assert [frame["counts"][0][0] for frame in frames] == list(range(300, 400))
    printed = palpate("replay", recorded)
    assert len(printed.out.splitlines()) == 100
    assert "no gripper and no calibration" in printed.err


@pytest.mark.parametrize("words", [["replay"], ["export", "--out", "t.csv"]])
def test_damage_is_named_once(
    words: list[str], recorded: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(recorded.parent)
    truncate(recorded, fraction=0.7)
    error = palpate(words[0], recorded, *words[1:]).err
    assert error.startswith(f"palpate: warning: {recorded}: not finished, 0 damaged chunks")
    assert error.count("warning") == 1


@pytest.mark.parametrize("words", [["inspect"], ["replay"], ["export"], ["export", "--holds"]])
def test_what_is_no_recording_is_refused_in_one_line(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run.csv").write_text("time_s,ohm\n")
    for path in ("missing.mcap", "run.csv", "."):
        assert palpate.refused(*words, path).startswith(f"palpate: {path}: ")


def test_inspect_writes_a_plot(recorded: Path, tmp_path: Path, palpate: Command) -> None:
    palpate("inspect", recorded, "--plot", tmp_path / "run.png")
    png = (tmp_path / "run.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    width, _ = struct.unpack(">II", png[16:24])
    assert width == pytest.approx(300 * PAGE_WIDTH_IN, abs=3), "300 dots per inch"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["record", "NAME", "--rig", "sim-rigid", "--duration", "1"], "é" * 130 + ".mcap"),
        (["grasp", "--rig", "sim-rigid", "--record", "NAME"], "no-such-folder/a.mcap"),
        (["inspect", "NAME"], "a\0b.mcap"),
        (["inspect", "whole.mcap", "--recover", "NAME"], "x" * 252 + ".mcap"),
        (["replay", "NAME"], "x" * 252 + ".mcap"),
        (["export", "whole.mcap", "--out", "NAME.csv"], "a\0b.mcap"),
        (["export", "whole.mcap", "--out", "NAME.csv"], "no-such-folder/a.mcap"),
    ],
)
def test_impossible_name_is_refused_in_one_line(
    words: list[str], name: str, recorded: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(recorded.parent)
    recorded.rename("whole.mcap")
    refused = palpate.refused(*(word.replace("NAME", name) for word in words))
    assert Path(name).parent.name in refused
    assert [path.name for path in Path.cwd().iterdir()] == ["whole.mcap"]
