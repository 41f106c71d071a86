"""The languages of the pages: English texts, translated by .po files, and numbers as people write
them.
"""

from __future__ import annotations

from datetime import datetime
from functools import cache
from operator import itemgetter
from pathlib import Path
from string import Formatter
from typing import Any, NamedTuple

from palpate.dashboard.po_file import po_entries

_FOLDER = Path(__file__).parent / "languages"


class Message(str):
    """English text that a page can show in its own language.

    Whoever doesn't translate it has the English text, with its values filled in. Values that are
    messages themselves are translated too.

    Examples
    --------
    >>> text = Message("Lay {load_n:g} N on the pad", load_n=0.5)
    >>> text
    'Lay 0.5 N on the pad'
    >>> language_for("de", "")(text)
    '0,5 N auf das Pad legen'
    """

    template: str
    values: dict[str, object]

    def __new__(cls, template: str, **values: object) -> Message:
        """Fill in the values."""
        made = super().__new__(cls, template.format(**values))
        made.template, made.values = template, values
        return made

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, object]]:
        """Return what it is made again from in another process."""
        return (self.template,), self.values


class Facts(NamedTuple):
    """What a language needs apart from its catalogue: its tag in HTML, and its decimal mark."""

    tag: str
    decimal_mark: str
    own_name: str


LANGUAGES = {"en": Facts("en-US", ".", "English"), "de": Facts("de-DE", ",", "Deutsch")}


class Language(Formatter):
    """Translates texts to one language.

    Parameters
    ----------
    code : str
        A key of `LANGUAGES`.

    Examples
    --------
    >>> german = Language("de")
    >>> german("{n:.1f} N", n=1.5)
    '1,5 N'
    >>> german.many("{n} grasp", "{n} grasps", 2)
    '2 Griffe'
    """

    def __init__(self, code: str) -> None:
        self.code = code
        self.tag, self._decimal_mark, self.own_name = LANGUAGES[code]
        # The texts in the code are the English ones.
        entries = list[dict[str, str]]()
        if code != "en":
            entries = po_entries((_FOLDER / f"{code}.po").read_text(encoding="utf-8"))
        #: Every text by its English one, for scripts too.
        self.words = {one["msgid"]: one["msgstr"] for one in entries[1:] if "msgstr" in one}
        # One form for one, another for any other number, as in English and German.
        for one in entries[1:]:
            if "msgid_plural" in one:
                self.words[one["msgid"]] = one["msgstr[0]"]
                self.words[one["msgid_plural"]] = one["msgstr[1]"]

    def __call__(self, text: str, **values: object) -> str:
        """Return a text in this language, with the values filled in."""
        if isinstance(text, Message):
            return self(text.template, **text.values)
        return self.vformat(self.words.get(text, text), (), values)

    def many(self, one: str, more: str, n: int, **values: object) -> str:
        """Return the text for a number of things, which it may name as ``{n}``."""
        return self(one if n == 1 else more, n=n, **values)

    def number(self, value: float, spec: str) -> str:
        """Return a number as `format` writes it, with this language's decimal mark and a minus."""
        return self.format_field(float(value), spec).replace("-", "\N{MINUS SIGN}")

    def day(self, moment: datetime) -> str:
        """Return day and time."""
        return moment.strftime(self(Message("%d %b %H:%M")))

    def knows(self, text: str) -> bool:
        """Return whether a text is in this language: others come in English, whatever the page."""
        return self.code == "en" or isinstance(text, Message)

    def format_field(self, value: Any, format_spec: str) -> str:
        """Write one value: numbers with the decimal mark, messages in this language."""
        if isinstance(value, Message):
            value = self(value)
        written = format(value, format_spec)
        return written.replace(".", self._decimal_mark) if isinstance(value, float) else written


@cache
def _language(code: str) -> Language:
    return Language(code)


ENGLISH = _language("en")


#: Remembers in a browser which language was chosen on the page.
COOKIE = "palpate-language"


def language_for(asked: str | None, accepted: str) -> Language:
    """Return the language that a visitor asked for, else prefers, else English.

    Parameters
    ----------
    asked : str or None
        Value of ``lang`` in the address (``?lang=de``), else of the `COOKIE`.
    accepted : str
        The header ``Accept-Language``.

    Examples
    --------
    >>> language_for(None, "fr, de-AT;q=0.8, en;q=0.5").code
    'de'
    >>> language_for("en", "de").code, language_for("tlh", "").code
    ('en', 'en')
    """
    # Sorting keeps the order of equals.
    preferred = sorted(map(_weighed, accepted.split(",")), key=itemgetter(0), reverse=True)
    for tag in [asked or "", *(tag for weight, tag in preferred if weight > 0)]:
        code = tag.strip().lower().split("-")[0]
        if code in LANGUAGES:
            return _language(code)
    return ENGLISH


def _weighed(part: str) -> tuple[float, str]:
    """Return how much a browser prefers a language, and which."""
    tag, _, weight = part.partition(";q=")
    try:
        return float(weight or 1.0), tag
    except ValueError:
        return 0.0, tag


def error_text(error: Exception) -> str:
    """Return the text of an error: as a message, where it was raised with one."""
    first = error.args[0] if error.args else None
    return first if isinstance(first, Message) else str(error)
