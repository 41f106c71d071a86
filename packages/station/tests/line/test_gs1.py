"""GS1 labels: item identifiers and URIs."""

from __future__ import annotations

import pytest

from palpate.errors import InputError
from palpate_station.line.gs1 import item_uri, read_label

ITEM = "(01)04012345000016(21)A17"


@pytest.mark.parametrize(
    ("scanned", "item"),
    [
        ("]C1010401234500001621A17", ITEM),
        # Weight and batch precede the serial number; FNC1 terminates the variable-length batch.
        ("]d20104012345000016310300018010B7\x1d21A17", ITEM),
        ("https://example.com/01/04012345000016/21/A17", ITEM),
        (ITEM, ITEM),
        ("]C100106141412345678908", "(00)106141412345678908"),
        ("https://example.com/A17", "https://example.com/A17"),
        ("(left tree) 4", "(left tree) 4"),
        # A scanner without prefix, printed spaces, and a link in capitals.
        ("010401234500001621A17", ITEM),
        ("(01) 04012345000016 (21) A17", ITEM),
        ("HTTPS://ID.GS1.ORG/01/04012345000016/21/A17", ITEM),
        ("00106141412345678908", "(00)106141412345678908"),
        ("106141412345678908", "106141412345678908"),
        # The number on a fruit sticker, and own numbers, have no check digit.
        ("4011", "4011"),
        ("20261130-0017", "20261130-0017"),
    ],
)
def test_read_label_returns_the_item_identifier(scanned: str, item: str) -> None:
    assert read_label(scanned) == item


@pytest.mark.parametrize(
    ("scanned", "why"),
    [
        ("]C1010401234500001721A17", "check digit"),
        ("]C1010401234500001610B7", "not an item"),
        ("96385075", "wrong check digit 5, must be 4"),
        # A product's number, of EAN-13 and EAN-8, is on every item.
        ("]E04012345000016", "not an item"),
        ("4006381333931", "not an item.* such as N4006381333931$"),
        ("96385074", "not an item"),
        ("]E04012345000017", "check digit"),
        ("106141412345678909", "check digit"),
        ("010401234500001721A17", "check digit"),
        ("(01) 04012345000017 (21) A17", "check digit"),
        ("HTTPS://ID.GS1.ORG/01/04012345000017/21/A17", "check digit"),
        ("(414)9501101530008", "check digit"),
        ("]C18018123456789012345676", "check digit"),
        ("]C1AB", "Application Identifier"),
        ("(01)0401234500001(21)A17", "not a complete GS1 label; scan it again"),
        ("https://id.gs1.org/01/4012345/21/A17", "label"),
    ],
)
def test_read_label_with_an_invalid_label_raises_a_one_line_error(scanned: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as refused:
        read_label(scanned)
    assert "\n" not in str(refused.value)


def test_item_uri_percent_encodes_the_serial_number() -> None:
    assert item_uri("(01)04012345000016(21)A/(1)") == (
        "https://id.gs1.org/01/04012345000016/21/A%2F%281%29"
    )
