"""The folder of recordings: no access to files outside the folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.dashboard.folder import (
    delete_recording,
    describe_damage,
    find_recording,
    is_simulated,
    rename_recording,
)
from palpate.errors import InputError
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.array import RIGID_LAYOUT


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


@pytest.mark.parametrize("name", [*OUTSIDE, "one.mcap/../../secret.mcap", "one.mcap\0"])
def test_recording_outside_the_folder_is_refused(folder: Path, name: str) -> None:
    for act in (
        find_recording,
        delete_recording,
        lambda folder, name: rename_recording(folder, name, "mine"),
    ):
        with pytest.raises(InputError, match="no such recording in the folder"):
            act(folder, name)
    assert (folder.parent / "secret.mcap").read_bytes() == b"secret"
    assert (folder / "notes.txt").exists()


def test_recording_can_be_renamed_and_deleted(folder: Path) -> None:
    assert rename_recording(folder, "one.mcap", " ripe 3 ") == folder / "ripe 3.mcap"
    assert (folder / "ripe 3.mcap").read_bytes() == b"one"
    assert not (folder / "one.mcap").exists()
    delete_recording(folder, "ripe 3.mcap")
    assert not (folder / "ripe 3.mcap").exists()


@pytest.mark.parametrize("stem", ["../mine", "a/b", "", ".mine", "two"])
def test_rename_recording_to_an_invalid_or_existing_name_is_refused(
    folder: Path, stem: str
) -> None:
    (folder / "two.mcap").write_bytes(b"two")
    with pytest.raises(InputError):
        rename_recording(folder, "one.mcap", stem)
    assert (folder / "one.mcap").read_bytes() == b"one"
    assert (folder / "two.mcap").read_bytes() == b"two"
    assert sorted(folder.parent.glob("*.mcap")) == [folder.parent / "secret.mcap"]


@pytest.mark.parametrize(("origin", "simulated"), [("twin", True), ("hardware", False)])
def test_is_simulated_matches_the_origin_of_the_recording(
    tmp_path: Path, origin: str, simulated: bool
) -> None:
    file = tmp_path / f"{origin}.mcap"
    info = RecordingInfo(layout=RIGID_LAYOUT, origin=origin)  # type: ignore[arg-type]
    with RecordingWriter(file, info=info):
        pass
    assert is_simulated(file, file.stat()) is simulated


def test_is_simulated_of_an_unreadable_recording_is_false(folder: Path) -> None:
    assert not is_simulated(folder / "one.mcap", (folder / "one.mcap").stat())


@pytest.mark.parametrize("length", [251, 300, 5000])
def test_name_too_long_for_the_file_system_is_refused_in_one_short_line(
    folder: Path, length: int
) -> None:
    with pytest.raises(InputError, match="no such recording") as refused:
        find_recording(folder, "x" * length + ".mcap")
    assert len(str(refused.value)) < 200


def test_describe_damage_names_the_damage_of_a_recording(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with RecordingWriter(file, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")):
        pass
    assert describe_damage(file, file.stat()) == ""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[:-40])
    assert "not finished" in describe_damage(cut, cut.stat())
    digit = tmp_path / "digit.mcap"
    digit.write_bytes(file.read_bytes().replace(b"rigid-2x2", b"rigid-2x3"))
    assert "checksum" in describe_damage(digit, digit.stat())
    other = tmp_path / "other.mcap"
    other.write_bytes(b"time_s,value")
    assert describe_damage(other, other.stat()).startswith("not an MCAP recording")
