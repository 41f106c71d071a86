"""Delete stations, items or days from an archive and from its results."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import date, timedelta
from functools import partial
from pathlib import PurePath

import pyarrow as pa
import pyarrow.compute as pc

from palpate_archive.adding import sanitize
from palpate_archive.catalogue import Catalogue, Entry, list_kinds
from palpate_archive.folders import Folder
from palpate_archive.layout import SIMULATED, Archive, parse_part


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What to delete: the rows that all given conditions select."""

    station: str | None = None
    item: str | None = None
    #: ``YYYY-MM-DD`` in UTC, or ``simulated``.
    day: str | None = None
    #: Days before this one, never simulated ones.
    before: str | None = None

    def includes(self, place: str) -> bool:
        """Return whether a file may contain selected rows."""
        part = parse_part(place)
        is_early = self.before is None or (part.date != SIMULATED and part.date < self.before)
        return self.station in (None, part.station) and self.day in (None, part.date) and is_early


def forget(archive: Archive, selection: Selection, *, results: Iterable[Folder]) -> dict[str, int]:
    """Delete the selected rows now; return kind or job -> rows deleted.

    A file with other rows too is written again without the selected ones. The results of a changed
    file are deleted whole; the next evaluation computes those of its other rows. The sources of
    deleted rows stay in the catalogue, so that a station does not add them again. An item's frames
    and holds are those of the recordings that its grasps name.
    """
    labels = None if selection.item is None else _find_labels(archive, selection)
    deleted, gone = Counter[str](), set[str]()
    # Grasps last: after an interruption they still name the recordings.
    for kind in ("frames", "holds", "grasps"):
        catalogue = archive.catalogue(kind)
        for station in catalogue.entries():
            wanted = labels
            if kind == "grasps" and selection.item is not None:
                wanted = {selection.item}
            rows, sources = _forget_in(archive, catalogue, station, selection, wanted)
            deleted[kind] += rows
            gone |= sources
        _delete_unlisted(catalogue, selection)
    for folder in results:
        for job in list_kinds(folder):
            deleted[job] += _forget_results(Catalogue(folder, job), selection, gone)
    return dict(deleted)


def _find_labels(archive: Archive, selection: Selection) -> set[str]:
    """Return the labels of the recordings that the item's grasps name."""
    wanted = set[tuple[str, str, str]]()
    for entry in archive.catalogue("grasps").files():
        table = archive.folder.read_table(
            entry.file, columns=["recording"], filters=[("item_id", "==", selection.item)]
        )
        # A recording that lasts beyond midnight begins the day before its grasp.
        before = date.fromisoformat(entry.date) - timedelta(days=1)
        for file in filter(None, table["recording"].to_pylist()):
            for day in (entry.date, before.isoformat(), SIMULATED):
                wanted.add((parse_part(entry.file).station, day, sanitize(PurePath(file).stem)))
    found = set[str]()
    for kind in ("frames", "holds"):
        for entry in archive.catalogue(kind).files():
            at = (parse_part(entry.file).station, entry.date)
            names = {name for *place, name in wanted if tuple(place) == at}
            if names and selection.includes(entry.file):
                table = archive.folder.read_table(entry.file, columns=["recording"])
                labels = pc.unique(table["recording"]).to_pylist()
                found |= {label for label in labels if label.rpartition("-")[0] in names}
    return found


def _forget_in(
    archive: Archive,
    catalogue: Catalogue,
    station: str,
    selection: Selection,
    wanted: set[str] | None,
) -> tuple[int, set[str]]:
    """Delete rows of a station; return their number and their sources.

    `wanted`: recordings, or the item for grasps; None for all rows.
    """
    while True:
        kept = {
            entry: None if wanted is None else _keep_others(archive, entry, wanted)
            for entry in catalogue.entries().get(station, [])
            if selection.includes(entry.file)
        }
        kept = {old: new for old, new in kept.items() if new != old}
        if not kept:
            return 0, set()
        left = [new for new in kept.values() if new is not None]
        gone = {s for old in kept for s in old.sources} - {s for new in left for s in new.sources}
        # Again if another writer changed one of the files meanwhile.
        if catalogue.change(station, partial(_leave_out, kept=kept, gone=gone)):
            catalogue.expire(station, grace_s=0.0)
            return sum(old.rows for old in kept) - sum(new.rows for new in left), gone


def _leave_out(
    before: list[Entry], *, kept: dict[Entry, Entry | None], gone: set[str]
) -> list[Entry] | None:
    """Return the entries with the files replaced, and one of the deleted sources."""
    if not kept.keys() <= set(before):
        return None
    known = {source for entry in before if not entry.file for source in entry.sources}
    return [
        Entry(file="", rows=0, bytes=0, sha256="", sources=tuple(sorted(known | gone))),
        *(entry for entry in before if entry.file and entry not in kept),
        *filter(None, kept.values()),
    ]


def _keep_others(archive: Archive, entry: Entry, wanted: set[str]) -> Entry | None:
    """Write the other rows of a file; return their entry, the same one if it has no wanted rows."""
    part = parse_part(entry.file)
    table = archive.folder.read_table(entry.file)
    column = table["item_id" if part.kind == "grasps" else "recording"]
    others = table.filter(pc.invert(pc.is_in(column, pa.array(sorted(wanted), pa.string()))))
    if others.num_rows == table.num_rows:
        return entry
    if others.num_rows == 0:
        return None
    if part.kind == "grasps":
        sources = others["grasp_id"].to_pylist()
    else:
        digests = {label.rpartition("-")[2] for label in pc.unique(others["recording"]).to_pylist()}
        sources = [source for source in entry.sources if source[:12] in digests]
    name = hashlib.sha256("\n".join([entry.sha256, *sources]).encode()).hexdigest()[:12]
    return archive.write(replace(part, name=f"kept-{name}"), [others], sources=sources)


def _delete_unlisted(catalogue: Catalogue, selection: Selection) -> None:
    """Delete files of interrupted calls, which no version of the catalogue lists."""
    listed = {entry.file for entry in catalogue.files()}
    found = catalogue.folder.find(catalogue.kind)
    catalogue.folder.delete(
        place for place in found if place not in listed and selection.includes(place)
    )


def _forget_results(catalogue: Catalogue, selection: Selection, gone: set[str]) -> int:
    """Delete the files of results of deleted rows; return their number of rows."""
    count = 0
    for station, entries in catalogue.entries().items():
        left = [
            entry
            for entry in entries
            if gone.isdisjoint(entry.sources)
            and (selection.item is not None or not selection.includes(entry.file))
        ]
        count += sum(e.rows for e in entries) - sum(e.rows for e in left)
        catalogue.put(station, left)
        catalogue.expire(station, grace_s=0.0)
    _delete_unlisted(catalogue, selection)
    return count
