"""Write README.md's table of claims and docs/results.md from the stored results.

Usage: python docs/generate_scoreboard.py [--check]

With --check nothing is written; the exit status is 1 if a page differs from the results.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate_studies.scoreboard import generate_pages


def main() -> int:
    """Write or check every page."""
    pages = generate_pages(Path(__file__).parent)
    stale = {
        page: text for page, text in pages.items() if not page.exists() or page.read_text() != text
    }
    if "--check" in sys.argv:
        return 1 if stale else 0
    for page, text in stale.items():
        page.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
