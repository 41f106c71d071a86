"""Recordings that can't be written: the grasp's result is shown, the status is 3."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from tests.commands import Command
from tests.full_disk import file_size_limit

from palpate.cli import build_app, run
from palpate.errors import RecordingLostError
from palpate.recording import RecordingInfo, RecordingReader, RecordingWriter
from palpate.rig import open_rig
from palpate.sensor.array import RIGID_LAYOUT

GRASP = ("grasp", "--rig", "sim-rigid", "--seed", "1", "--rate-hz", "50")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> int:
    """Return the size of the recording of the grasp, bytes."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    assert run(build_app(), [*GRASP, "--record", str(path), "--json"], name="palpate") == 0
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


@pytest.mark.slow
def test_deleted_file_is_noticed_at_the_end(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "run.mcap"

    def delete() -> None:
        until_s = time.monotonic() + 30
        while not path.exists() and time.monotonic() < until_s:
            time.sleep(0.001)
        path.unlink()

    deleter = threading.Thread(target=delete)
    deleter.start()
    printed = palpate(*GRASP, "--record", path, "--json", status=3)
    deleter.join()
    assert printed.document["outcome"] == "held"
    assert "deleted" in printed.err


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
