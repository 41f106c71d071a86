"""`palpate inspect`, `export`, `replay`, `record`, and recordings that can't be written."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from tests.commands import Command, run_palpate
from tests.full_disk import file_size_limit
from tests.recordings import MESSAGES

from palpate.errors import RecordingLostError
from palpate.recording import RecordingInfo, RecordingReader, RecordingWriter
from palpate.rig import open_rig
from palpate.sensor.array import RIGID_LAYOUT, Frame


def truncate(path: Path, *, fraction: float) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * fraction)])


def test_inspect_counts_frames_and_losses(recorded: Path, palpate: Command) -> None:
    found = palpate("inspect", recorded, "--json").document
    assert (found["frames"], found["frames_lost"], found["intact"]) == (200, 1, True)
    assert found["rate_hz"] == pytest.approx(50.0)
    assert (found["origin"], found["seed"], found["layout"]["rows"]) == ("twin", 7, 4)


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
    sent = [one.counts[3, 1] for one in MESSAGES if isinstance(one, Frame)]
    assert [int(row["r3c1_counts"]) for row in rows] == sent


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
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


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


GRASP = ("grasp", "--rig", "sim-rigid", "--seed", "1", "--rate-hz", "50")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> int:
    """Return the size of the recording of the grasp, bytes."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    assert run_palpate(*GRASP, "--record", str(path), "--json") == 0
    return path.stat().st_size


#: Bytes that do not fit: some seconds of the grasp, or the end of the index after it.
@pytest.mark.slow
@pytest.mark.parametrize("missing", [10_000, 100])
def test_full_disk_during_a_grasp_keeps_the_result(
    missing: int, whole: int, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "run.mcap"
    with file_size_limit(whole - missing):
        printed = palpate(*GRASP, "--record", path, "--json", status=3)
    assert printed.document["outcome"] == "held"
    assert printed.document["force_n"] is not None
    assert printed.err.count("\n") == 1
    assert str(path) in printed.err
    palpate("inspect", path)


def test_replaced_file_is_not_taken_for_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin"))
    path.rename(tmp_path / "other.mcap")
    path.write_text("mine")
    with pytest.raises(RecordingLostError):
        writer.close()
    assert path.read_text() == "mine"


@pytest.mark.slow
def test_release_raises_a_lost_recording_once_and_keeps_the_result(
    whole: int, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with open_rig("sim-rigid", seed=1, rate_hz=50.0) as rig:
        with file_size_limit(whole - 10_000):
            grip = rig.grasp(record=path)
            assert grip.is_holding
            with pytest.raises(RecordingLostError):
                grip.release()
        assert not grip.is_holding
        assert grip.release() is grip.result
    assert grip.outcome == "held"
    assert any(str(path) in fault for fault in grip.result.faults)


@pytest.mark.slow
def test_record_on_a_full_disk_exits_with_3(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "run.mcap"
    with file_size_limit(130_000):
        printed = palpate("record", path, "--rig", "sim-rigid", "--duration", "60", status=3)
    started, failed = printed.err.splitlines()
    assert started.startswith("recording sim-rigid")
    assert failed.startswith(f"palpate: {path}: File too large. At most the last second")
    with RecordingReader(path) as reader:
        assert any(True for _ in reader.readable_messages())
    path.unlink()
    path.symlink_to("/dev/full")
    palpate.refused("record", path, "--rig", "sim-rigid", "--duration", "1", status=3)
