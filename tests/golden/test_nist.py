"""Certified nonlinear least-squares problems of NIST StRD, from no starting value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.settling.varpro import fit_rate, saturation

FOLDER = Path(__file__).parent / "nist"


def read(name: str) -> tuple[list[float], float, np.ndarray, np.ndarray]:
    """Return certified parameters, certified residual sum of squares, x and y (NIST's layout)."""
    lines = (FOLDER / f"{name}.dat").read_text().splitlines()
    certified = [float(line.split()[4]) for line in lines[40:42]]
    squares = next(float(line.split()[-1]) for line in lines if "Residual Sum of" in line)
    y, x = np.array([[float(cell) for cell in line.split()] for line in lines[60:]]).T
    return certified, squares, x, y


@pytest.mark.parametrize("name", ["Misra1a", "BoxBOD"])
def test_certified_values_to_eight_digits(name: str) -> None:
    """Both are b1 (1 - exp(-b2 x)); the grid knows of the data only how far x reaches."""
    certified, squares, x, y = read(name)
    rates = np.geomspace(1e-3, 1e3, 150) / x.max()
    fit = fit_rate(x, y[None], rates=rates, basis=saturation, offset=False)
    # Half a unit of the eighth significant digit.
    assert fit.amplitude[0] == pytest.approx(certified[0], rel=5e-9)
    assert fit.rate[0] == pytest.approx(certified[1], rel=5e-9)
    assert fit.unexplained[0] == pytest.approx(squares, rel=5e-9)
    assert not fit.at_end[0]
    assert fit.offset[0] == 0.0
