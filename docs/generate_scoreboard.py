"""Write the tables of claims into README.md and docs/scoreboard.md.

Usage: python docs/generate_scoreboard.py [--check]

With --check nothing is written, and the exit status is 1 where a page says something else than the
kept results of the studies.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate_studies.scoreboard_tables import generated_pages


def main() -> int:
    """Write or check every page."""
    pages = generated_pages(Path(__file__).parent)
    stale = {page: text for page, text in pages.items() if page.read_text() != text}
    if "--check" in sys.argv:
        return 1 if stale else 0
    for page, text in stale.items():
        page.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
