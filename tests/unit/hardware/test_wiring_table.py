"""Wiring, drawings and resistor table of the hardware page match the firmware and the code."""

from __future__ import annotations

import re
import runpy
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from palpate.sensor.reference_resistor import fit_reference
from palpate.signal.circuit import Divider

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "hardware" / "README.md").read_text()


#: Number printed on the Arduino of each port and bit that a board's firmware may use. Sources:
#: Arduino's `variants/mega/pins_arduino.h` and `variants/standard/pins_arduino.h`.
NUMBERS = {
    "mega2560": {
        **{("A", bit): 22 + bit for bit in range(8)},
        **{("C", bit): 37 - bit for bit in range(8)},
        **{("L", bit): 49 - bit for bit in range(8)},
        **{("G", bit): 41 - bit for bit in range(3)},
        ("B", 6): 12,
        ("D", 7): 38,
        ("E", 3): 5,
        ("H", 5): 8,
        ("J", 1): 14,
    },
    "atmega328p": {
        **{("D", bit): bit for bit in range(8)},
        **{("B", bit): 8 + bit for bit in range(6)},
        **{("C", bit): 14 + bit for bit in range(6)},
    },
}


def firmware_pins(board: str) -> dict[str, tuple[str, int]]:
    """Return port and bit of each name in a board's table of pins."""
    header = (ROOT / "firmware" / "board" / f"{board}.h").read_text(encoding="utf-8")
    found = re.findall(r"^#define (\w+) ([A-L]), (\d)\b", header, re.MULTILINE)
    return {name: (port, int(bit)) for name, port, bit in found}


def pin_number(board: str, name: str, offset: int = 0) -> str:
    """Return the number printed on the Arduino of a pin, or of one `offset` bits further."""
    port, bit = firmware_pins(board)[name]
    number = NUMBERS[board][port, bit + offset]
    return f"A{number - 14}" if board == "atmega328p" and number >= 14 else str(number)


def plan_of_board(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.syspath_prepend(str(ROOT / "hardware"))
    return runpy.run_path(str(ROOT / "hardware" / "perfboard.py"))


def test_perfboard_plan_joins_the_pins_of_the_firmware(monkeypatch: pytest.MonkeyPatch) -> None:
    board, pin = plan_of_board(monkeypatch), partial(pin_number, "mega2560")
    supply = {"Mega 5V", "row SIG", "row VCC", "col VCC", "100 nF, row a", "100 nF, col a"}
    ground = {"Mega GND", "out GND", "row EN", "row GND", "col EN", "col GND", "4.7 kΩ b"}
    ground |= {"100 nF, row b", "100 nF, col b", "10 kΩ a"}
    expected = {
        *(frozenset({f"Mega {pin('ROW_SELECT', k)}", f"row S{k}"}) for k in range(4)),
        *(frozenset({f"Mega {pin('COLUMN_SELECT', k)}", f"col S{k}"}) for k in range(4)),
        frozenset(supply),
        frozenset(ground),
        frozenset({"Mega A0", "1 kΩ a"}),
        frozenset({"1 kΩ b", "col SIG", "4.7 kΩ a"}),
        frozenset({f"Mega {pin('SAFE_LINE')}", "10 kΩ b", "out SAFE"}),
        frozenset({f"Mega {pin('SERVO')}", "330 Ω a"}),
        frozenset({"330 Ω b", "out SERVO"}),
    }
    assert set(board["nets"]()) == expected


#: Beginning of a row in a wiring table -> name and number of the firmware's pins in it.
WIRED = {
    "mega2560": {
        "S0, S1, S2, S3 of the row": ("ROW_SELECT", 4),
        "S0, S1, S2, S3 of the column": ("COLUMN_SELECT", 4),
        "safe line": ("SAFE_LINE", 1),
        "through 330 Ω the signal": ("SERVO", 1),
        "100 kΩ to GND; through 10 kΩ": ("PRESSURE", 1),
    },
    "atmega328p": {
        "S0, S1 of the row": ("ROW_SELECT", 2),
        "S0, S1 of the column": ("COLUMN_SELECT", 2),
        "safe line": ("SAFE_LINE", 1),
        "through 330 Ω the signal": ("SERVO", 1),
    },
}


@pytest.mark.parametrize(("board", "title"), [("mega2560", "Mega"), ("atmega328p", "Uno or Nano")])
def test_wiring_table_states_the_pins_of_the_firmware(board: str, title: str) -> None:
    table = README.split(f"| {title} pin | connection |")[1].split("\n\n")[0]
    rows = {
        cells[1]: cells[0]
        for line in table.splitlines()[2:]
        if len(cells := [cell.strip() for cell in line.strip("| ").split("|")]) >= 2
    }
    pin = partial(pin_number, board)
    for text, (name, number) in WIRED[board].items():
        (stated,) = (pins for row, pins in rows.items() if row.startswith(text))
        assert stated == ", ".join(pin(name, k) for k in range(number)), text
    for cell in (0, 1):
        (stated,) = (p for row, p in rows.items() if row.endswith(f"load-cell amplifier {cell}"))
        assert stated == f"{pin(f'LOAD_CLOCK_{cell}')}, {pin(f'LOAD_DATA_{cell}')}"
    direct = {
        row[5 : row.index(",")]: pins for row, pins in rows.items() if row.startswith("rows R")
    }
    names = {"R0 to R7": "ROWS_LOW", "R0 to R3": "ROWS", "R8 to R15": "ROWS_HIGH"}
    for lines, stated in direct.items():
        first, last = (int(line[1:]) for line in lines.split(" to "))
        assert stated == f"{pin(names[lines])} to {pin(names[lines], last - first)}"
    assert len(direct) == (2 if board == "mega2560" else 1)


@pytest.mark.parametrize("name", ["wiring", "one_pad", "layouts", "perfboard"])
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
