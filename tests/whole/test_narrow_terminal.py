"""Numbers on narrow terminals: every one is printed whole."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from io import StringIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.cli import grasp_card
from palpate.cli.output import print_card
from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate.measurement import Measurement, Status
from palpate.terminal_table import make_console, make_table, print_table

NARROW = range(12, 121)
NUMBER = re.compile(r"[-+]?\d[\d.,:]*")


def numbers(text: str) -> Counter[str]:
    """Count the numbers of a text; a frame is no part of them."""
    return Counter(NUMBER.findall(text.replace("│", " ")))


def measured(value: float, low: float, high: float) -> Measurement:
    return Measurement(value=value, low=low, high=high, level=0.9, unit="")


RESULT = GraspResult(
    outcome=Outcome.HELD,
    size_mm=measured(49.04, 48.7, 49.4),
    force_n=measured(2.8, 2.47, 13.17),
    firmness=measured(57, 48, 67),
    stiffness_n_per_mm=replace(measured(5.13, 2.71, 1310.36), status=Status.UNPROVEN),
    settled_percent=measured(-23.5, -27.0, -20.1),
    peak_force_n=12.8,
    decision_time_s=3.2,
    frames=137412,
    frames_lost=11,
    faults=("pixel R0 C1 reads 1023 after 12.345678901234 s; see run-2026-05-01T12:00:00.mcap",),
)


def card(width: int, monkeypatch: pytest.MonkeyPatch) -> str:
    file = StringIO()
    console = make_console(width=width, file=file)
    monkeypatch.setattr(grasp_card, "make_console", lambda: console)
    truth = {"size_mm": 49.1, "force_n": 2.85, "stiffness_n_per_mm": 4.64, "settled_percent": -25.1}
    document = GraspDocument(result=RESULT, is_simulated=True, truth=truth)
    grasp_card.print_card(document, title="ball-33lbs on sim-rigid", seed=123456)
    return file.getvalue()


def test_grasp_card_has_every_number_at_each_width(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = numbers(card(200, monkeypatch))
    assert len(whole) > 20
    for width in NARROW:
        narrow = numbers(card(width, monkeypatch))
        # Below the width of the table, each row repeats the names of its columns.
        assert narrow in (whole, whole + Counter({"90": 4})), width


@settings(max_examples=60)
@given(
    width=st.integers(12, 120),
    rows=st.lists(
        st.tuples(
            st.text("ab -", max_size=12),
            st.floats(-1e9, 1e9).map(lambda x: f"{x:.3f}"),
            st.integers(0, 10**12).map(str),
            st.floats(0, 1e4).map(lambda x: f"{x:.2f} … {2 * x:.2f}"),
        ),
        min_size=1,
        max_size=4,
    ),
    is_framed=st.booleans(),
)
def test_table_has_every_number_at_each_width(
    width: int, rows: list[tuple[str, ...]], is_framed: bool
) -> None:
    def shown(width: int) -> str:
        file = StringIO()
        console = make_console(width=width, file=file)
        columns = ("name", ">value", ">count", "90 % interval")
        if is_framed:
            title = "run 20260501123456"
            print_card(console, make_table(columns, rows), title=title, subtitle="seed 12345")
        else:
            print_table(columns, rows, console=console)
        return file.getvalue()

    heads = Counter({"90": len(rows) - 1})
    whole, narrow = numbers(shown(300)), numbers(shown(width))
    assert narrow in (whole, whole + heads)
