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

    def fill(self, html: str) -> str:
        """Return HTML with ``{{key}}`` replaced by the texts."""
        return re.sub(r"\{\{([\w.]+)\}\}", lambda key: self.texts[key[1]], html)
