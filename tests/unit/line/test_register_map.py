"""The register map: its page, its layout, and texts in it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.line.machine import LineState, line_state
from palpate.line.modbus import TEXT_REGISTERS, register_map, text_of, text_registers

PAGE = Path(__file__).resolve().parents[3] / "docs" / "packhouse.md"


def test_register_map_stands_on_its_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for register, meaning in register_map():
        assert f"| {register} | {meaning} |" in page


def test_register_map_has_no_register_twice() -> None:
    spans = [[int(end) for end in register.split("-")] for register, _ in register_map()]
    for before, after in pairwise(spans):
        assert before[-1] < after[0]


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=2 * TEXT_REGISTERS))
def test_text_registers_of_ascii_round_trips(text: str) -> None:
    assert text_of(text_registers(text)) == text


@pytest.mark.parametrize(
    ("changed", "state"),
    [
        ({}, LineState.IDLE),
        ({"fresh": False}, LineState.STOPPED),
        ({"hand_open": False}, LineState.STOPPED),
        ({"trouble": "the sensor is lost"}, LineState.ABORTED),
        ({"activity": "gone"}, LineState.ABORTED),
        ({"activity": "opening the rig"}, LineState.STOPPED),
        ({"activity": "grasping"}, LineState.EXECUTE),
        ({"activity": "grasping", "phase": "hold", "answered": True}, LineState.HOLDING),
    ],
)
def test_line_state_follows_the_state_document(
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
