"""Crosstalk model and correction, compared with an independent circuit solver."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.held_readings import held_readings_ohm

from palpate.signal.crosstalk import floating_readings_ohm, unmix_floating, unmix_held

Resistor = tuple[str, str, float]
SHAPES = [(1, 4), (3, 1), (2, 2), (4, 2), (6, 2), (5, 7), (16, 16)]


def node_voltages(resistors: list[Resistor], sources_v: dict[str, float]) -> dict[str, float]:
    """Solve a resistor circuit with Kirchhoff's current law, one equation per node."""
    nodes = sorted({node for first, second, _ in resistors for node in (first, second)})
    place = {node: k for k, node in enumerate(nodes)}
    equations = np.zeros((len(nodes), len(nodes)))
    known = np.zeros(len(nodes))
    for first, second, ohm in resistors:
        for a, b in ((first, second), (second, first)):
            equations[place[a], place[a]] += 1 / ohm
            equations[place[a], place[b]] -= 1 / ohm
    for node, volt in sources_v.items():
        equations[place[node]] = 0.0
        equations[place[node], place[node]] = 1.0
        known[place[node]] = volt
    return dict(zip(nodes, np.linalg.solve(equations, known), strict=True))


def divider_reading_ohm(
    matrix: NDArray[np.float64], row: int, col: int, *, reference_ohm: float, held: bool
) -> float:
    """Return the reading of one pixel: 5 V on its row, divider on its column."""
    resistors = [
        (f"row{i}", f"col{j}", float(matrix[i, j]))
        for i in range(matrix.shape[0])
        for j in range(matrix.shape[1])
    ]
    resistors.append((f"col{col}", "ground", reference_ohm))
    sources = {"ground": 0.0, f"row{row}": 5.0}
    if held:
        sources |= {f"row{i}": 0.0 for i in range(matrix.shape[0]) if i != row}
    adc_v = node_voltages(resistors, sources)[f"col{col}"]
    return reference_ohm * (5.0 / adc_v - 1.0)


def random_pixels(shape: tuple[int, ...], *, seed: int = 7) -> NDArray[np.float64]:
    return 2000.0 * np.exp(np.random.default_rng(seed).normal(0, 1.0, shape))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("held", [False, True])
def test_crosstalk_readings_agree_with_a_generic_circuit_solver(
    shape: tuple[int, int], held: bool
) -> None:
    pixels = random_pixels(shape)
    if held:
        readings = held_readings_ohm(pixels, reference_ohm=4700.0)
    else:
        readings = floating_readings_ohm(pixels)
    rng = np.random.default_rng(1)
    for flat in rng.permutation(pixels.size)[:8]:
        row, col = divmod(int(flat), shape[1])
        circuit = divider_reading_ohm(pixels, row, col, reference_ohm=4700.0, held=held)
        assert readings[row, col] == pytest.approx(circuit, rel=1e-9)


@pytest.mark.parametrize("idle", ["low", "input"])
def test_unmix_held_describes_pull_downs_if_idle_driven_lines_are_low(idle: str) -> None:
    """A pull-down at each sense line, and lines driven high in turn, without a multiplexer.

    The driven lines are the rows of the layout. If idle lines are inputs, current passes through
    them from one sense line to another, and no correction fits.
    """
    pixels = random_pixels((4, 3))
    readings = np.empty_like(pixels)
    matrix = [(f"drive{i}", f"sense{j}", float(pixels[i, j])) for i, j in np.ndindex(pixels.shape)]
    pull_downs = [(f"sense{j}", "ground", 10e3) for j in range(3)]
    for active in range(4):
        sources = {"ground": 0.0, f"drive{active}": 5.0}
        if idle == "low":
            sources |= {f"drive{i}": 0.0 for i in range(4) if i != active}
        volts = node_voltages(matrix + pull_downs, sources)
        readings[active] = [10e3 * (5.0 / volts[f"sense{j}"] - 1.0) for j in range(3)]
    found = unmix_held(readings, reference_ohm=10e3)
    if idle == "low":
        assert found == pytest.approx(pixels, rel=1e-9)
        return
    assert np.isnan(found).all()
    for wrong in (readings, unmix_floating(readings)):
        assert np.abs(wrong / pixels - 1.0).max() > 0.4


@pytest.mark.parametrize("shape", SHAPES)
def test_unmixing_recovers_the_pixel_resistances(shape: tuple[int, int]) -> None:
    pixels = random_pixels((3, *shape))
    floating = unmix_floating(floating_readings_ohm(pixels))
    assert floating == pytest.approx(pixels, rel=1e-5)
    assert unmix_floating(floating_readings_ohm(pixels[1])) == pytest.approx(floating[1])
    held = unmix_held(held_readings_ohm(pixels, reference_ohm=900.0), reference_ohm=900.0)
    assert held == pytest.approx(pixels, rel=1e-9)


@pytest.mark.parametrize(
    ("shape", "bad", "ohm", "factor"),
    [
        ((2, 2), (0, 1), np.inf, 1.0),
        ((2, 2), (0, 1), np.inf, 1.02),
        ((4, 2), (3,), np.inf, 1.0),
        ((4, 2), (1, 1), 0.0, 1.0),
    ],
    ids=["open", "open, noisy", "dead row", "short"],
)
def test_unmix_floating_names_bad_pixels_and_solves_the_others(
    shape: tuple[int, int], bad: tuple[int, ...], ohm: float, factor: float
) -> None:
    pixels = random_pixels(shape)
    pixels[bad] = ohm or 1e-9
    readings = floating_readings_ohm(pixels)
    # Parallel paths hide an open pixel of a line that has others.
    assert np.isinf(readings[bad]).all() == (len(bad) == 1)
    readings[bad] *= factor if ohm else 0.0
    unmixed = unmix_floating(readings)
    assert (unmixed[bad] == ohm).all()
    others = np.ones(shape, dtype=bool)
    others[bad] = False
    assert unmixed[others] == pytest.approx(pixels[others], rel=0.01)
