"""The texts of the pages, in English or in another language."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate.errors import InputError

_ENGLISH = Path(__file__).parent / "words.json"
_PLACEHOLDER = re.compile(r"\{(\w+)\}")
#: Parts of the sensor in other texts, by the key of their name.
_PARTS = {
    "part.pixel": re.compile(r"\b(?:pixel )?R(?P<row>\d+) C(?P<col>\d+)\b"),
    "part.row": re.compile(r"\brow R(?P<n>\d+)\b"),
    "part.column": re.compile(r"\bcolumn C(?P<n>\d+)\b"),
    "part.finger": re.compile(r"\bfinger (?P<n>\d+)\b"),
}


class Words:
    """Texts by their keys; `words.json` has all keys with the English texts.

    Parameters
    ----------
    translation : mapping, optional
        Texts that replace English ones.

    Raises
    ------
    InputError
        If a key is unknown, or a placeholder is missing or unknown.

    Examples
    --------
    >>> words = Words({"opens_in": "öffnet in {s} s"})
    >>> words("opens_in", s=5), words("button.grasp")
    ('öffnet in 5 s', 'Grasp')
    """

    def __init__(self, translation: Mapping[str, str] | None = None) -> None:
        english: dict[str, str] = json.loads(_ENGLISH.read_text(encoding="utf-8"))
        for key, text in (translation or {}).items():
            if key not in english:
                raise InputError(f"no text has the key {key!r}; see {_ENGLISH.name}")
            needed, found = (set(_PLACEHOLDER.findall(one)) for one in (english[key], str(text)))
            if needed != found:
                expected, actual = (", ".join(sorted(one)) or "none" for one in (needed, found))
                raise InputError(
                    f"the text {key!r} must have the placeholders {expected}, not {actual}"
                )
        #: All texts by their keys, for the page's scripts.
        self.texts: Mapping[str, str] = {**english, **(translation or {})}

    def __call__(self, key: str, **values: Any) -> str:
        """Return a text with its placeholders filled."""
        return self.texts[key].format(**values)

    @classmethod
    def read(cls, file: Path) -> Words:
        """Read a translation: a JSON object of texts by key, which may omit keys.

        Raises
        ------
        InputError
            If the file can't be read, or a text does not fit.
        """
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
            if not isinstance(found, dict):
                raise ValueError("not an object of texts")
            return cls(found)
        except (OSError, ValueError) as error:
            raise InputError(f"texts {file}: {error}") from error

    def name_parts(self, text: str) -> str:
        """Return a text with the pages' names of fingers and pixels, which count from 1.

        >>> Words().name_parts("pixel R0 C1 reads open; finger 0 and row R1 too")
        'row 1, column 2 reads open; finger 1 and row 2 too'
        """
        for key, part in _PARTS.items():
            text = part.sub(
                lambda found, key=key: self(  # type: ignore[misc]
                    key, **{name: int(one) + 1 for name, one in found.groupdict().items()}
                ),
                text,
            )
        return text

    def fill(self, html: str) -> str:
        """Return HTML with ``{{key}}`` replaced by the texts."""
        return re.sub(r"\{\{([\w.]+)\}\}", lambda key: self.texts[key[1]], html)
