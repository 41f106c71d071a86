"""Wiring, drawings and resistor table of the hardware page match the firmware and the code."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from palpate.sensor.reference_resistor import fit_reference
from palpate.signal.circuit import Divider

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "hardware" / "README.md").read_text()


@pytest.mark.parametrize(
    ("board", "pin", "row"),
    [
        ("mega2560", r"L, 0 +// 49-46: row multiplexer select, low bit", "| 49, 48, 47, 46 | "),
        ("mega2560", r"L, 4 +// 45-42: column multiplexer", "| 45, 44, 43, 42 | "),
        ("mega2560", r"E, 3 +// 5: pressure output", "| 5 | 100 kΩ to GND; through 10 kΩ"),
        ("mega2560", r"H, 5 +// 8: safe line", "| 8 | safe line"),
        ("mega2560", r"B, 6 +// 12: servo signal", "| 12 | through 330 Ω the signal"),
        ("mega2560", r"A, 0 +// 22-29: row lines 0-7 direct", "| 22 to 29 | rows R0 to R7"),
        ("mega2560", r"C, 0 +// 37-30: row lines 8-15 direct", "| 37 to 30 | rows R8 to R15"),
        ("mega2560", r"J, 1 +// 14: load cell 0 data", "| 41, 14 | SCK and DT of load-cell"),
        ("mega2560", r"D, 7 +// 38: load cell 1 data", "| 39, 38 | SCK and DT of load-cell"),
        ("atmega328p", r"D, 2 +// 2-3: row multiplexer select", "| 2, 3 | S0, S1 of the row"),
        ("atmega328p", r"D, 4 +// 4-5: column multiplexer", "| 4, 5 | S0, S1 of the column"),
        ("atmega328p", r"C, 2 +// A2-A5: row lines 0-3", "| A2 to A5 | rows R0 to R3"),
        ("atmega328p", r"D, 7 +// 7: load cell 0 data", "| 6, 7 | SCK and DT of load-cell"),
        ("atmega328p", r"B, 4 +// 12: load cell 1 data", "| 11, 12 | SCK and DT of load-cell"),
        ("atmega328p", r"B, 0 +// 8: safe line", "| 8 | safe line, with 10 kΩ to GND"),
        ("atmega328p", r"B, 2 +// 10: servo signal", "| 10 | through 330 Ω the signal"),
    ],
)
def test_wiring_tables_match_the_firmware_pins(board: str, pin: str, row: str) -> None:
    assert re.search(pin, (ROOT / "firmware" / "board" / f"{board}.h").read_text())
    assert row in README


def plan_of_board(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.syspath_prepend(str(ROOT / "hardware"))
    return runpy.run_path(str(ROOT / "hardware" / "perfboard.py"))


def test_perfboard_plan_matches_wiring_table(monkeypatch: pytest.MonkeyPatch) -> None:
    board = plan_of_board(monkeypatch)
    supply = {"Mega 5V", "row SIG", "row VCC", "col VCC", "100 nF, row a", "100 nF, col a"}
    ground = {"Mega GND", "out GND", "row EN", "row GND", "col EN", "col GND", "4.7 kΩ b"}
    ground |= {"100 nF, row b", "100 nF, col b", "10 kΩ a"}
    expected = {
        *(frozenset({f"Mega {49 - k}", f"row S{k}"}) for k in range(4)),
        *(frozenset({f"Mega {45 - k}", f"col S{k}"}) for k in range(4)),
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
