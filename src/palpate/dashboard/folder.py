"""The folder of recordings: what is in it, and what may be done with it. Nothing outside of it."""

from __future__ import annotations

import heapq
import math
import os
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from threading import Lock

from palpate.dashboard.history import check_name
from palpate.errors import InputError, PalpateError
from palpate.recording import RecordingReader

_ENDING = ".mcap"
#: Number of recordings that the page lists.
LISTED = 100
#: No file system's clock is coarser (FAT: 2 s).
_TICK_NS = 2_000_000_000


class RecordingList:
    """The newest recordings of a folder, which may hold hundreds of thousands.

    Its names are read again only when some came, changed or went, and only new files are asked when
    they were written. Used by several threads.

    Parameters
    ----------
    folder : Path
        The folder; it need not be there yet.
    now_ns : callable
        The wall's time, nanoseconds.
    """

    def __init__(self, folder: Path, *, now_ns: Callable[[], int] = time.time_ns) -> None:
        self._folder, self._now_ns, self._lock = folder, now_ns, Lock()
        #: When the folder had changed last when it was read, and when it is to be read once more.
        self._changed_ns, self._again_ns = -1, math.inf
        #: When each recording was last written, as it was when its name was new.
        self._written_s = dict[str, float]()
        self._newest: list[str] = []

    def newest(self) -> list[tuple[Path, os.stat_result]]:
        """Return the newest recordings, at most `LISTED`, with what the folder knows of them."""
        with self._lock:
            try:
                changed_ns = self._folder.stat().st_mtime_ns
                now_ns = self._now_ns()
                if changed_ns != self._changed_ns or now_ns > self._again_ns:
                    self._look_again()
                    self._changed_ns = changed_ns
                    # Within one tick of the file system's clock more may have followed.
                    unsettled = now_ns - changed_ns < _TICK_NS
                    self._again_ns = now_ns + _TICK_NS if unsettled else math.inf
            except OSError:
                return []
            names = self._newest
        listed = []
        for name in names:
            with suppress(OSError):  # it has gone meanwhile
                listed.append((self._folder / name, (self._folder / name).stat()))
        return sorted(listed, key=lambda one: (one[1].st_mtime, one[0].name), reverse=True)

    def _look_again(self) -> None:
        # Loops, and no sets: those would hold up every other thread for as long as they take.
        names = os.listdir(self._folder)
        found, new = 0, []
        for name in names:
            if name in self._written_s:
                found += 1
            elif name.endswith(_ENDING):
                new.append(name)
        is_any_gone = found < len(self._written_s)
        if is_any_gone:
            there = set(names)
            self._written_s = {n: s for n, s in self._written_s.items() if n in there}
        for name in new:
            with suppress(OSError):  # a dangling link, or it has gone meanwhile
                self._written_s[name] = (self._folder / name).stat().st_mtime
        # Without a loss only a new one can take the place of one of the newest.
        candidates = self._written_s if is_any_gone else {*self._newest, *new}
        self._newest = heapq.nlargest(
            LISTED,
            (name for name in candidates if name in self._written_s),
            key=lambda name: (self._written_s[name], name),
        )


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
        raise InputError(f"{name!r}: no recording of this folder")
    return file


def rename_recording(folder: Path, name: str, stem: str) -> Path:
    """Give a recording another name in the same folder; return it.

    Raises
    ------
    InputError
        If there is no such recording, the new name is no plain one, or it is taken.
    """
    file, renamed = recording_named(folder, name), folder / check_name(stem)
    try:
        # Unlike a renaming it never takes the place of another file.
        os.link(file, renamed)
        file.unlink()
    except FileExistsError as error:
        raise InputError(f"{renamed.stem}: there is a recording of this name") from error
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
