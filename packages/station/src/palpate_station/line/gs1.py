"""Read GS1 labels, and build the URI of an item."""

from __future__ import annotations

import re
from urllib.parse import quote

from biip import ParseError
from biip.checksums import gs1_standard_check_digit
from biip.gs1_digital_link_uris import GS1DigitalLinkURI
from biip.gs1_element_strings import GS1ElementString
from biip.gs1_messages import GS1Message

from palpate.errors import InputError

#: Matches a text that must be a GS1 label: a scanned GS1 symbol (by its prefix), a Digital Link
#: with a GTIN or SSCC, or the human-readable text of a label.
_LABEL = re.compile(r"\](C1|d2|Q3|e0|J1)|\x1d|(?i:https?)://\S+/0[01]/[0-9]|\(0[01]\)[0-9]")
#: Matches a text that is probably a label: element strings of a scanner without prefix.
_BARE_LABEL = re.compile(r"01[0-9]{14}(10|11|13|15|17|21|310)|00[0-9]{18}$|\([0-9]{2,4}\)[0-9]")
#: Matches a number with a check digit, with or without the prefix of EAN, UPC or ITF-14: GTIN-8,
#: 12, 13 and 14, and SSCC.
_NUMBER = re.compile(r"(?:\][EI][0-9])?([0-9]{8}|[0-9]{12,14}|[0-9]{18})")
#: Digits of an SSCC, which identifies an item; shorter numbers with a check digit are products.
_SSCC_DIGITS = 18
#: Other keys that end with a check digit, or begin with digits that do: identifier and length.
_CHECKED_KEYS = {"253": 13, "255": 13, "402": 17, "8003": 14, "8006": 14, "8017": 18, "8018": 18}


class LabelError(InputError):
    """A label that never names an item; `step` is the key of what an operator does instead."""

    def __init__(self, text: str, *, step: str) -> None:
        super().__init__(text)
        self.step = step


def read_label(text: str) -> str:
    """Return the item identifier of a scanned text, in GS1's human-readable form.

    Text that is not a GS1 label is returned unchanged. Raises `InputError` if the label is invalid,
    has a wrong check digit, or identifies a product without a serial number.

    >>> read_label("]d2010401234500001621A17")
    '(01)04012345000016(21)A17'
    >>> read_label("https://id.gs1.org/01/04012345000016/21/A17?17=261231")
    '(01)04012345000016(21)A17'
    >>> read_label("A17")
    'A17'
    >>> read_label("]E096385075")
    Traceback (most recent call last):
    palpate.errors.InputError: label ']E096385075': wrong check digit 5, must be 4; scan it again
    """
    number = _NUMBER.fullmatch(text)
    if number is not None:
        is_bare = number[1] == text
        own_number = f"N{text}" if is_bare else ""
        _check_digit(number[1], label=text, own_number=own_number)
        if len(number[1]) < _SSCC_DIGITS:
            raise _product_error(text, own_number=own_number)
        return number[1]
    if text.startswith("("):
        # Labels are often typed with the printed spaces.
        text = re.sub(r"\s*(\([0-9]{2,4}\))\s*", r"\1", text)
    is_label = _LABEL.match(text) is not None
    if not is_label and _BARE_LABEL.match(text) is None:
        return text
    try:
        elements = _parse_elements(text)
    except ParseError as error:
        if not is_label:
            return text
        raise InputError(
            f"label {text!r} is not a complete GS1 label; scan it again ({error})"
        ) from error
    for element in elements.values():
        if element.gtin_error or element.sscc_error or element.gln_error:
            _check_digit(element.value, label=text)
        if (length := _CHECKED_KEYS.get(element.ai.ai)) is not None:
            _check_digit(element.value[:length], label=text)
        if (fault := element.gtin_error or element.sscc_error or element.gln_error) is not None:
            raise InputError(f"label {text!r}: {fault}")
    keys = ("00",) if "00" in elements else ("01", "21")
    if elements.keys() >= set(keys):
        return "".join(f"({key}){elements[key].value}" for key in keys)
    if not is_label and "01" not in elements:
        return text
    raise _product_error(text)


def _product_error(text: str, *, own_number: str = "") -> LabelError:
    """Return why the label of a product is refused.

    `own_number`: form in which a number of the user's own is accepted; empty if none.
    """
    fault = f"label {text!r}: it identifies a product, not an item; a serial number (21) is missing"
    return LabelError(fault + _describe_own(own_number), step="next.label_product")


def _describe_own(own_number: str) -> str:
    if not own_number:
        return ""
    digits = len(own_number) - 1
    return f". A number of your own with {digits} digits needs a letter, such as {own_number}"


def _parse_elements(text: str) -> dict[str, GS1ElementString]:
    """Return the elements of a label by their application identifiers."""
    found: GS1DigitalLinkURI | GS1Message
    if "://" in text:
        scheme, _, rest = text.partition("://")
        found = GS1DigitalLinkURI.parse(f"{scheme.lower()}://{rest}")
    elif text.startswith("("):
        found = GS1Message.parse_hri(text)
    else:
        found = GS1Message.parse(re.sub(r"^(\]..)?\x1d?", "", text))
    return {element.ai.ai: element for element in found.element_strings}


def _check_digit(number: str, *, label: str, own_number: str = "") -> None:
    """Raise `InputError` if the last digit is not the check digit of the others.

    `own_number`: form in which the number is accepted without a check digit; empty if none.
    """
    must = gs1_standard_check_digit(number[:-1])
    if int(number[-1]) != must:
        fault = f"label {label!r}: wrong check digit {number[-1]}, must be {must}; scan it again"
        raise InputError(fault + _describe_own(own_number))


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


def station_uri(station: str) -> str:
    """Return a station's URI: a GS1 Digital Link for a GLN, otherwise a URN.

    >>> station_uri("4012345000009"), station_uri("line 1")
    ('https://id.gs1.org/414/4012345000009', 'urn:palpate:station:line%201')
    """
    is_gln = re.fullmatch(r"\d{13}", station) is not None
    if is_gln and int(station[-1]) == gs1_standard_check_digit(station[:-1]):
        return f"https://id.gs1.org/414/{station}"
    return f"urn:palpate:station:{quote(station, safe='')}"
