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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fsspec
import pyarrow.parquet
from fsspec.implementations.dirfs import DirFileSystem
from fsspec.implementations.local import LocalFileSystem

from palpate.errors import InputError, MissingExtraError, PalpateError
from palpate.files import atomic_path

#: Bytes sent at once; S3 accepts no smaller parts.
_BLOCK = 5 * 2**20
#: Libraries of stores, whose exceptions are not those of Python, such as missing credentials.
_LIBRARIES = {"botocore", "aiobotocore", "aiohttp", "gcsfs", "google", "adlfs", "azure"}


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


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder; places in it are relative paths with slashes."""

    #: The file system below the folder, which takes places.
    fs: Any
    #: The folder as the user named it.
    address: str
    #: Largest mean rate of writing, megabits per second, averaged over blocks of 5 MB.
    max_mbit: float | None = None

    @classmethod
    def open(cls, address: str | os.PathLike[str], *, max_mbit: float | None = None) -> Folder:
        """Return the folder at a path or an address, which need not exist.

        Raises `InputError` for an unknown kind of address, `MissingExtraError` without its library.
        """
        text = os.fspath(address)
        try:
            # Another process may write at any time, so listings are never remembered.
            fs, path = fsspec.url_to_fs(text, use_listings_cache=False)
        except ImportError as fault:
            raise MissingExtraError(f"{text}: {fault}") from fault
        except ValueError as fault:
            raise InputError(f"{text}: {fault}") from fault
        inside = DirFileSystem(path, fs, skip_instance_cache=True)
        return cls(inside, text.rstrip("/") or text, max_mbit)

    @classmethod
    def divide(cls, address: str | os.PathLike[str]) -> tuple[Folder, str]:
        """Return the folder of a file and the file's place in it."""
        folder, slash, name = os.fspath(address).rpartition("/")
        return cls.open(folder + slash or "."), name

    def name(self, place: str) -> str:
        """Return the path or address of a file, as other tools take it."""
        return f"{self.address}/{place}"

    def find(self, prefix: str = "") -> list[str]:
        """Return the finished files below a prefix, sorted."""
        found: list[str] = self.fs.find(prefix)
        return sorted(place for place in found if not place.rpartition("/")[2].startswith("."))

    def read_table(self, place: str, **options: Any) -> Any:
        """Return a Parquet file, or the columns that the options of PyArrow's function select."""
        with self.fs.open(place) as file:
            # With threads, PyArrow may release the file after the end of Python, which aborts.
            return pyarrow.parquet.read_table(file, use_threads=False, **options)

    @contextmanager
    def fetch(self, place: str) -> Iterator[Path]:
        """Yield a path of the file on this computer."""
        if path := self._on_disk(place):
            yield path
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, Path(place).name)
            self.fs.get_file(place, str(copy))
            yield copy

    @contextmanager
    def replace(self, place: str) -> Iterator[Path]:
        """Yield a temporary path; its file appears at the place if the block succeeds."""
        if final := self._on_disk(place):
            final.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(final) as partial:
                yield partial
                self._pause(partial.stat().st_size, time.monotonic())
            return
        with tempfile.TemporaryDirectory() as folder:
            partial = Path(folder, "partial")
            yield partial
            if self.max_mbit is None:
                self.fs.put_file(str(partial), place)
                return
            # Committed at the end, so that an interrupted upload leaves no file.
            target = self.fs.open(place, "wb", block_size=_BLOCK, autocommit=False)
            with partial.open("rb") as source:
                while block := source.read(_BLOCK):
                    began_s = time.monotonic()
                    target.write(block)
                    self._pause(len(block), began_s)
            target.close()
            target.commit()

    def create(self, place: str, content: bytes) -> None:
        """Write a small file that must not exist.

        Raises `FileExistsError` if it does; of several writers at one moment only one succeeds.
        """
        if not (final := self._on_disk(place)):
            self.fs.pipe_file(place, content, mode="create")
            return
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
                self.fs.rm_file(place)

    def _on_disk(self, place: str) -> Path | None:
        """Return the path of a place if the folder is in this computer's file system."""
        return Path(self.fs.path, place) if isinstance(self.fs.fs, LocalFileSystem) else None

    def _pause(self, count: int, began_s: float) -> None:
        """Wait until `count` bytes since `began_s` do not exceed the largest rate."""
        if self.max_mbit is not None:
            time.sleep(max(0.0, began_s + count * 8e-6 / self.max_mbit - time.monotonic()))
