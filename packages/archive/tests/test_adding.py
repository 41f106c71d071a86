"""Adding recordings and stores to an archive: everything once, in any store, at a limited rate."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from packages.archive.tests.drawn import palpate, read, read_bytes

from palpate.holds import read_holds
from palpate.recording import load_recording
from palpate.recording.exporting import solve_resistance_ohm
from palpate_archive.adding import add_recordings, add_store
from palpate_archive.catalogue import Catalogue
from palpate_archive.folders import Folder
from palpate_archive.layout import KINDS, open_archive
from palpate_station.store.database import Store

pytestmark = pytest.mark.slow


def test_added_frames_match_recording(root: Path, recorded: Path) -> None:
    recording = load_recording(recorded / "g1.mcap")
    [table] = [found for place, found in read(root, "frames").items() if "/g1-" in place]
    assert set(table["origin"]) == {"twin"}
    assert table["time_s"].tolist() == recording.time_s.tolist()
    shape = recording.counts.shape
    assert np.array(table["counts"].tolist()).reshape(shape).tolist() == recording.counts.tolist()
    ohm = solve_resistance_ohm(recording).reshape(len(recording.time_s), -1)
    assert np.array_equal(np.array(table["ohm"].tolist()), ohm)


def test_holds_part_is_readable_as_holds_file(root: Path) -> None:
    [first, _] = Catalogue(open_archive(root), "holds").files()
    holds = list(read_holds(root / first.file))
    assert {hold.unit for hold in holds} == {"percent"}
    assert "mean" in {hold.channel for hold in holds}


def test_add_store_adds_new_grasps_once(root: Path, recorded: Path) -> None:
    archive = open_archive(root)
    with Store.open(str(recorded / "items.sqlite")) as store:
        assert add_store(archive, store, station="north") == {"grasps": 2}
        assert add_store(archive, store, station="north") == {}
        taken = {grasp.grasp_id for grasp in store.grasps()}
    [found] = read(root, "grasps").values()
    assert set(found["grasp_id"]) == taken


@pytest.mark.parametrize(
    ("address", "folder"), [("/g1.mcap", "/"), ("/a/g1.mcap", "/a"), ("g1.mcap", None)]
)
def test_file_is_found_in_its_own_folder(address: str, folder: str | None) -> None:
    found, name = Folder.divide(address)
    assert (Path(found.fs.path), name) == (Path(folder or Path.cwd()), "g1.mcap")


def test_add_after_interruption_completes(root: Path, recorded: Path) -> None:
    """With holds but without frames in the catalogue, the recording is not yet added."""
    archive = open_archive(root)
    Catalogue(archive, "frames").change("north", lambda before: before[1:])
    [added] = add_recordings(archive, [recorded / "g1.mcap"], station="north")
    assert added["frames"] > 0
    assert [len(Catalogue(archive, kind).files()) for kind in KINDS] == [2, 2, 0]


def test_recording_that_fails_leaves_those_before_it(recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((recorded / "g2.mcap").read_bytes()[:5000])
    to = tmp_path / "archive"
    files = [str(recorded / "g1.mcap"), str(cut), str(recorded / "g2.mcap")]
    assert palpate("archive", "add", *files, "--to", str(to), "--station", "north") == 2
    assert len(read(to, "frames")) == len(read(to, "holds")) == 1


def test_archive_in_s3_has_the_bytes_of_one_in_a_folder(
    root: Path, recorded: Path, bucket: str
) -> None:
    """From the station, with a limited rate; a second run adds nothing."""
    to = f"{bucket}/archive"
    arguments = ("archive", "add", str(recorded), "--to", to, "--station", "north")
    assert palpate(*arguments, "--max-mbit", "1000") == 0
    before = {kind: read_bytes(to, kind) for kind in KINDS[:2]}
    assert before == {kind: read_bytes(root, kind) for kind in KINDS[:2]}
    assert palpate(*arguments) == 0
    assert {kind: read_bytes(to, kind) for kind in KINDS[:2]} == before


def test_max_mbit_limits_the_rate(recorded: Path, bucket: str) -> None:
    archive = open_archive(f"{bucket}/archive", create=True, max_mbit=0.2)
    began_s = time.monotonic()
    list(add_recordings(archive, [recorded / "g1.mcap"]))
    taken_s = time.monotonic() - began_s
    written = sum(map(archive.fs.size, archive.find()))
    # Without the catalogue, which is small and sent at once.
    assert written > 15_000
    assert 8e-6 * written / taken_s < 1.5 * 0.2


def test_large_file_is_sent_in_blocks(bucket: str) -> None:
    content = np.random.default_rng(1).bytes(11 * 2**20)
    folder = Folder.open(bucket, max_mbit=1000.0)
    with folder.replace("whole/large.bin") as partial:
        partial.write_bytes(content)
    assert folder.fs.cat_file("whole/large.bin") == content


def test_recordings_may_come_from_a_store(recorded: Path, bucket: str, tmp_path: Path) -> None:
    with Folder.open(bucket).replace("raw/g1.mcap") as partial:
        partial.write_bytes((recorded / "g1.mcap").read_bytes())
    assert palpate("archive", "add", f"{bucket}/raw", "--to", str(tmp_path / "a")) == 0
    assert len(read(tmp_path / "a", "frames")) == 1
