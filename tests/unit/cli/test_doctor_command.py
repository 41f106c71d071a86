"""`palpate doctor` on simulated sensors and recordings."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.sensor.findings import CHECKS

ORDER = [(row, col) for row in range(4) for col in range(2)]


def test_doctor_of_a_healthy_rig_exits_with_0(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    captured = palpate("doctor", "--rig", rig_file(), "--json")
    document = captured.document
    assert document["healthy"] is True
    assert document["findings"] == []
    assert len(document["pixels"]) == 8
    assert document["frames_lost"] == 0
    assert document["rate_hz"] == pytest.approx(15.0)
    assert "do not touch the sensor" in captured.err


def test_doctor_of_a_loaded_rig_exits_with_1(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    """The gripper still closes during the check."""
    assert "(unrest)" in palpate("doctor", "--rig", rig_file(pressed=True), status=1).out


def test_doctor_of_a_simulated_recording_is_labelled_simulated(
    record_twin: Callable[..., Path], palpate: Command
) -> None:
    out = palpate("doctor", "--recording", record_twin()).out
    assert "SIMULATED" in out
    assert "Healthy" in out
    assert "R3 C1" in out


def test_doctor_recorded_presses_in_order_have_no_finding(
    record_twin: Callable[..., Path], palpate: Command
) -> None:
    document = palpate(
        "doctor", "--recording", record_twin(order=ORDER), "--press", "--json"
    ).document
    assert document["findings"] == []
    assert document["range_measured"] is True
    assert document["range_ohm"][0] < 0.11 * document["range_ohm"][1]


def test_doctor_recorded_presses_of_crossed_rows_are_found(
    record_twin: Callable[..., Path], palpate: Command
) -> None:
    crossed = [({1: 2, 2: 1}.get(row, row), col) for row, col in ORDER]
    document = palpate(
        "doctor", "--recording", record_twin(order=crossed), "--press", "--json", status=1
    ).document
    assert [(f["code"], f["where"]) for f in document["findings"]] == [
        ("swapped", "row R1"),
        ("swapped", "row R2"),
    ]
    assert document["findings"][0]["check"] == CHECKS["swapped"]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--rig", "a.toml", "--port", "b"], 2, "--port can't be combined with --rig"),
        (["--recording", "no.mcap"], 2, "can't be opened"),
        (["--port", "/dev/no-such-port"], 3, "no port /dev/no-such-port"),
    ],
)
def test_doctor_invalid_input_is_refused_in_one_line(
    arguments: list[str], status: int, message: str, palpate: Command
) -> None:
    err = palpate("doctor", *arguments, status=status).err.strip()
    assert message in err
    assert "\n" not in err


def test_troubleshooting_page_lists_each_finding_with_its_check() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "troubleshooting.md").read_text()
    findings = page.split("## When a grasp is cut short")[0]
    listed = dict(re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", findings, re.MULTILINE))
    assert listed == CHECKS
