"""Grasps whose recording can't be written: the result is shown, status 3."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from tests.commands import Command
from tests.full_disk import file_size_limit

from palpate.errors import RecordingLostError
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.rig import open_rig

pytestmark = pytest.mark.slow

GRASP = ("grasp", "--rig", "sim-rigid", "--seed", "1")


#: Bytes before the disk is full: within the grasp, and in the index at its end.
@pytest.mark.parametrize("room", [130_000, -100])
def test_full_disk_during_a_grasp_keeps_the_result(
    room: int, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "run.mcap"
    if room < 0:  # the last bytes do not fit
        palpate(*GRASP, "--record", tmp_path / "whole.mcap")
        room += (tmp_path / "whole.mcap").stat().st_size
    with file_size_limit(room):
        printed = palpate(*GRASP, "--record", path, "--json", status=3)
    assert printed.document["outcome"] == "held"
    assert printed.document["force_n"] is not None
    assert printed.err.count("\n") == 1
    assert str(path) in printed.err
    palpate("inspect", path)


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


def test_replaced_file_is_not_taken_for_the_recording(tmp_path: Path, info: RecordingInfo) -> None:
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, info=info)
    path.rename(tmp_path / "other.mcap")
    path.write_text("mine")
    with pytest.raises(RecordingLostError):
        writer.close()
    assert path.read_text() == "mine"


def test_release_raises_a_lost_recording_once_and_keeps_the_result(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with open_rig("sim-rigid", seed=1) as rig:
        with file_size_limit(130_000):
            grip = rig.grasp(record=path)
            assert grip.is_holding
            with pytest.raises(RecordingLostError):
                grip.release()
        assert not grip.is_holding
        assert grip.release() is grip.result
    assert grip.outcome == "held"
    assert any(str(path) in fault for fault in grip.result.faults)


@pytest.fixture
def info() -> RecordingInfo:
    with open_rig("sim-rigid", seed=1) as rig:
        return RecordingInfo(layout=rig.array.layout, origin="twin", rig="sim-rigid")
