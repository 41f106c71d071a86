"""`palpate init` without a terminal, and with answered prompts."""

from __future__ import annotations

import importlib
import os
import pty
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.errors import InputError
from palpate.gripper.hobby_servo import ServoTravel, open_gripper
from palpate.sensor.board_array import find_layout, open_board


def test_init_options_are_written_to_the_rig_file(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "orchard.toml"
    options = ["--port", "/dev/ttyACM7", "--layout", "soft-3x2", "--reference-ohm", "1000"]
    options += ["--baud", "9600", "--rate-hz", "15"]
    palpate("init", path, *options, "--taxel-leg", "lower", "--gripper", "my_arm:open_hand")
    content = tomllib.loads(path.read_text())
    assert content == {
        "calibration": "orchard-calibration.json",
        "array": {
            "open": "palpate.sensor.board_array:open_board",
            "port": "/dev/ttyACM7",
            "layout": "soft-3x2",
            "reference_ohm": 1000.0,
            "taxel_leg": "lower",
            "idle_lines": "floating",
            "rate_hz": 15.0,
            "baud": 9600,
        },
        "gripper": {"open": "my_arm:open_hand"},
    }


def test_init_hobby_servo_writes_travel_and_enables_pulses_in_frames(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "rig.toml"
    palpate("init", path, "--port", "auto", "--gripper", "servo")
    content = tomllib.loads(path.read_text())
    assert content["array"]["servo"] is True
    table = content["gripper"]
    assert table.pop("open") == f"{open_gripper.__module__}:{open_gripper.__name__}"
    assert ServoTravel(**table).mm_per_us == pytest.approx(69.0 / 1570.0)


def test_init_writes_matrix_on_two_fingers(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    palpate("init", path, "--port", "auto", "--layout", "6x3", "--fingers", "2")
    content = tomllib.loads(path.read_text())["array"]
    assert (content["layout"], content["fingers"]) == ("6x3", 2)
    layout = find_layout(content["layout"], fingers=content["fingers"], pitch_mm=6.5)
    assert (layout.pixels, layout.fingers, layout.pitch_mm) == (18, 2, 6.5)
    assert layout.finger_mask(1)[:, 0].tolist() == [False] * 3 + [True] * 3


@pytest.mark.parametrize(
    ("gripper", "rest"),
    [("none", "and force for newtons"), ("dynamixel", "and force and compliance for grasping")],
)
def test_init_next_steps_match_the_rig(
    tmp_path: Path, palpate: Command, gripper: str, rest: str
) -> None:
    shown = palpate("init", tmp_path / "rig.toml", "--port", "auto", "--gripper", gripper).out
    assert rest in shown


@pytest.mark.parametrize("pitch_mm", [0.0, -1.0, float("nan")])
def test_find_layout_invalid_pitch_is_refused(pitch_mm: float) -> None:
    with pytest.raises(InputError, match="give the distance between pixel centres"):
        find_layout("3x3", pitch_mm=pitch_mm)


def test_init_writes_only_parameters_of_open_board(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    palpate("init", path, "--port", "/dev/no-such-port")
    table = tomllib.loads(path.read_text())["array"]
    assert table.pop("open") == f"{open_board.__module__}:{open_board.__name__}"
    accepted = open_board.__kwdefaults__
    assert table.keys() <= accepted.keys()


def test_init_pneumatic_gripper_uses_the_sensor_board(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "soft.toml"
    palpate("init", path, "--port", "auto", "--layout", "soft-3x2", "--gripper", "pneumatic")
    content = tomllib.loads(path.read_text())
    assert content["array"]["pressure"] is True
    assert content["gripper"] == {"open": "palpate.gripper.pneumatic:open_gripper"}
    module, _, function = content["gripper"]["open"].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_init_known_gripper_writes_its_opener(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    options = ["--gripper", "dynamixel", "--gripper-port", "/dev/ttyUSB3", "--idle-lines", "held"]
    palpate("init", path, "--port", "auto", *options)
    content = tomllib.loads(path.read_text())
    assert content["array"]["idle_lines"] == "held"
    table = content["gripper"]
    module, _, function = table.pop("open").partition(":")
    opener = getattr(importlib.import_module(module), function)
    assert table == {"port": "/dev/ttyUSB3"}
    assert table.keys() <= opener.__kwdefaults__.keys() | opener.__annotations__.keys()


def test_init_rig_file_opens_the_given_port(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    palpate("init", path, "--port", "/dev/no-such-port")
    assert "no port /dev/no-such-port" in palpate("doctor", "--rig", path, status=3).err


def test_init_replaces_an_existing_file_only_with_force(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("mine = 1\n")
    assert "--force" in palpate("init", path, status=2).err
    assert path.read_text() == "mine = 1\n"
    palpate("init", path, "--force", "--port", "auto")
    assert "port" not in tomllib.loads(path.read_text())["array"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rig.json"], "must end in .toml"),
        (["rig.toml", "--layout", "round"], "unknown layout"),
        (["rig.toml", "--layout", "5x3", "--fingers", "2"], "5 rows cannot be divided equally"),
        (["rig.toml", "--layout", "6x3", "--fingers", "-2"], "--fingers -2: give a whole number"),
        (["rig.toml", "--layout", "soft-3x2", "--fingers", "3"], "has 2 fingers, not 3"),
        (["rig.toml", "--reference-ohm", "-5"], "above 0 ohm"),
        (["rig.toml", "--rate-hz", "nan"], "frame rate nan Hz: must be positive and finite"),
        (["rig.toml", "--rate-hz", "0"], "frame rate 0 Hz"),
        (["rig.toml", "--baud", "0"], "greater than or equal to 1"),
        (["rig.toml", "--taxel-leg", "middle"], "upper or lower"),
        (["rig.toml", "--gripper", "claw"], "module:function"),
        (["rig.toml", "--gripper", "servo", "--gripper-port", "/dev/x"], "not for servo"),
        (["rig.toml", "--idle-lines", "wet"], "idle_lines 'wet'"),
    ],
)
def test_init_invalid_options_write_no_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    palpate: Command,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in palpate("init", *arguments, status=2).err
    assert list(tmp_path.iterdir()) == []


def test_init_prompts_on_a_terminal(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    master, slave = pty.openpty()
    program = "from palpate.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", program, "init", str(path)],
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    os.write(master, b"auto\n4x4\n2\n1000\n\n\n\n")
    assert process.wait(timeout=60) == 0
    _, err = process.communicate()
    os.close(master)
    os.close(slave)
    assert b"Reference resistor, ohm" in err
    array = tomllib.loads(path.read_text())["array"]
    assert (array["layout"], array["fingers"]) == ("4x4", 2)
    assert array["reference_ohm"] == 1000.0
