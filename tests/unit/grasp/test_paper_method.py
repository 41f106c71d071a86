"""The paper's method on the twin: contact by mean, size, settled value, force."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.commands import Command
from tests.fixtures import skip

from palpate.errors import InputError
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.plan import Plan
from palpate.gripper.pneumatic import SOFT_LIMITS
from palpate.twin.firmware import BUILD

pytestmark = pytest.mark.slow
#: The frames of the paper.
RATE = ("--rate-hz", 15)


def grasped(palpate: Command, *options: object) -> dict[str, Any]:
    message = ("grasp", "--method", "paper", "--seed", "3", *options, "--json")
    document: dict[str, Any] = palpate(*message).document
    return document


def test_paper_method_on_rigid_fingers_measures_size_and_force(
    tmp_path: Path, palpate: Command
) -> None:
    """The extra closing raises the force; the recording repeats the grasp."""
    found = grasped(palpate, "--object", "strawberry", *RATE)
    assert found["outcome"] == "held"
    assert found["decision_time_s"] == pytest.approx(2.5, abs=0.2)
    size, truth = found["size_mm"], found["truth"]
    assert size["value"] == pytest.approx(truth["size_mm"], abs=2.0)
    assert size["value"] - size["low"] == pytest.approx(1.0, abs=0.06)
    assert found["force_n"] is not None
    assert found["stiffness_n_per_mm"] is None
    file = tmp_path / "run.mcap"
    more = ("--object", "strawberry", "--extra-mm", "0.5", "--cutoff", "1.5", "--record", file)
    pushed = grasped(palpate, *more, *RATE)
    assert pushed["truth"]["force_n"] > 1.2 * truth["force_n"]
    assert pushed["peak_force_n"] >= pushed["force_n"]["value"]
    again = palpate("replay", file, "--json").document
    for name in ("outcome", "settled_percent", "size_mm", "force_n", "moments", "frames"):
        assert again[name] == pushed[name]
    # Steps of 1 mm end within a frame, so no frame shows movement.
    read = palpate("replay", file, "--method", "paper", "--cutoff", "1.5", "--json").document
    assert read["size_mm"]["value"] == pytest.approx(pushed["size_mm"]["value"], abs=0.1)
    settled = pushed["settled_percent"]["value"]
    assert read["settled_percent"]["value"] == pytest.approx(settled, rel=0.1)


@pytest.mark.system
def test_paper_method_with_the_firmware_on_a_simulated_board_holds_the_object(
    palpate: Command,
) -> None:
    if not (BUILD / "libpalpate_board.so").exists():
        skip("no firmware simulator: `make -C firmware/sim` builds it")
    found = grasped(palpate, "--rig", "sim-firmware", "--object", "strawberry")
    assert found["outcome"] == "held"
    assert found["size_mm"]["value"] == pytest.approx(found["truth"]["size_mm"], abs=2.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step-mm", "2"], "--step-mm: valid only with --method paper"),
        (["--method", "paper", "--step-mm", "0"], "--step-mm must be above 0"),
        (["--method", "paper", "--target-force-n", "3"], "neither a target force nor"),
    ],
)
def test_paper_setting_out_of_range_is_refused(
    options: list[str], message: str, palpate: Command
) -> None:
    assert message in palpate.refused("grasp", *options)


def test_paper_method_refuses_steps_in_mm_of_pressure_driven_fingers(plan: Plan) -> None:
    soft = replace(plan, gripper=SOFT_LIMITS)
    with pytest.raises(InputError, match="pressure-driven"):
        use_paper_method(soft, Paper(extra_mm=1.0), calibration=None)  # type: ignore[arg-type]


def test_add_line_law_stores_law_in_calibration(tmp_path: Path, palpate: Command) -> None:
    out = tmp_path / "pad.json"
    command = ("calibrate", "force", "--rig", "sim-rigid", "--law", "line", "--out", out, "--json")
    found = palpate(*command).document
    assert found["force_law"]["law"] == "line"
    assert found["force_law"]["coefficients"][0] < 0
    assert found["expected_error_of"] == "settled force by the line"
