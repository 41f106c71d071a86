"""The firmware image for a board, built by `make -C firmware`, carried by the wheel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from palpate.errors import DeviceNotFoundError

#: In a wheel the images lie next to this file, in a source checkout where they were built.
_HERE = Path(__file__).resolve().parent
_PLACES = (_HERE, _HERE.parents[2] / "firmware" / "build")


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardType:
    """An Arduino that palpate's firmware runs on."""

    #: As a person calls it.
    label: str
    #: The processor as avrdude and the simulator call it, and its signature.
    chip: str
    signature: str
    #: Protocols of its boot loaders in avrdude's terms, and their speeds, likeliest first.
    boot_loaders: tuple[tuple[str, int], ...]
    #: Speeds of the serial line that there are images for.
    bauds: tuple[int, ...] = (1_000_000, 500_000, 250_000, 115_200)


#: Sources: the boot loaders of Arduino's AVR core, its boards.txt. A Nano of before 2018 has the
#: slower one.
BOARDS = {
    "mega2560": BoardType(
        label="Arduino Mega 2560",
        chip="atmega2560",
        signature="1e9801",
        boot_loaders=(("wiring", 115_200),),
        bauds=(1_000_000, 500_000, 250_000, 115_200, 9600),
    ),
    "uno": BoardType(
        label="Arduino Uno",
        chip="atmega328p",
        signature="1e950f",
        boot_loaders=(("arduino", 115_200),),
    ),
    "nano": BoardType(
        label="Arduino Nano",
        chip="atmega328p",
        signature="1e950f",
        boot_loaders=(("arduino", 115_200), ("arduino", 57_600)),
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

    Raises `DeviceNotFoundError` if there is no image for them, or none has been built.

    >>> image_path("uno", 9600)
    Traceback (most recent call last):
    palpate.errors.DeviceNotFoundError: no firmware for 9600 baud on an Arduino Uno; there is one \
for: 1000000, 500000, 250000, 115200
    """
    about = BOARDS[board]
    if baud not in about.bauds:
        speeds = ", ".join(map(str, about.bauds))
        raise DeviceNotFoundError(
            f"no firmware for {baud} baud on an {about.label}; there is one for: {speeds}"
        )
    for place in _PLACES:
        if (place / IMAGES[board, baud]).is_file():
            return place / IMAGES[board, baud]
    raise DeviceNotFoundError(
        "no firmware image in this installation: in a source checkout install gcc-avr, avr-libc "
        "and binutils-avr, then run `make -C firmware`; or give a built one with --image"
    )
