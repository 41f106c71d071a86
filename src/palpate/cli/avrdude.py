"""Putting an image on an Arduino with avrdude, and what its messages mean."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

from palpate.errors import DeviceError, DeviceNotFoundError, InputError
from palpate.firmware_image import BOARDS

_TIMEOUT_S = 120.0
_SIGNATURES = {
    "1e9801": "ATmega2560",
    "1e950f": "ATmega328P (Arduino Uno, Nano)",
    "1e9514": "ATmega328 (Arduino Uno clones)",
    "1e9587": "ATmega32U4 (Arduino Leonardo, Micro)",
    "1e9703": "ATmega1280 (the first Arduino Mega)",
}
_NO_ANSWER = r"not in sync|timeout|unable to open programmer|not responding"
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
        _NO_ANSWER,
        "no boot loader of this board answers: another board (`--board`), a charge-only cable, or "
        "a clone without boot loader. Press reset just before trying again.",
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


def write_image(image: Path, *, board: str, port: str) -> None:
    """Write an image to the board on a port, and verify it.

    `board`: a key of `palpate.firmware_image.BOARDS`; each of its boot loaders is tried.

    Raises `InputError` if the image is not an Intel hex file; `DeviceError` if avrdude is missing
    or fails; one line that gives the reason.
    """
    _refuse_other_files(image)
    for programmer, baud in BOARDS[board].boot_loaders:
        command = [avrdude_path(), "-p", BOARDS[board].chip, "-c", programmer]
        # -D: the boot loader erases page by page and can't erase the whole chip.
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
    raise DeviceError(f"{port}: {meaning(output, board=board)}")


def meaning(output: str, *, board: str = "mega2560") -> str:
    """Translate the output of a failed avrdude into one line.

    >>> meaning("avrdude: Device signature = 0x1e950f (probably m328p)")
    'the board is an ATmega328P (Arduino Uno, Nano), not an Arduino Mega 2560; see --board'
    """
    about = BOARDS[board]
    signature = re.search(r"signature = (?:0x)?([0-9a-f ]{6,8})", output, re.IGNORECASE)
    if signature is not None:
        chip = signature[1].replace(" ", "").lower()
        if chip in ("000000", "ffffff"):
            return "the chip gives no signature: it is not powered, or its boot loader is broken"
        if not chip.startswith(about.signature):
            name = _SIGNATURES.get(chip[:6], f"a chip with signature 0x{chip}")
            article = "an " if name.startswith("ATmega") else ""
            return f"the board is {article}{name}, not an {about.label}; see --board"
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
