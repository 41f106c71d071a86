"""Log of a running station: lines with time and level, and the file of who did what."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import SimpleQueue

LOG = logging.getLogger("palpate.serve")
#: Lines of JSON with `time`, `who` and `what`, in the folder of the recordings.
AUDIT_FILE = "audit.jsonl"
#: systemd reads the level of a line from this prefix (sd-daemon(3)).
_SYSTEMD_LEVELS = {logging.INFO: "<6>", logging.WARNING: "<4>", logging.ERROR: "<3>"}


def record_event(who: str, what: str, *, level: int = logging.INFO) -> None:
    """Log that a client has done something; `write_log` also adds it to the audit file."""
    LOG.log(level, "%s: %s", who, what, extra={"audit": (who, what)})


@contextmanager
def write_log(folder: Path) -> Iterator[None]:
    """Write the log to standard error, and its events to `AUDIT_FILE`, until the block ends.

    A thread of its own writes, so that a slow disk delays nobody, least of all a stop.
    """
    shown = logging.StreamHandler(sys.stderr)
    is_journal = "JOURNAL_STREAM" in os.environ
    shown.setFormatter(_JournalFormatter() if is_journal else _LINE)
    queue: SimpleQueue[logging.LogRecord] = SimpleQueue()
    into_queue = QueueHandler(queue)
    listener = QueueListener(queue, shown, _AuditHandler(folder / AUDIT_FILE))
    LOG.addHandler(into_queue)
    LOG.setLevel(logging.INFO)
    LOG.propagate = False
    listener.start()
    try:
        yield
    finally:
        LOG.removeHandler(into_queue)
        listener.stop()


_LINE = logging.Formatter("%(asctime)s %(levelname)s palpate serve: %(message)s")


class _JournalFormatter(logging.Formatter):
    """Prefixes a line with its level; the journal adds the time."""

    def format(self, record: logging.LogRecord) -> str:
        return _SYSTEMD_LEVELS.get(record.levelno, "<6>") + super().format(record)


class _AuditHandler(logging.Handler):
    """Appends events to the audit file."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._has_failed = path, False

    def emit(self, record: logging.LogRecord) -> None:
        if (event := getattr(record, "audit", None)) is None:
            return
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": time, "who": event[0], "what": event[1]}, ensure_ascii=False)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            self._has_failed = False
        except OSError as error:
            if not self._has_failed:
                LOG.error("the audit file can't be written: %s", error)
            self._has_failed = True
