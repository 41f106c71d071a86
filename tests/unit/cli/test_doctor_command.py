"""`palpate doctor` on simulated sensors and recordings."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.sensor.findings import CHECKS


def test_doctor_exits_with_0_on_a_healthy_rig_and_with_1_on_a_loaded_one(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    captured = palpate("doctor", "--rig", rig_file(), "--json")
    document = captured.document
    found = {name: document[name] for name in ("healthy", "findings", "frames_lost")}
    assert found == {"healthy": True, "findings": [], "frames_lost": 0}
    assert (len(document["pixels"]), document["rate_hz"]) == (8, pytest.approx(15.0))
    assert "do not touch the sensor" in captured.err
    # The gripper still closes during the check.
    assert "(unrest)" in palpate("doctor", "--rig", rig_file(pressed=True), status=1).out


def test_doctor_of_a_simulated_recording_is_labelled_simulated(
    record_twin: Callable[..., Path], palpate: Command
) -> None:
    out = palpate("doctor", "--recording", record_twin()).out
    assert "SIMULATED" in out
    assert "Healthy" in out
    assert "R3 C1" in out


def test_doctor_finds_crossed_rows_in_recorded_presses(
    record_twin: Callable[..., Path], palpate: Command
) -> None:
    order = [(row, col) for row in range(4) for col in range(2)]
    crossed = [({1: 2, 2: 1}.get(row, row), col) for row, col in order]
    press = ("--press", "--json")
    document = palpate("doctor", "--recording", record_twin(order=order), *press).document
    assert (document["findings"], document["range_measured"]) == ([], True)
    assert document["range_ohm"][0] < 0.11 * document["range_ohm"][1]
    document = palpate(
        "doctor", "--recording", record_twin(order=crossed), *press, status=1
    ).document
    assert [(f["code"], f["where"]) for f in document["findings"]] == [
        ("swapped", "row R1"),
        ("swapped", "row R2"),
    ]
    assert document["findings"][0]["check"] == CHECKS["swapped"]


def test_troubleshooting_page_lists_each_finding_with_its_check() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "troubleshooting.md").read_text()
    findings = page.split("## When a grasp is cut short")[0]
    listed = dict(re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", findings, re.MULTILINE))
    assert listed == CHECKS
