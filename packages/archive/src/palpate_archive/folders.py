"""A folder of this computer, or of any store that fsspec opens: ``s3://``, ``gs://``, ``az://``.

A file appears whole or not at all: by renaming on a disk, by putting an object in a store.
Credentials are those of the store's library, such as ``AWS_PROFILE`` or ``~/.aws``.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fsspec
import pyarrow.parquet
from fsspec.implementations.local import LocalFileSystem

from palpate.errors import InputError, MissingExtraError, PalpateError
from palpate.files import atomic_path

#: Bytes sent at once; S3 accepts no smaller parts.
_BLOCK = 5 * 2**20
#: Libraries of stores, whose exceptions are not those of Python, such as missing credentials.
_LIBRARIES = {"botocore", "aiobotocore", "aiohttp", "gcsfs", "google", "adlfs", "azure"}
#: Protocol -> extra of this package with its library.
_EXTRAS = {"s3": "s3", "gs": "gcs", "az": "azure"}


@contextmanager
def explain_store_errors() -> Iterator[None]:
    """Raise a `PalpateError` of one line instead of an exception of a store's library."""
    try:
        yield
    except Exception as fault:
        if type(fault).__module__.split(".")[0] not in _LIBRARIES:
            raise
        reason = " ".join(str(fault).split())
        raise PalpateError(
            f"the store failed: {reason}; check the address, the credentials and the network, and "
            "run this again to continue"
        ) from fault


class Pace:
    """Pauses that limit a rate, averaged over blocks of 5 MB.

    `max_mbit`: megabits per second.
    """

    def __init__(self, max_mbit: float) -> None:
        self._s_per_byte = 8e-6 / max_mbit
        self._free_s = 0.0

    def wait(self, count: int) -> None:
        """Pause after sending `count` bytes."""
        now_s = time.monotonic()
        self._free_s = max(self._free_s, now_s) + count * self._s_per_byte
        time.sleep(self._free_s - now_s)


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder; places in it are relative paths with slashes."""

    fs: Any
    path: str
    #: The folder as the user named it.
    address: str
    pace: Pace | None = field(default=None, compare=False)

    @classmethod
    def open(cls, address: str | os.PathLike[str], *, max_mbit: float | None = None) -> Folder:
        """Return the folder at a path or an address, which need not exist.

        `max_mbit`: largest mean rate of writing, megabits per second.
        Raises `InputError` for an unknown kind of address, `MissingExtraError` without its library.
        """
        text = os.fspath(address)
        try:
            # Another process may write at any time, so listings are never remembered.
            fs, path = fsspec.url_to_fs(text, use_listings_cache=False)
        except ImportError as fault:
            extra = _EXTRAS.get(text.split(":")[0], "")
            raise MissingExtraError(
                f"{text}: {fault}" + (f" (pip install 'palpate-archive[{extra}]')" if extra else "")
            ) from fault
        except ValueError as fault:
            raise InputError(f"{text}: {fault}") from fault
        pace = None if max_mbit is None else Pace(max_mbit)
        return cls(fs, path.rstrip("/"), text.rstrip("/") or text, pace)

    @property
    def is_local(self) -> bool:
        """Whether the folder is in this computer's file system."""
        return isinstance(self.fs, LocalFileSystem)

    def name(self, place: str) -> str:
        """Return the path or address of a file, as other tools take it."""
        return f"{self.address}/{place}"

    def exists(self, place: str = "") -> bool:
        """Return whether a file or folder exists."""
        return bool(self.fs.exists(self._full(place)))

    def find(self, prefix: str = "") -> dict[str, int]:
        """Return place -> size of the finished files below a prefix, in the order of places."""
        found = self.fs.find(self._full(prefix), detail=True)
        cut = len(self.path) + 1
        places = {path[cut:]: int(info["size"]) for path, info in found.items()}
        hidden = (place for place in places if place.rpartition("/")[2].startswith("."))
        return {place: places[place] for place in sorted(places.keys() - set(hidden))}

    def age_s(self, place: str) -> float:
        """Return the time since a file was written, seconds."""
        return time.time() - float(self.fs.modified(self._full(place)).timestamp())

    def read(self, place: str) -> bytes:
        """Return the bytes of a file."""
        return bytes(self.fs.cat_file(self._full(place)))

    def read_all(self, places: Iterable[str]) -> dict[str, bytes]:
        """Return the bytes of files, fetched at the same time where the store can."""
        full = {self._full(place): place for place in places}
        found = self.fs.cat(list(full), recursive=False) if full else {}
        if isinstance(found, bytes):  # of a single file
            return {next(iter(full.values())): found}
        return {full[path]: content for path, content in found.items()}

    def read_table(self, place: str, **options: Any) -> Any:
        """Return columns of a Parquet file, fetching only them; options of PyArrow's function."""
        # With threads, PyArrow may close the file after the end of Python, which aborts.
        return pyarrow.parquet.read_table(
            self._full(place), filesystem=self.fs, partitioning=None, use_threads=False, **options
        )

    @contextmanager
    def fetch(self, place: str) -> Iterator[Path]:
        """Yield a path of the file on this computer."""
        if self.is_local:
            yield Path(self._full(place))
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / Path(place).name
            self.fs.get_file(self._full(place), str(copy))
            yield copy

    @contextmanager
    def replace(self, place: str) -> Iterator[Path]:
        """Yield a temporary path; its file appears at the place if the block succeeds."""
        if self.is_local:
            final = Path(self._full(place))
            final.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(final) as partial:
                yield partial
            if self.pace is not None:
                self.pace.wait(final.stat().st_size)
            return
        with tempfile.TemporaryDirectory() as folder:
            partial = Path(folder) / Path(place).name
            yield partial
            self._put(partial, place)

    def create(self, place: str, content: bytes) -> None:
        """Write a small file that must not exist.

        Raises `FileExistsError` if it does; of several writers at one moment only one succeeds.
        """
        if not self.is_local:
            self.fs.pipe_file(self._full(place), content, mode="create")
            return
        final = Path(self._full(place))
        final.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=final.parent, prefix=".") as partial:
            partial.write(content)
            partial.flush()
            os.fsync(partial.fileno())
            # A rename would overwrite the file of another writer.
            os.link(partial.name, final)
        final.chmod(0o644)

    def delete(self, places: Iterable[str]) -> None:
        """Delete files; those already gone are fine."""
        for place in places:
            with suppress(FileNotFoundError):
                self.fs.rm_file(self._full(place))

    def _full(self, place: str) -> str:
        return f"{self.path}/{place}" if place else self.path

    def _put(self, partial: Path, place: str) -> None:
        size = partial.stat().st_size
        if self.pace is None or size <= _BLOCK:
            self.fs.put_file(str(partial), self._full(place))
            if self.pace is not None:
                self.pace.wait(size)
            return
        # Committed at the end, so that an interrupted upload leaves no file.
        target = self.fs.open(self._full(place), "wb", block_size=_BLOCK, autocommit=False)
        with partial.open("rb") as source:
            while block := source.read(_BLOCK):
                target.write(block)
                self.pace.wait(len(block))
        target.close()
        target.commit()
