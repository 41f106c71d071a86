"""Log of a running station: lines with time and level, and the file of who did what."""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import SimpleQueue
from threading import Lock

LOG = logging.getLogger("palpate.serve")
#: Lines of JSON with `time`, `who` and `what`, in the folder of the recordings.
AUDIT_FILE = "audit.jsonl"
#: Refusals written in a minute, and of them those of one client.
MAX_REFUSALS, MAX_REFUSALS_OF_CLIENT, _REFUSAL_WINDOW_S = 30, 5, 60.0
#: systemd reads the level of a line from this prefix (sd-daemon(3)).
_SYSTEMD_LEVELS = {logging.INFO: "<6>", logging.WARNING: "<4>", logging.ERROR: "<3>"}


def record_event(who: str, what: str, *, level: int = logging.INFO) -> None:
    """Log that a client has done something; `write_log` also adds it to the audit file."""
    LOG.log(level, "%s: %s", who, what, extra={"audit": (who, what)})


class RefusalLog:
    """Logs refused logins and orders, but so few a minute that a flood does not fill the disk.

    The next line has the number of refusals that were left out.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s, self._lock = now_s, Lock()
        #: Times and clients of the lines within the last minute.
        self._written = deque[tuple[float, str]]()
        self._omitted = 0

    def record(self, who: str, what: str) -> None:
        """Log and audit that a client was refused something, unless there were too many lines."""
        with self._lock:
            now_s = self._now_s()
            while self._written and now_s - self._written[0][0] > _REFUSAL_WINDOW_S:
                self._written.popleft()
            of_client = [name for _, name in self._written].count(who)
            if len(self._written) >= MAX_REFUSALS or of_client >= MAX_REFUSALS_OF_CLIENT:
                self._omitted += 1
                return
            self._written.append((now_s, who))
            omitted, self._omitted = self._omitted, 0
        more = f" ({omitted} more refusals before)" if omitted else ""
        record_event(who, f"refused: {what}{more}", level=logging.WARNING)


#: The log of all protocols, with common limits.
record_refusal = RefusalLog().record


@contextmanager
def write_log(folder: Path) -> Iterator[None]:
    """Write the log to standard error, and its events to `AUDIT_FILE`, until the block ends.

    A thread of its own writes, so that a slow disk delays nobody, least of all a stop.
    """
    shown = logging.StreamHandler(sys.stderr)
    is_journal = "JOURNAL_STREAM" in os.environ
    shown.setFormatter(_JournalFormatter() if is_journal else _LINE)
    queue: SimpleQueue[logging.LogRecord] = SimpleQueue()
    into_queue, server = QueueHandler(queue), logging.getLogger("uvicorn")
    listener = QueueListener(queue, shown, _AuditHandler(folder / AUDIT_FILE))
    for log in (LOG, server):
        log.addHandler(into_queue)
        log.propagate = False
    LOG.setLevel(logging.INFO)
    listener.start()
    try:
        yield
    finally:
        for log in (LOG, server):
            log.removeHandler(into_queue)
        listener.stop()


#: With the time zone, because the audit and the API have UTC.
_LINE = logging.Formatter(
    "%(asctime)s %(levelname)s palpate serve: %(message)s", datefmt="%Y-%m-%d %H:%M:%S%z"
)


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
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": at, "who": event[0], "what": event[1]}, ensure_ascii=False)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            self._has_failed = False
        except OSError as error:
            if not self._has_failed:
                LOG.error("the audit file can't be written: %s", error)
            self._has_failed = True
