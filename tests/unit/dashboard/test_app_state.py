"""The folder of recordings, as others leave it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path, PosixPath
from typing import Any

from palpate.dashboard.app_state import Settings
from palpate.dashboard.folder import recordings_in


def names_in(folder: Path) -> list[str]:
    settings = Settings(
        rigs=("sim-rigid",),
        objects=(),
        folder=folder,
        store=None,
        object_name=None,
        seed=0,
        speed=1.0,
        benches={},
    )
    return [file.name for file, _ in recordings_in(settings.folder)]


def test_recordings_are_listed_with_the_newest_first(tmp_path: Path) -> None:
    for age_s, name in enumerate(("young.mcap", "middle.mcap", "old.mcap", "table.csv")):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1e9 - age_s, 1e9 - age_s))
    assert names_in(tmp_path) == ["young.mcap", "middle.mcap", "old.mcap"]
    assert names_in(tmp_path / "not there yet") == []


def test_a_link_that_leads_nowhere_does_not_take_the_others_away(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").touch()
    (tmp_path / "dangling.mcap").symlink_to("nowhere.mcap")
    (tmp_path / "round.mcap").symlink_to("round.mcap")
    assert names_in(tmp_path) == ["run.mcap"]


class Vanishing(PosixPath):
    """A folder out of which files go while it is listed."""

    def glob(self, *pattern: Any, **options: Any) -> Iterator[Any]:
        for file in list(super().glob(*pattern, **options)):
            if "gone" in file.name:
                file.unlink()
            yield file


def test_a_file_that_vanishes_while_they_are_listed_is_left_out(tmp_path: Path) -> None:
    for name in ("gone-1.mcap", "run.mcap", "gone-2.mcap"):
        (tmp_path / name).touch()
    assert names_in(Vanishing(tmp_path)) == ["run.mcap"]
