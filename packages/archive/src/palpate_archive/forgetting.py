"""Delete stations, items or days from an archive and from its results.

Other commands may write at the same time. Their files that no catalogue lists yet are entered
first, so they are deleted like the others; and the sources of deleted rows stay in the catalogue,
where each of these commands finds them before it enters its own files.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, timedelta
from functools import partial
from pathlib import PurePath

import pyarrow as pa
import pyarrow.compute as pc

from palpate_archive.adding import sanitize
from palpate_archive.catalogue import CATALOGUE, Catalogue, Change, Entry, Part
from palpate_archive.folders import Folder
from palpate_archive.layout import KINDS, SIMULATED, describe_file, read_sources, write_tables


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What to delete: the rows that all given conditions select."""

    station: str | None = None
    item: str | None = None
    #: ``YYYY-MM-DD`` in UTC, or ``simulated``.
    day: str | None = None
    #: Days before this one, never simulated ones.
    before: str | None = None

    def includes(self, part: Part) -> bool:
        """Return whether a file may contain selected rows."""
        is_early = self.before is None or (part.date != SIMULATED and part.date < self.before)
        return self.station in (None, part.station) and self.day in (None, part.date) and is_early


def forget(archive: Folder, selection: Selection, *, results: Iterable[Folder]) -> dict[str, int]:
    """Delete the selected rows now; return kind or job -> rows deleted.

    A file with other rows too is written again without the selected ones. The results of a changed
    file are deleted whole; the next evaluation computes those of its other rows. The sources of
    deleted rows stay in the catalogue, so that a station does not add them again. An item's frames
    and holds are those of the recordings that its grasps name.
    """
    catalogues = [Catalogue(archive, kind) for kind in KINDS]
    for catalogue in catalogues:
        _enter_unlisted(catalogue, selection)
    labels = None if selection.item is None else _find_labels(archive, selection)
    deleted, gone = Counter[str](), set[str]()
    # Grasps last: after an interruption they still name the recordings.
    for catalogue in catalogues:
        wanted = labels
        if selection.item is not None and catalogue.kind == "grasps":
            wanted = {selection.item}
        leave_out = partial(_leave_out, archive=archive, selection=selection, wanted=wanted)
        deleted[catalogue.kind] += _change_all(catalogue, leave_out)
        gone |= catalogue.sources(deleted=True)
        _delete_files(catalogue, gone)
    for folder in results:
        # Also those of a job that was interrupted before it had a catalogue.
        for job in sorted({place.split("/")[0] for place in folder.find()} - {CATALOGUE}):
            catalogue = Catalogue(folder, job)
            deleted[job] += _change_all(
                catalogue, lambda before: [e for e in before if gone.isdisjoint(e.sources)]
            )
            _delete_files(catalogue, gone)
    return dict(deleted)


def _enter_unlisted(catalogue: Catalogue, selection: Selection) -> None:
    """Enter the files of running or interrupted calls that may contain selected rows."""
    folder, held = catalogue.folder, catalogue.sources()
    entries = []
    for place, sources in _find_unlisted(catalogue):
        if sources and held.isdisjoint(sources) and selection.includes(Part.parse(place)):
            with folder.fetch(place) as path:
                entries.append(describe_file(path, place))
    catalogue.add(entries)


def _delete_files(catalogue: Catalogue, gone: set[str]) -> None:
    """Delete the files with deleted sources, which the catalogue no longer lists."""
    for place, sources in _find_unlisted(catalogue):
        if not gone.isdisjoint(sources):
            catalogue.folder.delete([place])


def _find_unlisted(catalogue: Catalogue) -> Iterator[tuple[str, set[str]]]:
    """Yield the place and sources of files that the newest versions do not list."""
    listed = {entry.file for entry in catalogue.files()}
    for place in catalogue.folder.find(catalogue.kind):
        # Another command may have deleted it meanwhile.
        with suppress(FileNotFoundError):
            if place not in listed:
                yield place, read_sources(catalogue.folder, place)


def _change_all(catalogue: Catalogue, decide: Change) -> int:
    """Change the entries of all stations; return the number of deleted rows."""
    count = 0
    for station in catalogue.stations():
        before, after = catalogue.change(station, decide)
        count += sum(entry.rows for entry in before) - sum(entry.rows for entry in after)
    return count


def _find_labels(archive: Folder, selection: Selection) -> set[str]:
    """Return the labels of the recordings that the item's grasps name."""
    wanted = set[tuple[str, str, str]]()
    for entry in Catalogue(archive, "grasps").files():
        table = archive.read_table(
            entry.file, columns=["recording"], filters=[("item_id", "==", selection.item)]
        )
        # A recording that lasts beyond midnight begins the day before its grasp.
        before = date.fromisoformat(entry.part.date) - timedelta(days=1)
        for file in filter(None, table["recording"].to_pylist()):
            for day in (entry.part.date, before.isoformat(), SIMULATED):
                wanted.add((entry.part.station, day, sanitize(PurePath(file).stem)))
    found = set[str]()
    for kind in ("frames", "holds"):
        for entry in Catalogue(archive, kind).files():
            at = (entry.part.station, entry.part.date)
            names = {name for *place, name in wanted if tuple(place) == at}
            if names and selection.includes(entry.part):
                table = archive.read_table(entry.file, columns=["recording"])
                labels = pc.unique(table["recording"]).to_pylist()
                found |= {label for label in labels if label.rpartition("-")[0] in names}
    return found


def _leave_out(
    before: list[Entry], *, archive: Folder, selection: Selection, wanted: set[str] | None
) -> list[Entry]:
    """Return the entries without the wanted rows, and one of the deleted sources.

    `wanted`: recordings, or the item for grasps; None for all rows of the selected files.
    """
    after, gone = list[Entry](), set[str]()
    for entry in before:
        left = entry if entry.file else None
        if left and selection.includes(entry.part):
            left = _keep_others(archive, entry, wanted)
        after += [left] if left else []
        gone |= set(entry.sources) - set(left.sources if left else ())
    return [*([Entry("", 0, "", tuple(sorted(gone)))] if gone else []), *after]


def _keep_others(archive: Folder, entry: Entry, wanted: set[str] | None) -> Entry | None:
    """Write the other rows of a file; return their entry, the same one if it has no wanted rows."""
    if wanted is None:
        return None
    part = entry.part
    table = archive.read_table(entry.file)
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
    place = part._replace(name=f"kept-{name}").place
    return write_tables(archive, place, [others], sources=sources)
