"""Putting an image on an Arduino Mega 2560 with avrdude, and what its messages mean."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

from palpate.errors import DeviceError, DeviceNotFoundError, InputError

#: The Mega's boot loader (stk500v2, "wiring" in avrdude's terms) and its speed.
_PART, _PROGRAMMER, _BOOT_BAUD = "atmega2560", "wiring", 115_200
_TIMEOUT_S = 120.0
_SIGNATURES = {
    "1e9801": "ATmega2560",
    "1e950f": "ATmega328P (Arduino Uno, Nano)",
    "1e9514": "ATmega328 (Arduino Uno clones)",
    "1e9587": "ATmega32U4 (Arduino Leonardo, Micro)",
    "1e9703": "ATmega1280 (the first Arduino Mega)",
}
#: avrdude's message -> what it means; the first match counts.
_MEANINGS = (
    (
        r"permission denied",
        "permission denied. Run `sudo usermod -aG dialout $USER`, then log out and in again.",
    ),
    (r"no such file or directory|cannot find the path", "no such port; `palpate ports` lists them"),
    (r"resource busy|device busy", "in use by another program; close it first"),
    (
        r"verification (error|mismatch)",
        "the board's memory differs from what was written: another cable or USB port, then "
        "again; if it stays, the chip is worn",
    ),
    (
        r"not in sync|timeout|unable to open programmer|not responding",
        "no Mega 2560 boot loader answers: another board (an Uno speaks another protocol), a "
        "charge-only cable, or a clone without boot loader. Press reset just before trying again.",
    ),
)


def avrdude_path() -> str:
    """Return where avrdude is.

    Raises `DeviceNotFoundError` if it isn't installed; the message explains how to install it.
    """
    found = shutil.which("avrdude")
    if found is None:
        raise DeviceNotFoundError(
            "avrdude is not installed; get it with `sudo apt install avrdude` (Debian, Ubuntu), "
            "`sudo dnf install avrdude` (Fedora) or `brew install avrdude` (macOS)"
        )
    return found


def write_image(image: Path, *, port: str) -> None:
    """Write an image to the board on a port, and verify it.

    Raises `InputError` if the image is not an Intel hex file; `DeviceError` if avrdude is missing
    or fails; one line that gives the reason.
    """
    _refuse_other_files(image)
    command = [avrdude_path(), "-p", _PART, "-c", _PROGRAMMER, "-P", port, "-b", str(_BOOT_BAUD)]
    # -D: the boot loader erases page by page and can't erase the whole chip.
    command += ["-D", "-U", f"flash:w:{image}:i"]
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
            f"{port}: avrdude did not finish in {_TIMEOUT_S:g} s. Unplug the board, plug it in "
            "and try again."
        ) from error
    if done.returncode != 0:
        raise DeviceError(f"{port}: {meaning(done.stdout + done.stderr)}")


def meaning(output: str) -> str:
    """Translate the output of a failed avrdude into one line.

    >>> meaning("avrdude: Device signature = 0x1e950f (probably m328p)")
    'the board is an ATmega328P (Arduino Uno, Nano), not a Mega 2560; palpate needs a Mega 2560'
    """
    signature = re.search(r"signature = (?:0x)?([0-9a-f ]{6,8})", output, re.IGNORECASE)
    if signature is not None:
        chip = signature[1].replace(" ", "").lower()
        if chip in ("000000", "ffffff"):
            return "the chip gives no signature: it is not powered, or its boot loader is broken"
        if not chip.startswith("1e9801"):
            name = _SIGNATURES.get(chip[:6], f"a chip with signature 0x{chip}")
            article = "an " if name.startswith("ATmega") else ""
            return f"the board is {article}{name}, not a Mega 2560; palpate needs a Mega 2560"
    for pattern, line in _MEANINGS:
        if re.search(pattern, output, re.IGNORECASE):
            return line
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    wrong = [line for line in lines if "error" in line.lower()] or lines or ["no reason given"]
    return f"avrdude failed: {wrong[0]}"


def _refuse_other_files(image: Path) -> None:
    """An Intel hex file begins each line with a colon and ends with its end record."""
    try:
        lines = image.read_text(encoding="ascii").split()
    except OSError as error:
        raise InputError(f"image {image}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"image {image}: not an Intel hex file") from error
    if not lines or lines[-1].upper() != ":00000001FF" or any(line[0] != ":" for line in lines):
        raise InputError(f"image {image}: not a whole Intel hex file")
