"""Write the tables of the reference pages, which `mkdocs_tables.py` generates from the code.

Usage: python docs/generate_tables.py [--check]

With --check nothing is written; the exit status is 1 if a page differs from the code.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))
from mkdocs_tables import TABLES  # noqa: E402

#: A table on a page, with its begin and end marks.
_TABLE = re.compile(r"<!-- table: ([\w-]+) -->\n.*?<!-- end of table -->", re.DOTALL)


def fill_tables(page: str) -> str:
    """Return the text of a page with current tables."""
    return _TABLE.sub(
        lambda found: (
            f"<!-- table: {found[1]} -->\n\n{TABLES[found[1]]()}\n\n<!-- end of table -->"
        ),
        page,
    )


def main() -> int:
    """Write or check every page."""
    texts = {page: page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("*.md"))}
    stale = {page: new for page, text in texts.items() if (new := fill_tables(text)) != text}
    if "--check" in sys.argv:
        return 1 if stale else 0
    for page, text in stale.items():
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
