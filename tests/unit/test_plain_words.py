"""Pages and source keep to the words that CONTRIBUTING.md lists."""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
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


def test_contributing_word_list_is_parsed() -> None:
    assert {"told", "beside", "anew"} <= set(odd_words())


@pytest.mark.parametrize("page", PAGES)
def test_pages_use_plain_words(page: str) -> None:
    text = prose(page)
    found = [w for w in odd_words() if re.search(rf"\b{w}\b", text, flags=re.IGNORECASE)]
    assert found == []


def list_texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield comments, docstrings and messages with their lines; examples are left out."""
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", None)}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        # A single word is a name: a key, a column, a label.
        if token.type in kinds and " " in token.string:
            for number, line in enumerate(token.string.splitlines(), token.start[0]):
                if not line.lstrip().startswith((">>>", "...")):
                    yield number, re.sub(r"`[^`]*`|\{[^{}]*\}", "", line)


def test_source_uses_plain_words() -> None:
    odd = re.compile(rf"\b({'|'.join(odd_words())})\b", flags=re.IGNORECASE)
    found = [
        f"{file.relative_to(ROOT)}:{number}: {text.strip()}"
        for file in sorted((ROOT / "src").rglob("*.py"))
        for number, text in list_texts(file.read_text())
        if odd.search(text)
    ]
    assert found == []
