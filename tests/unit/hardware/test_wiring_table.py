"""The wiring table, drawings and resistor table match the firmware and the code."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.sensor.reference_resistor import fit_reference
from palpate.signal.circuit import Divider

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "hardware" / "README.md").read_text()
BOARD = (ROOT / "firmware" / "board" / "mega2560.h").read_text()


def wired(pins: str) -> str:
    """Return the entry of the wiring table for some pins."""
    for line in README.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and cells[0] == pins:
            return f"{cells[1]}; {cells[2]}"
    pytest.fail(f"no row for pins {pins} in hardware/README.md")


@pytest.mark.parametrize(
    ("firmware", "pins", "entry"),
    [
        (r"A0 \(divider\)", "A0", "divider"),
        (r"A1\n// \(pressure read-back\)", "A1", "pressure read back"),
        (r"L, 0 +// 49-46: row multiplexer select, low bit", "49, 48, 47, 46", "S0, S1, S2, S3"),
        (r"L, 4 +// 45-42: column multiplexer", "45, 44, 43, 42", "column select, low bit"),
        (r"E, 3 +// 5: pressure output", "5", "pressure, 0 to 5 V is 0 to 50 kPa"),
        (r"H, 5 +// 8: safe line", "8", "safe line"),
        (r"B, 6 +// 12: servo signal", "12", "signal of a hobby servo"),
        (r"A, 0 +// 22-29: row lines 0-7 direct", "22 to 29", "rows R0 to R7"),
        (r"C, 0 +// 37-30: row lines 8-15 direct", "37 to 30", "rows R8 to R15"),
        (r"G, 0 +// 41: load cell 0 clock", "41, 14", "SCK and DT of load-cell amplifier 0"),
        (r"J, 1 +// 14: load cell 0 data", "41, 14", "SCK and DT of load-cell amplifier 0"),
        (r"G, 2 +// 39: load cell 1 clock", "39, 38", "SCK and DT of load-cell amplifier 1"),
        (r"D, 7 +// 38: load cell 1 data", "39, 38", "SCK and DT of load-cell amplifier 1"),
    ],
)
def test_wiring_table_matches_firmware_pins(firmware: str, pins: str, entry: str) -> None:
    assert re.search(firmware, BOARD), f"the board file has changed: {firmware}"
    assert entry in wired(pins)


UNO = (ROOT / "firmware" / "board" / "atmega328p.h").read_text()


@pytest.mark.parametrize(
    ("firmware", "row"),
    [
        (r"D, 2 +// 2-3: row multiplexer select", "| 2, 3 | S0, S1 of the row multiplexer |"),
        (r"D, 4 +// 4-5: column multiplexer", "| 4, 5 | S0, S1 of the column multiplexer |"),
        (r"C, 2 +// A2-A5: row lines 0-3", "| A2 to A5 | rows R0 to R3, in place"),
        (r"D, 6 +// 6: load cell 0 clock", "| 6, 7 | SCK and DT of load-cell amplifier 0 |"),
        (r"D, 7 +// 7: load cell 0 data", "| 6, 7 | SCK and DT of load-cell amplifier 0 |"),
        (r"B, 3 +// 11: load cell 1 clock", "| 11, 12 | SCK and DT of load-cell amplifier 1 |"),
        (r"B, 4 +// 12: load cell 1 data", "| 11, 12 | SCK and DT of load-cell amplifier 1 |"),
        (r"B, 0 +// 8: safe line", "| 8 | safe line, with 10 kΩ to GND |"),
        (r"B, 2 +// 10: servo signal", "| 10 | through 330 Ω the signal of a hobby servo |"),
    ],
)
def test_readme_uno_pins_match_firmware(firmware: str, row: str) -> None:
    assert re.search(firmware, UNO)
    assert row in README


def test_wiring_drawing_has_the_select_pins_in_order() -> None:
    drawing = (ROOT / "hardware" / "wiring.svg").read_text()
    labels = re.findall(r">(\d\d|A0)</text>", drawing)
    assert labels == ["49", "48", "47", "46", "45", "44", "43", "42", "A0"]


def test_wiring_drawing_has_the_resistor_in_front_of_a0() -> None:
    assert "| A0 | through 1 kΩ to SIG of the column multiplexer" in README
    assert ">1 kΩ</text>" in (ROOT / "hardware" / "wiring.svg").read_text()


def plan_of_board(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.syspath_prepend(str(ROOT / "hardware"))
    return runpy.run_path(str(ROOT / "hardware" / "perfboard.py"))


def test_perfboard_plan_matches_wiring_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board = plan_of_board(monkeypatch)
    selects = {}
    for mux, pins in (("row", "49, 48, 47, 46"), ("col", "45, 44, 43, 42")):
        assert "S0, S1, S2, S3" in wired(pins)
        for k, pin in enumerate(pins.split(", ")):
            selects[f"Mega {pin}"] = f"{mux} S{k}"
    supply = {"Mega 5V", "row SIG", "row VCC", "col VCC", "100 nF, row a", "100 nF, col a"}
    ground = {"Mega GND", "out GND", "row EN", "row GND", "col EN", "col GND", "4.7 kΩ b"}
    ground |= {"100 nF, row b", "100 nF, col b", "10 kΩ a"}
    expected = {
        *(frozenset(pair) for pair in selects.items()),
        frozenset(supply),
        frozenset(ground),
        frozenset({"Mega A0", "1 kΩ a"}),
        frozenset({"1 kΩ b", "col SIG", "4.7 kΩ a"}),
        frozenset({"Mega 8", "10 kΩ b", "out SAFE"}),
        frozenset({"Mega 12", "330 Ω a"}),
        frozenset({"330 Ω b", "out SERVO"}),
    }
    assert set(board["nets"]()) == expected


@pytest.mark.parametrize("name", ["wiring", "layouts", "perfboard"])
def test_hardware_drawings_match_their_scripts(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = {"perfboard": plan_of_board(monkeypatch)}.get(
        name, runpy.run_path(str(ROOT / "hardware" / "draw.py"))
    )
    drawn = script[name]()
    drawn.save(tmp_path / "new.svg")
    assert (tmp_path / "new.svg").read_text() == (ROOT / "hardware" / f"{name}.svg").read_text()


@pytest.mark.parametrize("layout", [RIGID_LAYOUT, SOFT_LAYOUT], ids=lambda layout: layout.name)
def test_readme_layout_table_matches_layouts(layout: ArrayLayout) -> None:
    row = next(line for line in README.splitlines() if line.startswith(f"| `{layout.name}`"))
    assert f"{layout.rows} rows x {layout.cols} columns" in row
    assert f"{layout.pixels} on two" in row


def ohm(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"kΩ": 1e3, "Ω": 1.0}[unit]


def test_readme_resistor_table_matches_doctor() -> None:
    rows = re.findall(
        r"^\| ([\d.]+ k?Ω) to ([\d.]+ k?Ω) \| ([\d.]+) % \| ([\d.]+ k?Ω) \| ([\d.]+) % \|$",
        README,
        re.MULTILINE,
    )
    assert len(rows) == 4
    for high, low, step, best, finer in rows:
        fit = fit_reference(low_ohm=ohm(low), high_ohm=ohm(high), divider=Divider())
        assert fit.recommended_ohm == ohm(best)
        assert f"{fit.step_percent:.1f}" == step
        assert f"{fit.recommended_step_percent:.1f}" == finer
