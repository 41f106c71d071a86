"""`palpate stiffness` as a user meets it."""

from __future__ import annotations

import json

import pytest

from palpate.cli import build_app, run


def stiffness(*arguments: str) -> int:
    return run(build_app(), ["stiffness", *arguments], name="palpate")


def test_the_answer_stands_below_its_grasps_and_says_simulated(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert stiffness("--up-to-n", "8", "--object", "springs-4", "--seed", "3") == 0

    lines = capsys.readouterr().out.splitlines()
    assert "springs-4" in lines[0]
    assert "SIMULATED" in lines[0]
    assert [line.split()[0] for line in lines[2:7]] == ["1.6", "3.2", "4.8", "6.4", "8.0"]
    assert lines[7].startswith("Stiffness ")
    assert "true (twin" in lines[8]


def test_json_is_one_document_whose_interval_holds_the_truth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert stiffness("--up-to-n", "8", "--object", "springs-4", "--seed", "3", "--json") == 0

    said = json.loads(capsys.readouterr().out)
    found = said["stiffness_n_per_mm"]
    assert said["simulated"] is True
    assert said["grasps_held"] == len(said["grasps"]) == 5
    assert found["low"] < said["truth"]["stiffness_n_per_mm"] < found["high"]
    assert {"target_force_n", "opening_mm", "outcome", "force_n"} <= set(said["grasps"][0])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--up-to-n", "8", "--rig", "sim-soft"], "driven by pressure"),
        (["--up-to-n", "80"], "force ceiling"),
        (["--up-to-n", "0"], "force ceiling"),
        ([], "--up-to-n"),
    ],
)
def test_what_can_not_be_done_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    assert stiffness(*arguments) == 2

    printed = capsys.readouterr()
    assert complaint in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert printed.out == ""
