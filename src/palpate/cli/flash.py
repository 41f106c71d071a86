"""`palpate flash`: write palpate's firmware to an Arduino Mega 2560, Uno or Nano."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

from palpate.cli.options import JsonOption, opt
from palpate.cli.output import print_json, print_message
from palpate.clock import RealClock
from palpate.errors import DeviceError, DeviceNotFoundError, InputError
from palpate.firmware_image import BOARDS, image_path
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.ports import list_serial_ports, query_identity


def flash(
    port: Annotated[
        str | None, opt("--port", "Serial port. [default: the only board found by USB id]")
    ] = None,
    board: Annotated[
        Literal["mega2560", "uno", "nano"], opt("--board", "Type of Arduino.")
    ] = "mega2560",
    baud: Annotated[
        int,
        opt(
            "--baud",
            "Baud rate of the firmware: 1000000, 500000, 250000 or 115200; a Mega also 9600.",
        ),
    ] = 1_000_000,
    image: Annotated[
        Path | None, opt("--image", "Use this Intel hex file instead of the built-in image.")
    ] = None,
) -> None:
    """Write the firmware with avrdude, verify it, and query the board's version.

    Example: palpate flash --port /dev/ttyACM0
    """
    avrdude_path()
    chosen = image or image_path(board, baud)
    device = port or _find_port()
    # Opening the port first gives a one-line error, where avrdude prints many lines or none.
    SerialStream(device, baud=baud).close()
    print_message(f"writing {chosen.name} to {device} ...")
    write_image(chosen, board=board, port=device)
    try:
        found = query_identity(SerialStream(device, baud=baud), clock=RealClock())
    except DeviceError as error:
        raise DeviceError(
            f"firmware written and verified, but the board does not answer: {error}"
        ) from error
    version = ".".join(map(str, found.version))
    print(f"{device}: {found.board} runs palpate's firmware {version} at {found.baud} baud")


def _find_port() -> str:
    """Return the only port with the USB id of a board.

    The firmware can't be queried, because the board may have none yet.
    """
    likely = [found for found in list_serial_ports() if found.board is not None]
    if len(likely) == 1:
        return likely[0].device
    if not likely:
        raise DeviceNotFoundError(
            "no Arduino found by its USB id. Plug it in with a data cable. `palpate ports` lists "
            "the serial ports; choose one with --port."
        )
    names = ", ".join(found.device for found in likely)
    raise DeviceError(f"{len(likely)} boards found: {names}. Choose one with --port.")


_TIMEOUT_S = 120.0
_SIGNATURES = {
    "1e9801": "ATmega2560",
    "1e950f": "ATmega328P (Arduino Uno, Nano)",
    "1e9514": "ATmega328 (Arduino Uno clones)",
    "1e9587": "ATmega32U4 (Arduino Leonardo, Micro)",
    "1e9703": "ATmega1280 (the first Arduino Mega)",
}
_NO_ANSWER = r"not in sync|timeout|unable to open programmer|not responding"
#: (pattern in avrdude's output, explanation); the first match is used.
_EXPLANATIONS = (
    (
        r"permission denied",
        "permission denied. Run `sudo usermod -aG dialout $USER`, then log out and in again.",
    ),
    (r"no such file or directory|cannot find the path", "no such port; `palpate ports` lists them"),
    (r"resource busy|device busy", "in use by another program; close it first"),
    (
        r"verification (error|mismatch)",
        "the board's memory differs from the image: try again with another cable or USB port; if "
        "the error persists, the chip is worn",
    ),
    (
        _NO_ANSWER,
        "the bootloader does not answer: wrong `--board`, a charge-only cable, or a clone without "
        "a bootloader. Press reset just before trying again.",
    ),
)


def avrdude_path() -> str:
    """Return the path of avrdude.

    Raises `DeviceNotFoundError` if it isn't installed; the message explains how to install it.
    """
    found = shutil.which("avrdude")
    if found is None:
        raise DeviceNotFoundError(
            "avrdude is not installed; get it with `sudo apt install avrdude` (Debian, Ubuntu), "
            "`sudo dnf install avrdude` (Fedora) or `brew install avrdude` (macOS)"
        )
    return found


def write_image(image: Path, *, board: str, port: str) -> None:
    """Write an image to the board on a port, and verify it.

    `board`: key of `palpate.firmware_image.BOARDS`; the board's bootloaders are tried in turn.
    Raises `InputError` if the image is not an Intel hex file; `DeviceError` with a one-line reason
    if avrdude is missing or fails.
    """
    _check_intel_hex(image)
    for programmer, baud in BOARDS[board].bootloaders:
        command = [avrdude_path(), "-p", BOARDS[board].chip, "-c", programmer]
        # -D skips the chip erase, which the bootloader does not support.
        command += ["-P", port, "-b", str(baud), "-D", "-U", f"flash:w:{image}:i"]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise DeviceError(
                f"{port}: avrdude did not finish in {_TIMEOUT_S:g} s. Unplug the board, plug it "
                "in and try again."
            ) from error
        output = done.stdout + done.stderr
        if done.returncode == 0:
            return
        if not re.search(_NO_ANSWER, output, re.IGNORECASE):
            break
    raise DeviceError(f"{port}: {explain_failure(output, board=board)}")


def explain_failure(output: str, *, board: str = "mega2560") -> str:
    """Return a one-line explanation of a failed avrdude run.

    >>> explain_failure("avrdude: Device signature = 0x1e950f (probably m328p)")
    'the board is an ATmega328P (Arduino Uno, Nano), not an Arduino Mega 2560; see --board'
    """
    about = BOARDS[board]
    signature = re.search(r"signature = (?:0x)?([0-9a-f ]{6,8})", output, re.IGNORECASE)
    if signature is not None:
        chip = signature[1].replace(" ", "").lower()
        if chip in ("000000", "ffffff"):
            return "the chip returned no signature: no power, or a damaged bootloader"
        if not chip.startswith(about.signature):
            name = _SIGNATURES.get(chip[:6], f"a chip with signature 0x{chip}")
            article = "an " if name.startswith("ATmega") else ""
            return f"the board is {article}{name}, not an {about.label}; see --board"
    for pattern, line in _EXPLANATIONS:
        if re.search(pattern, output, re.IGNORECASE):
            return line
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    wrong = [line for line in lines if "error" in line.lower()] or lines or ["no reason given"]
    return f"avrdude failed: {wrong[0]}"


def _check_intel_hex(image: Path) -> None:
    """Raise `InputError` if a file is not a complete Intel hex file.

    Each line must start with a colon, and the last line must be the end record.
    """
    try:
        lines = image.read_text(encoding="ascii").split()
    except OSError as error:
        raise InputError(f"image {image}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"image {image}: not an Intel hex file") from error
    if not lines or lines[-1].upper() != ":00000001FF" or any(line[0] != ":" for line in lines):
        raise InputError(f"image {image}: a truncated Intel hex file")


def ports(as_json: JsonOption = False) -> None:
    """List serial ports, likely boards first.

    Example: palpate ports
    """
    found = list_serial_ports()
    if as_json:
        print_json({"ports": [asdict(port) for port in found]})
        return
    if not found:
        print("no serial port found; plug in the board")
    for port in found:
        usb = "" if port.usb_id is None else f"{port.usb_id[0]:04x}:{port.usb_id[1]:04x}"
        mark = f"<- {port.board}" if port.board else ""
        print(f"{port.device:<16} {usb:<10} {port.description} {mark}".rstrip())
