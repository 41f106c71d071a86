"""The pages keep to the words that CONTRIBUTING.md lists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    str(page.relative_to(ROOT))
    for folder in (".", "docs", "docs/api", "docs/decisions")
    for page in sorted((ROOT / folder).glob("*.md"))
    if page.stem not in {"CHANGELOG", "CONTRIBUTING"}
]


def odd_words() -> list[str]:
    """Return the words of the left column of the table in CONTRIBUTING.md."""
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## Words")[1]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| ")]
    return [word.strip() for row in rows[1:] for word in row.split(",")]


def prose(page: str) -> str:
    """Return a page without its code and tables: those quote columns and commands."""
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.DOTALL)
    return "\n".join(line for line in text.splitlines() if not line.startswith("|"))


def test_the_list_is_read() -> None:
    assert {"told", "beside", "anew"} <= set(odd_words())


@pytest.mark.parametrize("page", PAGES)
def test_pages_use_plain_words(page: str) -> None:
    text = prose(page)
    found = [w for w in odd_words() if re.search(rf"\b{w}\b", text, flags=re.IGNORECASE)]
    assert found == []
