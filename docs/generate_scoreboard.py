"""Write the tables of claims into README.md and docs/scoreboard.md.

Usage: python docs/generate_scoreboard.py [--check]

With --check nothing is written, and the exit status is 1 where a page says something else than the
kept results of the studies.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate_studies.scoreboard import as_first_table, as_table, read_claims, with_table

DOCS = Path(__file__).parent
#: Page -> its table.
PAGES = {DOCS.parent / "README.md": as_first_table, DOCS / "scoreboard.md": as_table}


def main() -> int:
    """Write or check every page."""
    claims, stale = read_claims(DOCS), list[str]()
    for page, table in PAGES.items():
        now = page.read_text()
        wanted = with_table(now, table(claims))
        if wanted != now:
            stale.append(page.name)
            if "--check" not in sys.argv:
                page.write_text(wanted)
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
