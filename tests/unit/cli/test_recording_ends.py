"""Recordings ended by a signal or a full disk, and existing files."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.commands import Command
from tests.full_disk import file_size_limit

from palpate.recording import FileState, RecordingReader

pytestmark = pytest.mark.slow

MAIN = "from palpate.cli import main; main()"


def frames_of(path: Path) -> tuple[int, FileState]:
    with RecordingReader(path) as reader:
        return sum(1 for _ in reader.readable_messages()), reader.state


def test_record_sigterm_completes_the_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", MAIN, "record", str(path), "--rig", "sim-rigid"]
    command += ["--duration", "1e9"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder:
        assert "recording" in recorder.stderr.readline()
        recorder.send_signal(signal.SIGTERM)
        error = recorder.stderr.read()
    assert recorder.returncode == 130
    assert "Traceback" not in error
    assert frames_of(path)[1].is_intact


def test_record_full_disk_exits_with_3(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "run.mcap"
    with file_size_limit(130_000):
        printed = palpate("record", path, "--rig", "sim-rigid", "--duration", "60", status=3)
    started, failed = printed.err.splitlines()
    assert started.startswith("recording sim-rigid")
    assert failed.startswith(f"palpate: {path}: File too large. At most the last second")
    assert "then run `palpate inspect --recover` on the file" in failed
    assert frames_of(path)[0] > 0


def test_record_disk_full_at_start_is_reported_in_one_line(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "run.mcap"
    path.symlink_to("/dev/full")
    palpate.refused("record", path, "--rig", "sim-rigid", "--duration", "1", status=3)


def test_record_and_export_do_not_overwrite_existing_files(
    tmp_path: Path, palpate: Command
) -> None:
    recorded, table = tmp_path / "run.mcap", tmp_path / "run.csv"
    palpate("record", recorded, "--rig", "sim-rigid", "--duration", "0.5")
    table.write_text("mine")
    for verb in ("export", "record"):
        options = ("--rig", "sim-rigid", "--duration", "1") if verb == "record" else ()
        before = recorded.read_bytes()
        error = palpate.refused(verb, recorded, *options)
        assert "already exists" in error
        assert recorded.read_bytes() == before
    assert table.read_text() == "mine"
