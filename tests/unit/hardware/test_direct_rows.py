"""Smallest pixels of direct rows, from the full network with pin resistance."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.signal.crosstalk import unmix_held

README = (Path(__file__).resolve().parents[3] / "hardware" / "README.md").read_text()
#: ATmega2560, DC characteristics: at least 4.2 V at 20 mA and 5 V.
PIN_OHM, MOST_A = 0.8 / 0.020, 0.020
MUX_OHM, REFERENCE_OHM, SUPPLY_V = 70.0, 4700.0, 5.0


def read_pixel(
    pixel_ohm: NDArray[np.float64], row: int, col: int, pin_ohm: float
) -> tuple[float, float]:
    """Return the divider's reading of a pixel, ohm, and its row pin's current."""
    rows, cols = pixel_ohm.shape
    network, driven = np.zeros((rows + cols, rows + cols)), np.zeros(rows + cols)
    network[:rows, rows:] = -1.0 / pixel_ohm
    network[rows:, :rows] = -1.0 / pixel_ohm.T
    network -= np.diag(network.sum(axis=1))
    network[range(rows), range(rows)] += 1.0 / pin_ohm
    network[rows + col, rows + col] += 1.0 / (MUX_OHM + REFERENCE_OHM)
    driven[row] = SUPPLY_V / pin_ohm
    volts = np.linalg.solve(network, driven)
    at_converter = volts[rows + col] * REFERENCE_OHM / (MUX_OHM + REFERENCE_OHM)
    return REFERENCE_OHM * (SUPPLY_V / at_converter - 1.0), (SUPPLY_V - volts[row]) / pin_ohm


def read_all(ohm: float, *, rows: int, cols: int, pin_ohm: float) -> tuple[float, float]:
    """Return the largest error of equal pixels after the correction, and a pin's current."""
    pixels = np.full((rows, cols), ohm)
    reads = np.empty_like(pixels)
    amperes = 0.0
    for row, col in np.ndindex(pixels.shape):
        reads[row, col], drawn = read_pixel(pixels, row, col, pin_ohm)
        amperes = max(amperes, drawn)
    solved = unmix_held(reads - MUX_OHM, reference_ohm=REFERENCE_OHM + MUX_OHM)
    return float(np.abs(solved / ohm - 1.0).max()), amperes


ROWS = re.findall(r"^\| (\d+) \| ([\d.]+) (k?)Ω \|$", README, re.MULTILINE)


@pytest.mark.parametrize(("cols", "number", "kilo"), ROWS)
def test_direct_rows_smallest_pixels_respect_pin_limits(cols: str, number: str, kilo: str) -> None:
    ohm = float(number) * (1e3 if kilo else 1.0)
    for rows in (2, 6, 16):
        error, amperes = read_all(ohm, rows=rows, cols=int(cols), pin_ohm=PIN_OHM)
        assert error <= 0.081
        assert amperes <= MOST_A
    # Half of the resistance violates a limit, so the table is not too conservative.
    error, amperes = read_all(ohm / 2.0, rows=16, cols=int(cols), pin_ohm=PIN_OHM)
    assert error > 0.081 or amperes > MOST_A
