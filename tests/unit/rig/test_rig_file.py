"""Rig files: valid contents, and one-line errors for invalid ones."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.calibration import Calibration
from palpate.errors import CalibrationError, InputError, PalpateError
from palpate.gripper.interface import GripperLimits
from palpate.rig import open_rig
from palpate.rig.file import open_device, read_rig_file, read_rig_table


def refused(path: Path, text: str, error: type[PalpateError] = InputError) -> str:
    """Return the message in one line with which a rig file of this text is refused."""
    path.write_text(text)
    with pytest.raises(error) as caught:
        open_rig(str(path))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "rig.toml"


CELLS = "calibration = 'a.json'\n[array]\n[gripper]\n[load_cells]\nnewtons_per_count = "


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("use = ", "Invalid value"),
        ("[array]\nopen = 'a:b'\n", 'no `calibration = "FILE"`; found array'),
        ("[array]\n[gripper]\n", 'no `calibration = "FILE"`; found array, gripper'),
        ("calibration = 'c'\n[array]\n[gripper]\n[load_cell]\n", "unknown key load_cell;"),
        ("use = 'sim-rigid'\nlevel = 'field'\n", "only `calibration` is allowed together"),
        ("use = 'unheard-of'\n", "no rig 'unheard-of'"),
        ("calibration = 'a.json'\nload_cells = 3\n[array]\n[gripper]\n", "found 3"),
        (f"{CELLS}[1e-6]\ntare = 3\n", "newtons_per_count, tare"),
        (f"{CELLS}1e-6\n", "found 1e-06"),
        (f"{CELLS}[1e-6, 1e-6, 1e-6]\n", "1 or 2"),
        (f"{CELLS}[1e-6, '1e-6']\n", "'1e-6' is not a nonzero number"),
        (f"{CELLS}[nan]\n", "nan is not a nonzero number"),
    ],
)
def test_open_rig_invalid_file_error_names_fault(path: Path, text: str, message: str) -> None:
    assert message in refused(path, text)


@pytest.mark.parametrize(
    "opener",
    [
        ":", "x:", ".:x", "a..b:c", "a:b:c", "a:b()", "\\u0000:x", "a" * 3000 + ":b",
        "no_such_module:x", "os.path:no_such", "os:sep", "json:dumps", "sys:exit",
        "string:Formatter",
    ],
)  # fmt: skip
def test_open_device_refuses_an_opener_that_opens_no_device(path: Path, opener: str) -> None:
    path.write_text(f'[array]\nopen = "{opener}"\n')
    with pytest.raises(InputError, match=r"rig file .*rig\.toml: \[array\]") as caught:
        open_device(path, "array", read_rig_table(path)["array"])
    assert "\n" not in str(caught.value)


def test_opener_is_found_beside_the_rig_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "hand_of_mine.py").write_text(
        "from own_bus import Hand\ndef open_hand():\n    return Hand()\n"
    )
    names = ("limits", "state", "command", "stop", "release", "close")
    lines = ["class Hand:", *(f"    {name} = None" for name in names)]
    (tmp_path / "own_bus.py").write_text("\n".join(lines))
    (tmp_path / "rig.toml").write_text('[gripper]\nopen = "hand_of_mine:open_hand"\n')
    path = tmp_path / "rig.toml"
    hand = open_device(path, "gripper", read_rig_table(path)["gripper"])
    assert type(hand).__name__ == "Hand"


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return open_rig("sim-rigid", object_name="tomato", seed=5).calibration


@pytest.fixture
def bench(
    calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> SimpleNamespace:
    """Save a calibration `pad.json`; return matching openers and a list of closed devices."""
    calibration.save(tmp_path / "pad.json")
    closed: list[str] = []

    def open_array(**changed: Any) -> SimpleNamespace:
        layout = replace(calibration.layout, **changed)
        return SimpleNamespace(layout=layout, close=lambda: closed.append("array"))

    def open_hand(*, array: object, colour: str) -> SimpleNamespace:
        limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        close = lambda: closed.append("hand")  # noqa: E731
        return SimpleNamespace(array=array, colour=colour, limits=limits, close=close)

    made = SimpleNamespace(array=open_array, hand=open_hand, calibration=calibration, closed=closed)
    monkeypatch.setitem(sys.modules, "my_bench", made)
    return made


BENCH = """
calibration = 'pad.json'
[array]
open = 'my_bench:array'
[gripper]
open = 'my_bench:hand'
colour = 'red'
"""


@pytest.mark.slow
def test_open_rig_file_opens_devices_by_module_and_function(
    bench: SimpleNamespace, path: Path
) -> None:
    path.write_text(BENCH)
    opened = open_rig(str(path))
    assert (opened.gripper.array, opened.gripper.colour) == (opened.array, "red")
    assert opened.calibration == bench.calibration
    assert not opened.is_simulated
    missing = BENCH.replace("my_bench:hand", "my_bench:nothing")
    assert "[gripper] open = 'my_bench:nothing'" in refused(path, missing)


@pytest.mark.slow
def test_open_rig_use_with_calibration_replaces_own_calibration(
    calibration: Calibration, tmp_path: Path, path: Path
) -> None:
    calibration.save(tmp_path / "pad.json")
    path.write_text("use = 'sim-rigid'\ncalibration = 'pad.json'\n")
    opened = open_rig(str(path), object_name="tomato", seed=6)
    assert opened.is_simulated
    assert opened.calibration == calibration
    message = refused(path, "use = 'sim-soft'\ncalibration = 'pad.json'\n", CalibrationError)
    assert "belongs to another sensor" in message


@pytest.mark.slow
def test_open_rig_calibration_of_other_wiring_is_refused(
    bench: SimpleNamespace, path: Path
) -> None:
    wiring = BENCH.replace("[gripper]", "idle_lines = 'floating'\nline_ohm = 80.0\n[gripper]")
    message = "idle_lines 'isolated' instead of 'floating', line_ohm 0.0 instead of 80.0"
    assert message in refused(path, wiring, CalibrationError)
    assert bench.closed == ["hand", "array"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ("port = 3", "[array] port = 3: it must be text in quotes"),
        ("baud = '1000000'", "[array] baud = '1000000': it must be a whole number"),
        ("rate_hz = nan", "[array] rate_hz = nan: it must be a finite number"),
        ("pressure = 1", "[array] pressure = 1: it must be true or false"),
        ("taxel_leg = 'left'", "taxel_leg = 'left': it must be one of 'upper', 'lower'"),
        ("rates_hz = 250", "[array] unknown option 'rates_hz'; available: port, layout"),
        ("port = '/dev/null'\nbaud = -1", "[array] baud -1: must be 50 to 12000000"),
        ("oversampling = 65", "[array] oversampling = 65: the board sums 1 to 64 conversions"),
        ("rate_hz = 1e12", "[array] frame rate 1e+12 Hz: must be 0.001 to 4294967 Hz"),
    ],
)
def test_open_rig_invalid_opener_option_is_named(
    calibration: Calibration, tmp_path: Path, path: Path, stated: str, message: str
) -> None:
    calibration.save(tmp_path / "pad.json")
    text = (
        "calibration = 'pad.json'\n"
        f"[array]\nopen = 'palpate.sensor.board_array:open_board'\n{stated}\n"
        "[gripper]\nopen = 'types:SimpleNamespace'\n"
    )
    found = refused(path, text)
    assert f"rig file {path}: " in found
    assert message in found


def test_read_rig_file_returns_newtons_per_count(path: Path) -> None:
    path.write_text(f"{CELLS}[4.7e-6, -1]\n")
    assert read_rig_file(path).newtons_per_count == (4.7e-6, -1.0)
    path.write_text("calibration = 'a.json'\n[array]\n[gripper]\n")
    assert read_rig_file(path).newtons_per_count is None
