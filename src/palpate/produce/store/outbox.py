"""Nothing is lost while the store is away: records go to the spool, and to the store later."""

from __future__ import annotations

import fcntl
import hashlib
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from palpate.errors import InputError, StoreAwayError, StoreError
from palpate.files import atomic_path, sync_folder
from palpate.produce.records import Grasp, Item, Verdict
from palpate.produce.records_json import (
    CalibrationText,
    StoreRecord,
    record_from_json,
    record_to_json,
)
from palpate.produce.store.database import Store
from palpate.produce.store.engine import lasting_name, store_url

#: Environment variable that names the folder of spools.
SPOOL_VARIABLE = "PALPATE_SPOOL"


class Keeper:
    """Writes to a store, or to its spool for as long as the store does not answer.

    Opening it refuses what waiting would not remedy: a file that is no store, a newer schema. What
    waits from earlier is written as soon as the store answers, before what is new.

    `where`: the store, as `Store.open` takes it.
    `spool`: where records wait; by default a file of this store's own, see `spool_path`.

    `away`: why records go to the spool; None while the store takes them.
    Raises `InputError` or `StoreError` if the store can't be used as it is.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with Keeper(folder / "items.sqlite", spool=Spool(folder / "waiting.jsonl")) as keeper:
    ...     keeper.keep(Item(item_id="A17"))
    True
    """

    def __init__(self, where: str | Path | None = None, *, spool: Spool | None = None) -> None:
        self._where = where
        self.spool = spool or spool_of(where)
        self._store: Store | None = None
        self.away: StoreError | None = None
        try:
            self._arrived()
        except StoreAwayError as error:
            self.away = error

    def keep(self, *records: StoreRecord) -> bool:
        """Write records in order; True where the store has them, False where they wait.

        They go to the spool first: a store that never answers, or a program that is ended while
        it waits for one, loses nothing.

        Raises `InputError` if the store refuses one of them for its content; `OSError` if the spool
        can't be written, and the store did not take them either.
        """
        try:
            self.spool.add(*records)
        except OSError as full:
            # The store alone may still take them.
            if self._straight(records):
                return True
            raise full
        refused: list[InputError] = []

        def write(record: StoreRecord) -> None:
            try:
                _write(self._opened(), record)
            except InputError as error:
                if record in records:
                    refused.append(error)
                raise

        try:
            self.spool.drain(write)
        except StoreError as error:
            self.away = error
            return False
        self.away = None
        if refused:
            raise refused[0]
        return True

    def _straight(self, records: tuple[StoreRecord, ...]) -> bool:
        try:
            store = self._arrived()
            for record in records:
                _write(store, record)
        except StoreError as error:
            self.away = error
            return False
        self.away = None
        return True

    def drain(self) -> int:
        """Write what waits to the store; return how many records were taken.

        Raises `StoreError` if the store still does not take them; they go on waiting.
        """
        return drain(self.spool, into=self._opened())

    def close(self) -> None:
        """Let go of the store. May be called twice."""
        if self._store is not None:
            self._store.close()
            self._store = None

    def __enter__(self) -> Keeper:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _opened(self) -> Store:
        if self._store is None:
            self._store = Store.open(self._where)
        return self._store

    def _arrived(self) -> Store:
        self.drain()
        return self._opened()


def drain(spool: Spool, *, into: Store) -> int:
    """Write what waits to a store that is open; return how many records were taken.

    Raises `StoreError` if the store does not take them; they go on waiting.
    """
    return spool.drain(lambda record: _write(into, record))


def spool_of(where: str | Path | None) -> Spool:
    """Return where records wait for a store that the user names so."""
    return Spool(spool_path(lasting_name(store_url(where))))


def _write(store: Store, record: StoreRecord) -> None:
    match record:
        case Item():
            store.add_item(record)
        case CalibrationText():
            store.add_calibration(record.content)
        case Grasp():
            store.add_grasp(record)
        case Verdict():
            store.add_verdict(record)


def spool_path(store: str) -> Path:
    """Return where records wait for a store.

    In ``$PALPATE_SPOOL``, else in ``$XDG_STATE_HOME/palpate``, else ``~/.local/state/palpate``: not
    in the store's folder, whose disk may be the one that is full or away.

    `store`: name of the store, the same each time.
    """
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    folder = Path(os.environ.get(SPOOL_VARIABLE) or Path(state) / "palpate")
    return folder / f"spool-{hashlib.sha256(store.encode()).hexdigest()[:12]}.jsonl"


class Spool:
    """Records that wait, in the order they came; several processes may add.

    Each record is a line with its checksum, on the disk before it is acknowledged. A line that a
    crash has cut was never acknowledged; its checksum shows it and it is skipped. Records carry
    their own ids, so draining twice does no harm.

    `path`: the file; made with its folder when the first record is added.

    >>> import tempfile
    >>> from palpate.produce.records import Item
    >>> spool = Spool(Path(tempfile.mkdtemp()) / "waiting.jsonl")
    >>> spool.add(Item(item_id="A17"))
    >>> spool.drain(lambda record: print(record.item_id))
    A17
    1
    >>> spool.drain(print)
    0
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def add(self, *records: StoreRecord) -> None:
        """Append records; they are on the disk when it returns, all or, after a crash, the first.

        Raises `OSError` if the file can't be written; it is then as it was.
        """
        lines = b"".join(_line(record) for record in records)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self._locked() as descriptor:
            end = os.fstat(descriptor).st_size
            try:
                # A cut line must not swallow the next one.
                _write_all(descriptor, lines if _ends_whole(descriptor, end) else b"\n" + lines)
                os.fsync(descriptor)
            except OSError:
                os.ftruncate(descriptor, end)
                raise
        # A new file is safe only once its folder's entry is.
        sync_folder(self.path.parent)

    def waiting(self) -> tuple[StoreRecord, ...]:
        """Return the records that wait, oldest first."""
        found = []
        for line in self._lines():
            with suppress(InputError):
                found.append(_record(line))
        return tuple(found)

    def drain(self, write: Callable[[StoreRecord], object]) -> int:
        """Hand every waiting record to `write`, then forget them; return how many were taken.

        A line that is cut, or a record that `write` refuses for its content (`InputError`), goes
        to a file next to the spool that ends in ``.refused``. Whatever else `write` raises ends the
        draining: nothing is forgotten, and the next one begins again. The file is not locked
        meanwhile, since a store may not answer: others go on adding, and two that drain at once
        write the same records twice, which does no harm.
        """
        if not self.path.exists():
            return 0
        taken, refused = 0, b""
        with self._locked():
            lines = self._lines()
        for line in lines:
            try:
                write(_record(line))
                taken += 1
            except InputError:
                refused += line + b"\n"
        if lines:
            # Where the disk is full they go on waiting, and are written once more.
            with suppress(OSError):
                self._forget(lines, refused=refused)
        return taken

    def _forget(self, lines: list[bytes], *, refused: bytes) -> None:
        """Take these lines out of the file, and keep the refused ones in a file next to it."""
        gone = set(lines)
        with self._locked() as descriptor:
            present = self._lines()
            if refused and gone & set(present):
                with self.path.with_suffix(".refused").open("ab") as stream:
                    stream.write(refused)
                    stream.flush()
                    os.fsync(stream.fileno())
            rest = [line for line in present if line not in gone]
            if rest:
                with atomic_path(self.path) as partial:
                    partial.write_bytes(b"".join(line + b"\n" for line in rest))
            else:
                os.ftruncate(descriptor, 0)
                os.fsync(descriptor)

    def _lines(self) -> list[bytes]:
        try:
            return [line for line in self.path.read_bytes().split(b"\n") if line]
        except FileNotFoundError:
            return []

    @contextmanager
    def _locked(self) -> Iterator[int]:
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
        while True:
            descriptor = os.open(self.path, flags, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                # While this waited for its turn, the file may have been replaced.
                if self._is_at_path(descriptor):
                    yield descriptor
                    return
            finally:
                os.close(descriptor)

    def _is_at_path(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), self.path.stat())
        except FileNotFoundError:
            return False


def _line(record: StoreRecord) -> bytes:
    text = record_to_json(record).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _record(line: bytes) -> StoreRecord:
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        raise InputError(f"a line of the spool is cut: {line[:40]!r}")
    return record_from_json(text.decode())


def _ends_whole(descriptor: int, end: int) -> bool:
    return end == 0 or os.pread(descriptor, 1, end - 1) == b"\n"


def _write_all(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
