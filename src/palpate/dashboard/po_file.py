"""Reader of gettext .po files, so that no compiled copy of one can be out of date."""

from __future__ import annotations

import ast

_FIELDS = ("msgid_plural", "msgid", "msgstr[0]", "msgstr[1]", "msgstr")


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
