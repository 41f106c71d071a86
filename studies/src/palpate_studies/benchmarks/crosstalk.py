"""Crosstalk solved out of a matrix whose idle lines float, compared with SciPy's solvers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.optimize

from palpate.arrays import FloatArray
from palpate.signal.crosstalk import floating_readings_ohm, unmix_floating
from palpate_studies.benchmarks.protocol import Measured, Ratio, side_by_side_s
from palpate_studies.benchmarks.running import command_of

SHAPES = ((4, 2), (4, 4), (8, 8))
SOLVE, ROOT = "scipy.linalg.solve", "scipy.optimize.root"


def measure(full: bool) -> Measured:
    """Solve frames of three sizes of matrix."""
    frames = 1000 if full else 100
    return Measured(
        ratios=[
            _compared(shape, peer, frames=frames) for shape in SHAPES for peer in (SOLVE, ROOT)
        ],
        notes=(
            "scipy.linalg.solve is the floor: one dense system of as many unknowns as pixels for "
            "each frame, of which Newton's method takes several, each with an inverse. "
            "scipy.optimize.root solves the same equations frame by frame, from the same start.",
        ),
    )


command = command_of("crosstalk")


def _compared(shape: tuple[int, int], peer: str, *, frames: int) -> Ratio:
    pixels = shape[0] * shape[1]
    rng = np.random.default_rng(0)
    ohm = np.exp(rng.uniform(np.log(2e3), np.log(5e4), (frames, *shape)))
    readings = floating_readings_ohm(ohm)
    systems = rng.normal(size=(frames, pixels, pixels)) + pixels * np.eye(pixels)
    some = readings if peer == SOLVE else readings[: max(1, 400 // pixels)]
    acts: dict[str, Callable[[], None]] = {
        SOLVE: lambda: _solve_each(systems, readings.reshape(frames, pixels)),
        ROOT: lambda: _root_each(some),
    }
    ours_s, theirs_s = side_by_side_s(lambda: unmix_floating(readings), acts[peer], repeats=3)
    return Ratio(
        what=f"{shape[0]} x {shape[1]} pixels, floating lines",
        size=frames,
        of="frames",
        peer=peer,
        ours=ours_s,
        theirs=theirs_s * frames / len(some),
        wanted=1.0 if peer == ROOT else None,
    )


def _solve_each(systems: FloatArray, readings: FloatArray) -> None:
    for system, reading in zip(systems, readings, strict=True):
        scipy.linalg.solve(system, reading)


def _root_each(readings: FloatArray) -> None:
    for frame in readings:
        wanted = np.log(frame)

        def mismatch(log_ohm: FloatArray, wanted: FloatArray = wanted) -> FloatArray:
            found = floating_readings_ohm(np.exp(log_ohm).reshape(wanted.shape))
            return np.asarray((np.log(found) - wanted).ravel())

        scipy.optimize.root(mismatch, wanted.ravel())
