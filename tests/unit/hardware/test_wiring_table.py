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
