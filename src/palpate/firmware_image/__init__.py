"""Firmware images for the boards, built with `make -C firmware` and included in the wheel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from palpate.errors import DeviceNotFoundError

#: Folders of the images: next to this file in a wheel, the build folder in a source checkout.
_HERE = Path(__file__).resolve().parent
_PLACES = (_HERE, _HERE.parents[2] / "firmware" / "build")


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardType:
    """An Arduino board supported by palpate's firmware."""

    #: Display name.
    label: str
    #: Name of the processor in avrdude and the simulator, and its signature.
    chip: str
    signature: str
    #: avrdude protocols and speeds of the bootloaders, most likely first.
    bootloaders: tuple[tuple[str, int], ...]
    #: Speeds of the serial line with an image.
    bauds: tuple[int, ...] = (1_000_000, 500_000, 250_000, 115_200)


#: Source: boards.txt of Arduino's AVR core. A Nano made before 2018 has the slower bootloader.
BOARDS = {
    "mega2560": BoardType(
        label="Arduino Mega 2560",
        chip="atmega2560",
        signature="1e9801",
        bootloaders=(("wiring", 115_200),),
        bauds=(1_000_000, 500_000, 250_000, 115_200, 9600),
    ),
    "uno": BoardType(
        label="Arduino Uno",
        chip="atmega328p",
        signature="1e950f",
        bootloaders=(("arduino", 115_200),),
    ),
    "nano": BoardType(
        label="Arduino Nano",
        chip="atmega328p",
        signature="1e950f",
        bootloaders=(("arduino", 115_200), ("arduino", 57_600)),
    ),
}
#: Board and speed of the serial line -> image.
IMAGES = {
    (board, baud): f"palpate-{board}.hex" if baud == 1_000_000 else f"palpate-{board}-{baud}.hex"
    for board, about in BOARDS.items()
    for baud in about.bauds
}


def image_path(board: str, baud: int) -> Path:
    """Return the Intel hex file for a board and a speed of its serial line.

    Raises `DeviceNotFoundError` if no image exists for them, or it has not been built.

    >>> image_path("uno", 9600)
    Traceback (most recent call last):
    palpate.errors.DeviceNotFoundError: no firmware for 9600 baud on an Arduino Uno; available \
speeds: 1000000, 500000, 250000, 115200
    """
    about = BOARDS[board]
    if baud not in about.bauds:
        speeds = ", ".join(map(str, about.bauds))
        raise DeviceNotFoundError(
            f"no firmware for {baud} baud on an {about.label}; available speeds: {speeds}"
        )
    for place in _PLACES:
        if (place / IMAGES[board, baud]).is_file():
            return place / IMAGES[board, baud]
    raise DeviceNotFoundError(
        "no firmware image in this installation: in a source checkout install gcc-avr, avr-libc "
        "and binutils-avr, then run `make -C firmware`; or specify an image with --image"
    )
