"""Read GS1 labels, and build the URI of an item."""

from __future__ import annotations

import re
from urllib.parse import quote

from biip import ParseError
from biip.gs1_digital_link_uris import GS1DigitalLinkURI
from biip.gs1_messages import GS1Message

from palpate.errors import InputError

#: Matches a scanned GS1 symbol (by its prefix), a Digital Link with a GTIN or SSCC, or the
#: human-readable text of a label.
_LABEL = re.compile(r"\](C1|d2|Q3|e0|J1)|https?://\S+/0[01]/\d|\(0[01]\)\d")


def read_label(text: str) -> str:
    """Return the item identifier of a scanned text, in GS1's human-readable form.

    Text that is not a GS1 label is returned unchanged. Raises `InputError` if the label is invalid
    or identifies a product without a serial number.

    >>> read_label("]d2010401234500001621A17")
    '(01)04012345000016(21)A17'
    >>> read_label("https://id.gs1.org/01/04012345000016/21/A17?17=261231")
    '(01)04012345000016(21)A17'
    >>> read_label("A17")
    'A17'
    """
    if _LABEL.match(text) is None:
        return text
    found: GS1DigitalLinkURI | GS1Message
    try:
        if text.startswith("http"):
            found = GS1DigitalLinkURI.parse(text)
        elif text.startswith("("):
            found = GS1Message.parse_hri(text)
        else:
            found = GS1Message.parse(text[3:])
    except ParseError as error:
        raise InputError(
            f"label {text!r} is not a complete GS1 label; scan it again ({error})"
        ) from error
    elements = {element.ai.ai: element for element in found.element_strings}
    for element in elements.values():
        if (fault := element.gtin_error or element.sscc_error) is not None:
            raise InputError(f"label {text!r}: {fault}")
    keys = ("00",) if "00" in elements else ("01", "21")
    if not elements.keys() >= set(keys):
        raise InputError(
            f"label {text!r}: it identifies a product, not an item; a serial number (21) is missing"
        )
    return "".join(f"({key}){elements[key].value}" for key in keys)


def item_uri(item_id: str) -> str:
    """Return an item's URI: a GS1 Digital Link for a GS1 identifier, otherwise a URN.

    >>> item_uri("(01)04012345000016(21)A17"), item_uri("tray 4")
    ('https://id.gs1.org/01/04012345000016/21/A17', 'urn:palpate:item:tray%204')
    """
    found = re.fullmatch(r"\((00|01)\)(\d+)(?:\(21\)(.+))?", item_id)
    if found is None:
        return f"urn:palpate:item:{quote(item_id, safe='')}"
    key, number, serial = found.groups()
    return f"https://id.gs1.org/{key}/{number}" + (
        f"/21/{quote(serial, safe='')}" if serial else ""
    )
