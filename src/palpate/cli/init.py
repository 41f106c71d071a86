"""`palpate init`: prompt for the parts of a rig and write the rig file."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import typer

from palpate.cli import options as option
from palpate.cli.options import opt
from palpate.errors import InputError
from palpate.files import atomic_path
from palpate.sensor.array import IdleLines
from palpate.sensor.board_array import LAYOUTS, check_rate, find_layout
from palpate.sensor.ports import list_serial_ports

_Answer = TypeVar("_Answer")
#: Kind of board -> opener, and its usual baud rate.
_BOARDS = {
    "palpate": ("palpate.sensor.board_array:open_board", 1_000_000),
    "text": ("palpate.sensor.text_lines:open_board", 115_200),
}
_ANY_PORT, _NO_GRIPPER, _LAYOUT, _TEXT_PORT = "auto", "none", "rigid-2x2", "/dev/ttyUSB0"
#: Kind of gripper -> opener.
_GRIPPERS = {
    "dynamixel": "palpate.gripper.dynamixel:open_gripper",
    "feetech": "palpate.gripper.feetech:open_gripper",
    "pneumatic": "palpate.gripper.pneumatic:open_gripper",
    "servo": "palpate.gripper.hobby_servo:open_gripper",
}
#: Actuator on the sensor board -> array option that adds the actuator's state to the frames.
_SHARED = {"pneumatic": "pressure", "servo": "servo"}
#: Usual port of a servo's adapter.
_SERVO_PORTS = {"dynamixel": "/dev/ttyUSB0", "feetech": "/dev/ttyACM1"}
#: Nominal values, to be replaced by measured ones: the gripper in `hardware/` (pitch diameter
#: 28 mm), and the gripper of an SO-101.
_NOMINAL: dict[str, dict[str, str | float]] = {
    "servo": {"open_us": 715, "closed_us": 2285, "open_mm": 74.0, "closed_mm": 5.0},
    "feetech": {"servo_id": 6, "jaw_mm": 75.0, "closed_tick": 1480, "opens": 1, "highest_mm": 60.0},
}


def init(
    file: Annotated[Path, typer.Argument(help="The new rig file.")] = Path("rig.toml"),
    board: Annotated[
        str | None,
        opt("--board KIND", "palpate (its firmware), or text (a sketch that prints numbers)."),
    ] = None,
    port: Annotated[
        str | None, opt("--port", "Serial port, or `auto` to search for the board on each start.")
    ] = None,
    layout: Annotated[
        str | None, opt("--layout", "rigid-2x2, soft-3x2, or rows x columns such as 4x4.")
    ] = None,
    reference_ohm: option.ReferenceOhmOption = None,
    taxel_leg: Annotated[
        str | None, opt("--taxel-leg", "upper: pixel at the supply; lower: pixel at ground.")
    ] = None,
    gripper: Annotated[
        str | None,
        opt(
            "--gripper KIND",
            "none, dynamixel, feetech (the gripper of an SO-101), pneumatic (the board's "
            "regulator), servo (a hobby servo on the board), or module:function of your own "
            "opener.",
        ),
    ] = None,
    gripper_port: Annotated[
        str | None, opt("--gripper-port", "Serial port of a Dynamixel or Feetech servo.")
    ] = None,
    idle_lines: Annotated[
        str | None,
        opt("--idle-lines", "floating: two multiplexers; held: rows on the Mega's pins; isolated."),
    ] = None,
    fingers: Annotated[
        int | None,
        opt(
            "--fingers",
            "Number of fingers that share the rows of a layout such as 6x3. [default: 1]",
        ),
    ] = None,
    rate_hz: Annotated[
        float | None, opt("--rate-hz", "Frames per second of palpate's firmware. [default: 250]")
    ] = None,
    baud: Annotated[
        int | None,
        opt("--baud", "Baud rate of the board. [default: 1000000; text 115200]", min=1),
    ] = None,
    adc_bits: Annotated[
        int | None,
        opt("--adc-bits", "Bits of a text board's converter. [default: 10; 12 on most ESP32]"),
    ] = None,
    force: Annotated[bool, opt("--force", "Replace an existing file.")] = False,
) -> None:
    """Write a rig file.

    Prompts for values without an option; without a terminal, uses the defaults.

    Example: palpate init rig.toml --port /dev/ttyACM0 --layout rigid-2x2 --reference-ohm 4700
    """
    if file.suffix != ".toml":
        raise InputError(f"{file}: the name of a rig file must end in .toml")
    if file.exists() and not force:
        raise InputError(f"{file} exists; give another name, or --force to replace it")
    kind = _prompt(f"Board ({', '.join(_BOARDS)})", board, "palpate")
    if kind not in _BOARDS:
        raise InputError(f"--board {kind}: give {' or '.join(_BOARDS)}")
    opener, usual_baud = _BOARDS[kind]
    is_text = kind == "text"
    if (is_text and rate_hz is not None) or (not is_text and adc_bits is not None):
        option_name = "--rate-hz" if is_text else "--adc-bits"
        raise InputError(f"{option_name} does not belong to --board {kind}")
    frames_per_s = 250.0 if rate_hz is None else rate_hz
    check_rate(frames_per_s)
    boards = [found.device for found in list_serial_ports() if found.board is not None]
    likely = boards[0] if len(boards) == 1 else _ANY_PORT
    # A board that only prints can't be asked who it is.
    answer = _prompt("Serial port", port, _TEXT_PORT if is_text else likely)
    if is_text and answer == _ANY_PORT:
        raise InputError("--port auto: a board that prints numbers needs its port (palpate ports)")
    array: dict[str, str | float | bool] = {"open": opener, "port": answer}
    array |= _prompt_for_layout(layout, fingers)
    array |= _prompt_for_divider(
        reference_ohm, taxel_leg, idle_lines, usual_lines="isolated" if is_text else "floating"
    )
    if is_text:
        array["adc_bits"] = _prompt("Bits of the converter", adc_bits, 10)
    else:
        array["rate_hz"] = frames_per_s
    array["baud"] = usual_baud if baud is None else baud
    find_layout(
        str(array["layout"]),
        reference_ohm=float(array["reference_ohm"]),
        idle_lines=cast(IdleLines, array["idle_lines"]),
        fingers=int(array.get("fingers", 1)),
    )
    hand = _prompt_for_gripper(gripper, gripper_port)
    shared = [name for name in _SHARED if hand.get("open") == _GRIPPERS[name]]
    if is_text and shared:
        raise InputError(f"--gripper {shared[0]} needs palpate's firmware, not --board text")
    array |= {_SHARED[name]: True for name in shared}
    text = format_rig_file(array, gripper=hand, calibration=f"{file.stem}-calibration.json")
    with atomic_path(file) as partial:
        partial.write_text(text)
    print(f"Written: {file}")
    if hand.keys() & {key for table in _NOMINAL.values() for key in table}:
        print("Replace the nominal values of [gripper] by measured ones (docs/grippers.md).")
    print(f"Next: palpate doctor --rig {file}")
    rest = "force and compliance for grasping" if hand else "force for newtons"
    print(f"Then: palpate calibrate rest --rig {file}, and {rest}")


def _prompt_for_layout(layout: str | None, fingers: int | None) -> dict[str, str | float | bool]:
    """Prompt for the layout and, for a matrix, the number of fingers."""
    name = _prompt(
        f"Layout ({', '.join(LAYOUTS)}, or total rows x columns, such as 6x3)", layout, _LAYOUT
    )
    if name in LAYOUTS and fingers is None:
        return {"layout": name}
    count = _prompt("Number of fingers that share the rows", fingers, 1)
    if count < 0:
        raise InputError(f"--fingers {count}: give a whole number, such as 2")
    return {"layout": name, "fingers": count}


def _prompt_for_divider(
    reference_ohm: float | None,
    taxel_leg: str | None,
    idle_lines: str | None,
    *,
    usual_lines: str,
) -> dict[str, str | float | bool]:
    """Prompt for the reference resistor, the pixel's leg and the idle lines."""
    ohm = _prompt("Reference resistor, ohm", reference_ohm, 4700.0)
    leg = _prompt("Pixel at the supply (upper) or at ground (lower)", taxel_leg, "upper")
    if leg not in ("upper", "lower"):
        raise InputError(f"--taxel-leg {leg}: give upper or lower")
    idle = _prompt(
        "Idle lines: floating (two multiplexers), held (direct rows), or isolated",
        idle_lines,
        usual_lines,
    )
    return {"reference_ohm": ohm, "taxel_leg": leg, "idle_lines": idle}


def _prompt_for_gripper(kind: str | None, port: str | None) -> dict[str, str | float]:
    """Prompt for the gripper; return the [gripper] table, empty without a gripper."""
    kinds = ", ".join((_NO_GRIPPER, *_GRIPPERS))
    chosen = _prompt(f"Gripper ({kinds}, or module:function of an opener)", kind, _NO_GRIPPER)
    if port is not None and chosen not in _SERVO_PORTS:
        raise InputError(
            f"--gripper-port is for --gripper {' or '.join(_SERVO_PORTS)}, not for {chosen}"
        )
    if chosen == _NO_GRIPPER:
        return {}
    if chosen in _GRIPPERS:
        table: dict[str, str | float] = {"open": _GRIPPERS[chosen]}
        if chosen in _SERVO_PORTS:
            servo = _prompt("Serial port of the gripper's servo", port, _SERVO_PORTS[chosen])
            table["port"] = servo
        return table | _NOMINAL.get(chosen, {})
    if ":" not in chosen:
        raise InputError(
            f"--gripper {chosen}: give {kinds}, or module:function, such as my_arm:open_hand"
        )
    return {"open": chosen}


def format_rig_file(
    array: dict[str, str | float | bool], *, gripper: dict[str, str | float], calibration: str
) -> str:
    """Return the text of a rig file.

    `array`: the [array] table; the port ``"auto"`` is omitted.
    `gripper`: the [gripper] table; empty without a gripper.
    `calibration`: name of the calibration file, relative to the rig file.

    >>> array = {"open": "palpate.sensor.board_array:open_board", "port": "auto", "layout": "4x4"}
    >>> print(format_rig_file(array, gripper={}, calibration="c.json"))
    # Rig file of palpate: the parts of a rig, and the functions that open them.
    calibration = "c.json"
    <BLANKLINE>
    [array]
    open = "palpate.sensor.board_array:open_board"
    layout = "4x4"
    <BLANKLINE>
    # No gripper: doctor, live and calibrate work; grasp requires a [gripper] table with
    # open = "module:function" and the keyword arguments of that function.
    <BLANKLINE>
    """
    lines = [
        "# Rig file of palpate: the parts of a rig, and the functions that open them.",
        f"calibration = {json.dumps(calibration)}",
        "",
        "[array]",
    ]
    written = {key: value for key, value in array.items() if value != _ANY_PORT}
    lines += [f"{key} = {json.dumps(value)}" for key, value in written.items()]
    if gripper:
        lines += ["", "[gripper]"]
        lines += [f"{key} = {json.dumps(value)}" for key, value in gripper.items()]
    else:
        lines += [
            "",
            "# No gripper: doctor, live and calibrate work; grasp requires a [gripper] table with",
            '# open = "module:function" and the keyword arguments of that function.',
        ]
    return "\n".join(lines) + "\n"


def _prompt(question: str, given: _Answer | None, default: _Answer) -> _Answer:
    """Return the option's value; if None, prompt on a terminal, or return the default."""
    if given is not None or not sys.stdin.isatty():
        return default if given is None else given
    answer: Any = typer.prompt(question, default=default, type=type(default), err=True)
    return cast(_Answer, answer.strip() if isinstance(answer, str) else answer)
