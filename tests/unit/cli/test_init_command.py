"""`palpate init` without a terminal, and with answered prompts."""

from __future__ import annotations

import importlib
import inspect
import os
import pty
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.gripper.hobby_servo import ServoTravel
from palpate.sensor import text_lines
from palpate.sensor.board_array import open_board


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
    assert content["array"].keys() - {"open"} <= open_board.__kwdefaults__.keys()
    assert "no port /dev/ttyACM7" in palpate("doctor", "--rig", path, status=3).err


@pytest.mark.parametrize(
    ("options", "array", "gripper"),
    [
        (["--gripper", "servo"], {"servo": True}, "palpate.gripper.hobby_servo"),
        (
            ["--layout", "soft-3x2", "--gripper", "pneumatic"],
            {"pressure": True},
            "palpate.gripper.pneumatic",
        ),
        (
            ["--gripper", "feetech", "--gripper-port", "/dev/ttyUSB3"],
            {},
            "palpate.gripper.feetech",
        ),
        (
            ["--gripper", "dynamixel", "--gripper-port", "/dev/ttyUSB3", "--idle-lines", "held"],
            {"idle_lines": "held"},
            "palpate.gripper.dynamixel",
        ),
    ],
    ids=["servo", "pneumatic", "feetech", "dynamixel"],
)
def test_init_known_gripper_writes_its_opener_and_what_it_needs_of_the_board(
    options: list[str], array: dict[str, object], gripper: str, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "rig.toml"
    palpate("init", path, "--port", "auto", *options)
    content = tomllib.loads(path.read_text())
    assert array.items() <= content["array"].items()
    table = content["gripper"]
    module, _, function = table.pop("open").partition(":")
    assert module == gripper
    opener = getattr(importlib.import_module(module), function)
    accepted = inspect.signature(opener).parameters
    assert table.keys() <= accepted.keys()
    if "--gripper-port" in options:
        assert table["port"] == "/dev/ttyUSB3"
    if "servo" in options:
        assert ServoTravel(**table).mm_per_us == pytest.approx(69.0 / 1570.0)


def test_init_describes_a_board_that_prints_numbers(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "pad.toml"
    options = ["--board", "text", "--port", "/dev/ttyUSB7", "--layout", "3x1", "--adc-bits", "12"]
    palpate("init", path, *options, "--reference-ohm", "10k")
    table = tomllib.loads(path.read_text())["array"]
    assert table.pop("open") == "palpate.sensor.text_lines:open_board"
    assert table.keys() <= text_lines.open_board.__kwdefaults__.keys() | {"port", "layout"}
    chosen = ("port", "layout", "adc_bits", "reference_ohm", "baud", "idle_lines")
    assert [table[key] for key in chosen] == ["/dev/ttyUSB7", "3x1", 12, 1e4, 115_200, "isolated"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--board", "uno"], "palpate or text"),
        (["--board", "text", "--port", "auto"], "needs its port"),
        (["--board", "text", "--gripper", "servo"], "palpate's firmware"),
        (["--board", "text", "--rate-hz", "30"], "--rate-hz"),
        (["--adc-bits", "12"], "--adc-bits"),
        (["--rate-hz", "0"], "0"),
    ],
)
def test_init_refuses_what_a_board_does_not_have(
    options: list[str], message: str, tmp_path: Path, palpate: Command
) -> None:
    assert message in palpate("init", tmp_path / "pad.toml", *options, status=2).err
    assert not list(tmp_path.iterdir())


def test_init_replaces_an_existing_file_only_with_force(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("mine = 1\n")
    assert "--force" in palpate("init", path, status=2).err
    assert path.read_text() == "mine = 1\n"
    palpate("init", path, "--force", "--port", "auto")
    assert "port" not in tomllib.loads(path.read_text())["array"]


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
    os.write(master, b"\nauto\n4x4\n2\n1000\n\n\n\n")
    assert process.wait(timeout=60) == 0
    _, err = process.communicate()
    os.close(master)
    os.close(slave)
    assert b"Reference resistor, ohm" in err
    array = tomllib.loads(path.read_text())["array"]
    assert (array["layout"], array["fingers"]) == ("4x4", 2)
    assert array["reference_ohm"] == 1000.0
