"""GS1 labels: the item that a scanner reads, and its URI."""

from __future__ import annotations

import re
from urllib.parse import quote

from biip import ParseError
from biip.gs1_digital_link_uris import GS1DigitalLinkURI
from biip.gs1_messages import GS1Message

from palpate.errors import InputError

#: A scanner's prefix of a GS1 symbol, a Digital Link with a GTIN or an SSCC, or the printed text.
_LABEL = re.compile(r"\](C1|d2|Q3|e0|J1)|https?://\S+/0[01]/\d|\(0[01]\)\d")


def read_label(text: str) -> str:
    """Return the item that a scanned text names, as GS1 prints it below the symbol.

    A text that is no GS1 label is returned as it is. Raises `InputError` if the label is damaged or
    names a product and not one item.

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
        raise InputError(f"label {text!r}: {error}") from error
    elements = {element.ai.ai: element for element in found.element_strings}
    for element in elements.values():
        if (fault := element.gtin_error or element.sscc_error) is not None:
            raise InputError(f"label {text!r}: {fault}")
    keys = ("00",) if "00" in elements else ("01", "21")
    if not elements.keys() >= set(keys):
        raise InputError(
            f"label {text!r}: it names a product, not one item; it needs a serial number (21)"
        )
    return "".join(f"({key}){elements[key].value}" for key in keys)


def item_uri(item_id: str) -> str:
    """Return an item's URI: GS1 Digital Link for a labelled item, else a URN.

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
