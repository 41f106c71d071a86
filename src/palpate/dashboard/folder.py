"""The folder of recordings: what is in it, and what may be done with it. Nothing outside of it."""

from __future__ import annotations

import heapq
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from threading import Lock

from palpate.dashboard.history import checked_name
from palpate.dashboard.language import Message
from palpate.errors import InputError, PalpateError
from palpate.recording import RecordingReader

_ENDING = ".mcap"
#: Number of recordings that the page lists.
LISTED = 100
#: No file system's clock is coarser (FAT: 2 s).
_TICK_NS = 2_000_000_000


class RecordingList:
    """The newest recordings of a folder, which may hold hundreds of thousands.

    It is read again only when names came, changed or went since; used by several threads.

    Parameters
    ----------
    folder : Path
        The folder; it need not be there yet.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._lock = folder, Lock()
        self._changed_ns: int | None = None
        self._newest: list[Path] = []

    def newest(self) -> list[tuple[Path, os.stat_result]]:
        """Return the newest recordings, at most `LISTED`, with what the folder knows of them."""
        with self._lock:
            try:
                changed_ns = self._folder.stat().st_mtime_ns
            except OSError:
                return []
            if changed_ns != self._changed_ns:
                found = heapq.nlargest(LISTED, _recordings_in(self._folder))
                self._newest = [self._folder / name for _, name in found]
                # Within one tick of the file system's clock more may follow.
                settled = time.time_ns() - changed_ns > _TICK_NS
                self._changed_ns = changed_ns if settled else None
            files = self._newest
        listed = []
        for file in files:
            with suppress(OSError):  # it has gone meanwhile
                listed.append((file, file.stat()))
        return sorted(listed, key=lambda one: (one[1].st_mtime, one[0].name), reverse=True)


def _recordings_in(folder: Path) -> Iterator[tuple[float, str]]:
    """Yield when each recording was last written, and its name."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(_ENDING):
                with suppress(OSError):  # a dangling link, or it has gone meanwhile
                    yield entry.stat().st_mtime, entry.name


def new_recording(folder: Path, what: str) -> Path:
    """Return the name of a recording that does not exist yet."""
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    file = folder / f"{what}-{stamp}{_ENDING}"
    number = 1
    while file.exists():
        number += 1
        file = folder / f"{what}-{stamp}-{number}{_ENDING}"
    return file


def recording_named(folder: Path, name: str) -> Path:
    """Return a recording of the folder by its name.

    Raises
    ------
    InputError
        If the name is no plain one, there is no such file, or it is a link to somewhere else.
    """
    file = folder / name
    plain = name == Path(name).name and name.endswith(_ENDING) and "\0" not in name
    if not plain or file.is_symlink() or not file.is_file():
        raise InputError(Message("{name!r}: no recording of this folder", name=name))
    return file


def rename_recording(folder: Path, name: str, stem: str) -> Path:
    """Give a recording another name in the same folder; return it.

    Raises
    ------
    InputError
        If there is no such recording, the new name is no plain one, or it is taken.
    """
    file, renamed = recording_named(folder, name), folder / checked_name(stem)
    try:
        # Unlike a renaming it never takes the place of another file.
        os.link(file, renamed)
        file.unlink()
    except FileExistsError as error:
        raise InputError(
            Message("{name}: there is a recording of this name", name=renamed.stem)
        ) from error
    except OSError as error:
        raise InputError(f"{name} can't be renamed: {error.strerror}") from error
    return renamed


def delete_recording(folder: Path, name: str) -> None:
    """Delete a recording.

    Raises
    ------
    InputError
        If there is none of this name, or it can't be deleted.
    """
    try:
        recording_named(folder, name).unlink()
    except OSError as error:
        raise InputError(f"{name} can't be deleted: {error.strerror}") from error


def is_simulated(file: Path, status: os.stat_result) -> bool:
    """Return whether a recording is of simulated frames; false for what can't be read."""
    return _origin(file, status.st_mtime_ns) not in ("hardware", "")


@lru_cache(maxsize=1000)
def _origin(file: Path, changed_ns: int) -> str:
    del changed_ns  # a file that grew may have become readable
    try:
        with RecordingReader(file) as reader:
            return reader.info.origin
    except (PalpateError, OSError):
        return ""
