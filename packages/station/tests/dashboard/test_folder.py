"""The folder of recordings: no access to files outside the folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.array import RIGID_LAYOUT
from palpate_station.dashboard.folder import (
    delete_recording,
    describe_damage,
    find_recording,
    is_simulated,
    rename_recording,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    (folder / "one.mcap").write_bytes(b"one")
    (folder / "notes.txt").write_bytes(b"notes")
    (folder / "link.mcap").symlink_to(tmp_path / "secret.mcap")
    return folder


OUTSIDE = ["../secret.mcap", "/etc/passwd", "notes.txt", "link.mcap", "..", "", "two.mcap"]
#: Names that the file system does not accept.
TOO_LONG = ["x" * length + ".mcap" for length in (251, 300, 5000)]


@pytest.mark.parametrize(
    "name", [*OUTSIDE, "one.mcap/../../secret.mcap", "one.mcap\0", *TOO_LONG], ids=lambda n: n[:20]
)
def test_recording_outside_the_folder_is_refused_in_one_short_line(folder: Path, name: str) -> None:
    for act in (
        find_recording,
        delete_recording,
        lambda folder, name: rename_recording(folder, name, "mine"),
    ):
        with pytest.raises(InputError, match="no such recording in the folder") as refused:
            act(folder, name)
        assert len(str(refused.value)) < 200
    assert (folder.parent / "secret.mcap").read_bytes() == b"secret"
    assert (folder / "notes.txt").exists()


def test_recording_can_be_renamed_and_deleted(folder: Path) -> None:
    assert rename_recording(folder, "one.mcap", " ripe 3 ") == folder / "ripe 3.mcap"
    assert (folder / "ripe 3.mcap").read_bytes() == b"one"
    assert not (folder / "one.mcap").exists()
    delete_recording(folder, "ripe 3.mcap")
    assert not (folder / "ripe 3.mcap").exists()


INVALID = ["../mine", "a/b", "", ".mine", "  ", "..", "..\\a", "a\0b", "x" * 81, "~"]


@pytest.mark.parametrize("stem", [*INVALID, "two"])
def test_rename_recording_to_an_invalid_or_existing_name_is_refused(
    folder: Path, stem: str
) -> None:
    (folder / "two.mcap").write_bytes(b"two")
    with pytest.raises(InputError):
        rename_recording(folder, "one.mcap", stem)
    assert (folder / "one.mcap").read_bytes() == b"one"
    assert (folder / "two.mcap").read_bytes() == b"two"
    assert sorted(folder.parent.glob("*.mcap")) == [folder.parent / "secret.mcap"]


def test_recording_list_labels_simulated_and_damaged_recordings(tmp_path: Path) -> None:
    for origin in ("twin", "hardware"):
        info = RecordingInfo(layout=RIGID_LAYOUT, origin=origin)  # type: ignore[arg-type]
        with RecordingWriter(tmp_path / f"{origin}.mcap", info=info):
            pass
    whole = (tmp_path / "twin.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-40])
    (tmp_path / "digit.mcap").write_bytes(whole.replace(b"rigid-2x2", b"rigid-2x3"))
    (tmp_path / "other.mcap").write_bytes(b"time_s,value")
    for name, simulated, damage in (
        ("twin", True, ""),
        ("hardware", False, ""),
        ("cut", True, "not finished"),
        ("digit", False, "checksum"),
        ("other", False, "not an MCAP recording"),
    ):
        file = tmp_path / f"{name}.mcap"
        assert is_simulated(file, file.stat()) is simulated, name
        found = describe_damage(file, file.stat())
        assert damage in found, name
        assert bool(found) == bool(damage), name
