"""The Modbus register map: documentation, addresses and encoded texts."""

from __future__ import annotations

import re
import runpy
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_station.line import modbus
from palpate_station.line.machine import LineState, line_state
from palpate_station.line.modbus import TEXT_REGISTERS, decode_text, encode_text
from palpate_station.line.results import MEASUREMENTS, OUTCOME_NUMBERS

PAGE = Path(__file__).resolve().parents[4] / "docs" / "packhouse.md"


def test_packhouse_page_lists_every_register_once_with_its_address() -> None:
    rows = re.findall(r"^\| (\d+)(?:-(\d+))? \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.M)
    spans = [(int(first), int(last or first)) for first, last, _ in rows]
    meanings = {int(first): meaning for first, _, meaning in rows}
    for before, after in pairwise(spans):
        assert before[1] < after[0]
    text = modbus.TEXT_REGISTERS - 1
    measured = [modbus.VALUES + 6 * place for place in range(len(MEASUREMENTS))]
    held = [modbus.HELD_VALUES + 6 * place for place in range(len(MEASUREMENTS))]
    assert spans == [
        (modbus.STATE, modbus.STATE),
        (modbus.FLAGS, modbus.FLAGS),
        (modbus.STOPS, modbus.STOPS + 1),
        (modbus.RESULTS, modbus.RESULTS + 1),
        (modbus.OUTCOME, modbus.OUTCOME),
        (modbus.STORAGE, modbus.STORAGE),
        *((at, at + 5) for at in measured),
        (modbus.AGAIN, modbus.AGAIN),
        (modbus.HELD_AGAIN, modbus.HELD_AGAIN),
        *((at, at + 5) for at in (*held, modbus.REFERENCE, modbus.HELD_REFERENCE)),
        *(
            (at, at + text)
            for at in (modbus.ITEM, modbus.BIN, modbus.REFUSAL, modbus.HELD_BIN, modbus.DRIVER)
        ),
        (modbus.COMMAND, modbus.COMMAND),
        (modbus.TARGET, modbus.TARGET),
        (modbus.KNOWN_STOPS, modbus.KNOWN_STOPS + 1),
        (modbus.NEW_ITEM, modbus.NEW_ITEM + text),
        (modbus.INTERRUPTED_ITEM, modbus.INTERRUPTED_ITEM + text),
        (modbus.NEW_BATCH, modbus.REGISTER_COUNT - 1),
    ]
    for at, name in zip([*measured, *held], 2 * MEASUREMENTS, strict=True):
        assert f"`{name}`" in meanings[at]
    for name, number in OUTCOME_NUMBERS.items():
        assert f"{number} {name}" in meanings[modbus.OUTCOME]


def test_gateway_example_numbers_outcomes_as_the_protocols_do() -> None:
    outcomes = runpy.run_path(str(PAGE.parents[1] / "examples" / "plc_gateway.py"))["OUTCOMES"]
    assert {name: number for number, name in enumerate(outcomes) if number} == OUTCOME_NUMBERS


@given(st.text(st.characters(min_codepoint=32, exclude_categories=["Cs"]), max_size=100))
def test_encode_text_roundtrip_preserves_every_complete_character(text: str) -> None:
    found = decode_text(encode_text(text))
    assert text.startswith(found)
    following = text[len(found) : len(found) + 1]
    assert not following or len((found + following).encode()) > 2 * TEXT_REGISTERS


@pytest.mark.parametrize(
    ("changed", "state"),
    [
        ({}, LineState.IDLE),
        ({"fresh": False}, LineState.STOPPED),
        ({"trouble": "the sensor is lost"}, LineState.ABORTED),
        ({"activity": "gone"}, LineState.ABORTED),
        ({"activity": "opening the rig"}, LineState.STOPPED),
        ({"activity": "grasping"}, LineState.EXECUTE),
        ({"activity": "grasping", "phase": "hold", "answered": True}, LineState.HOLDING),
    ],
)
def test_line_state_matches_the_state_document(
    changed: dict[str, object], state: LineState
) -> None:
    document = {
        "activity": "watching",
        "phase": None,
        "answered": False,
        "fresh": True,
        "hand_open": True,
        "trouble": "",
    }
    assert line_state(document | changed) is state
