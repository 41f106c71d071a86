"""Write the tables of the reference pages, which `mkdocs_tables.py` generates from the code.

Usage: python docs/generate_tables.py [--check]

With --check nothing is written; the exit status is 1 if a page differs from the code.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]
from generated import update_pages  # noqa: E402
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


if __name__ == "__main__":
    sys.exit(update_pages(DOCS, fill_tables))
