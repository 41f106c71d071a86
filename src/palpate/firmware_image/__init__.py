"""The firmware as it goes on a board: `make -C firmware` builds it, the wheel carries it."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import DeviceNotFoundError

#: In a wheel the images lie next to this file, in a source checkout where they were built.
_HERE = Path(__file__).resolve().parent
_PLACES = (_HERE, _HERE.parents[2] / "firmware" / "build")
#: Speed of the serial line -> image.
IMAGES = {1_000_000: "palpate-mega2560.hex"} | {
    baud: f"palpate-mega2560-{baud}.hex" for baud in (500_000, 250_000, 115_200, 9600)
}


def image_path(baud: int) -> Path:
    """Return the Intel hex file for a speed of the serial line.

    Raises `DeviceNotFoundError` if there is no image for this speed, or none has been built.

    >>> image_path(1234)
    Traceback (most recent call last):
    palpate.errors.DeviceNotFoundError: no firmware for 1234 baud; there is one for: 1000000, \
500000, 250000, 115200, 9600
    """
    if baud not in IMAGES:
        speeds = ", ".join(map(str, IMAGES))
        raise DeviceNotFoundError(f"no firmware for {baud} baud; there is one for: {speeds}")
    for place in _PLACES:
        if (place / IMAGES[baud]).is_file():
            return place / IMAGES[baud]
    raise DeviceNotFoundError(
        "no firmware image in this installation: in a source checkout install gcc-avr, avr-libc "
        "and binutils-avr, then run `make -C firmware`; or give a built one with --image"
    )
