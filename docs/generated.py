"""Files that are generated from the code: written, or compared with what the code gives."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path


def update_pages(folder: Path, fill: Callable[[str], str]) -> int:
    """Write or check the pages of a folder; `fill` returns the current text of a page."""
    pages = sorted(folder.glob("*.md"))
    return update_files({page: fill(page.read_text(encoding="utf-8")) for page in pages})


def update_files(texts: Mapping[Path, str]) -> int:
    """Write the texts that differ from their files, and return the exit status.

    With --check nothing is written; the exit status is 1 if a file differs.
    """
    stale = {
        path: text
        for path, text in texts.items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    }
    if "--check" in sys.argv:
        return 1 if stale else 0
    for path, text in stale.items():
        path.write_text(text, encoding="utf-8")
    return 0
