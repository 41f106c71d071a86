"""Delete the recordings of old grasps."""

from __future__ import annotations

import re
import time
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from palpate_station.dashboard.audit import record_event

#: Matches the name that a recording of a grasp gets; a recording that a person renamed is kept.
_GRASP = re.compile(r"grasp-\d{8}-\d{6}(-\d+)?\.mcap")
_DAY_S = 86_400.0


def delete_old_recordings(
    folder: Path, *, keep_days: float, in_use: Collection[str] = (), now_s: float | None = None
) -> int:
    """Delete recordings of grasps older than `keep_days`; return their number.

    The items and their measurements stay in the store. Renamed recordings and names `in_use` are
    kept.
    """
    oldest_s = (time.time() if now_s is None else now_s) - keep_days * _DAY_S
    deleted = 0
    for file in folder.glob("grasp-*.mcap"):
        # A file may disappear, or be protected.
        with suppress(OSError):
            is_old = file.stat().st_mtime < oldest_s
            if is_old and _GRASP.fullmatch(file.name) and file.name not in in_use:
                file.unlink()
                deleted += 1
    if deleted:
        record_event("--keep-days", f"deleted {deleted} recordings older than {keep_days:g} days")
    return deleted
