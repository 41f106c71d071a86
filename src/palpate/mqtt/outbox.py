"""Messages that wait for the broker: on the disk, in order, and no more than a stated number."""

from __future__ import annotations

import sqlite3
from pathlib import Path

#: At most this many messages wait: a day of a grasp every nine seconds, about 30 MB. When one more
#: comes the oldest goes, and is counted.
MOST_WAITING = 10_000


class Outbox:
    """A queue of messages in a file; for one thread.

    `path`: created, with its folder, if it does not exist.
    `most`: how many may wait.
    Raises `sqlite3.Error`: by every method, if the disk is full or the file is damaged.

    >>> outbox = Outbox(":memory:", most=2)
    >>> for text in (b"one", b"two", b"three"):
    ...     outbox.add(text)
    >>> number, oldest = outbox.oldest()
    >>> oldest, outbox.dropped
    (b'two', 1)
    >>> outbox.remove(number)
    >>> outbox.oldest()[1]
    b'three'
    """

    def __init__(self, path: str | Path, *, most: int = MOST_WAITING) -> None:
        self._most = most
        #: How many went unsent because too many waited.
        self.dropped = 0
        if path != ":memory:":
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        self._rows = sqlite3.connect(path, isolation_level=None)
        # What was taken survives a power cut.
        self._rows.execute("PRAGMA synchronous = FULL")
        self._rows.execute(
            "CREATE TABLE IF NOT EXISTS waiting "
            "(number INTEGER PRIMARY KEY AUTOINCREMENT, payload BLOB NOT NULL)"
        )

    def add(self, payload: bytes) -> None:
        """Take a message; it is on the disk when this returns."""
        self._rows.execute("INSERT INTO waiting (payload) VALUES (?)", (payload,))
        # Numbers have no gaps but at the front.
        gone = self._rows.execute(
            "DELETE FROM waiting WHERE number <= last_insert_rowid() - ?", (self._most,)
        )
        self.dropped += gone.rowcount

    def oldest(self) -> tuple[int, bytes] | None:
        """Return the message that has waited longest, and its number."""
        row: tuple[int, bytes] | None = self._rows.execute(
            "SELECT number, payload FROM waiting ORDER BY number LIMIT 1"
        ).fetchone()
        return row

    def remove(self, number: int) -> None:
        """Forget a message that has arrived."""
        self._rows.execute("DELETE FROM waiting WHERE number = ?", (number,))

    def close(self) -> None:
        """Let go of the file."""
        self._rows.close()
