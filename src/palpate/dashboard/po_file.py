"""Translations read from a gettext .po file, so that no compiled copy of it can be out of date."""

from __future__ import annotations

import ast
import io
import struct
from gettext import GNUTranslations

_MAGIC = 0x950412DE
_FIELDS = ("msgid_plural", "msgid", "msgstr[0]", "msgstr[1]", "msgstr")


def translations(entries: list[dict[str, str]]) -> GNUTranslations:
    """Return what translates by the entries of a .po file.

    Examples
    --------
    >>> german = translations([{"msgid": "Stop", "msgstr": "Anhalten"}])
    >>> german.gettext("Stop"), german.gettext("Go")
    ('Anhalten', 'Go')
    """
    return GNUTranslations(io.BytesIO(_compiled(entries)))


def po_entries(text: str) -> list[dict[str, str]]:
    """Return the entries of a .po file as fields by name; the first is its header.

    Raises
    ------
    ValueError
        If a line does not belong in such a file; names the line.

    Examples
    --------
    >>> po_entries('msgid "Stop"\\nmsgstr ""\\n"An"\\n"halten"\\n')
    [{'msgid': 'Stop', 'msgstr': 'Anhalten'}]
    """
    entries: list[dict[str, str]] = []
    name = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        field = next((one for one in _FIELDS if line.startswith(f"{one} ")), "")
        quoted = line.removeprefix(f"{field} ") if field else line
        if not (quoted.startswith('"') and quoted.endswith('"')) or not (field or name):
            raise ValueError(f"line {number}: neither a field nor a quoted text: {line!r}")
        if field == "msgid":
            entries.append({})
        name = field or name
        entries[-1][name] = entries[-1].get(name, "") + ast.literal_eval(quoted)
    return entries


def _compiled(entries: list[dict[str, str]]) -> bytes:
    """Return a .mo file, the form that the standard library reads: two tables, then the texts."""
    pairs = sorted(_pair(entry) for entry in entries)
    at = 28 + 16 * len(pairs)
    tables: tuple[list[int], list[int]] = ([], [])
    texts = b""
    for side, table in enumerate(tables):
        for pair in pairs:
            table += [len(pair[side]), at + len(texts)]
            texts += pair[side] + b"\0"
    head = struct.pack("<7I", _MAGIC, 0, len(pairs), 28, 28 + 8 * len(pairs), 0, 0)
    return head + struct.pack(f"<{4 * len(pairs)}I", *tables[0], *tables[1]) + texts


def _pair(entry: dict[str, str]) -> tuple[bytes, bytes]:
    original, translated = entry["msgid"], entry.get("msgstr", "")
    if "msgid_plural" in entry:
        original += f"\0{entry['msgid_plural']}"
        translated = f"{entry['msgstr[0]']}\0{entry['msgstr[1]']}"
    return original.encode(), translated.encode()
