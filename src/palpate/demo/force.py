"""Example readings with known loads: a simulated pad under a press, and under weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.files import atomic_path
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts

_SIMULATED = "simulated: a power law that creeps, with noise; no sensor was read"
#: Converter of the example: an Arduino with 10 kilohm.
_DIVIDER = Divider(reference_ohm=10e3)
_REST_OHM, _EXPONENT, _EXCESS_PER_N = 60e3, 0.9, 5.0
#: Creep: fraction and time constant, seconds. Noise of the logarithm of the reading and of the load
#: cell, newtons.
_CREEP, _TAU_S, _NOISE, _CELL_NOISE_N = 0.15, 2.0, 0.01, 0.02
_INTERVAL_S, _GRAM_N = 0.05, 0.00980665
_WEIGHTS_G = np.array([0.0, 100.0, 200.0, 500.0, 800.0, 1000.0])
_PRESSES_N = (2.0, 6.0, 3.0, 9.0, 4.0, 7.0, 1.5, 8.0)


def write_force(folder: Path) -> list[Path]:
    """Write readings of one simulated pad, with and without known loads.

    `folder`: created if absent.
    Writes `weights.csv`: settled counts under weights in grams. `presses.csv`: milliseconds, counts
    and the newtons of a load cell during presses. `log.csv` and `laid.csv`: a log while weights lay
    on the pad, and the weights in order. `new.csv`: a press of unknown force.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    laid_g = _WEIGHTS_G[1:]
    time_s, load_n = _press(_PRESSES_N)
    log_s, log_n = _press((_GRAM_N * laid_g).tolist(), hold_s=8.0)
    new_s, new_n = _press([5.0])
    cell_n = load_n + rng.normal(0.0, _CELL_NOISE_N, load_n.size)
    tables = {
        "weights.csv": ("weight_g,A0", [_WEIGHTS_G, _count(_excess(_GRAM_N * _WEIGHTS_G), rng)]),
        "presses.csv": ("ms,A0,force_n", [1e3 * time_s, _count(_follow(load_n), rng), cell_n]),
        "log.csv": ("ms,A0", [1e3 * log_s, _count(_follow(log_n), rng)]),
        "laid.csv": ("weight_g", [laid_g]),
        "new.csv": ("ms,A0", [1e3 * new_s, _count(_follow(new_n), rng)]),
    }
    for name, (head, columns) in tables.items():
        with atomic_path(folder / name) as temporary:
            np.savetxt(
                temporary,
                np.column_stack(columns),
                fmt="%.5g",
                delimiter=",",
                header=f"# {_SIMULATED}\n{head}",
                comments="",
            )
    return [folder / name for name in tables]


def _excess(load_n: FloatArray) -> FloatArray:
    """Return the settled excess conductance under a load."""
    return np.asarray(_EXCESS_PER_N * load_n**_EXPONENT)


def _press(peaks_n: Sequence[float], *, hold_s: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Return times and loads of presses: 3 s of rest, 0.3 s up, held, 0.3 s down."""
    times, loads, now_s = [0.0], [0.0], 0.0
    for peak_n in peaks_n:
        for after_s, load_n in ((3.0, 0.0), (0.3, peak_n), (hold_s, peak_n), (0.3, 0.0)):
            now_s += after_s
            times.append(now_s)
            loads.append(load_n)
    time_s = np.arange(0.0, now_s + 1.0, _INTERVAL_S)
    return time_s, np.interp(time_s, times, loads)


def _follow(load_n: FloatArray) -> FloatArray:
    """Return the excess of a sheet that follows a load, and creeps by a fraction."""
    settled = _excess(load_n)
    found, slow = np.empty_like(settled), float(settled[0])
    for at, now in enumerate(settled.tolist()):
        slow += (now - slow) * -float(np.expm1(-_INTERVAL_S / _TAU_S))
        found[at] = (1.0 - _CREEP) * now + _CREEP * slow
    return found


def _count(excess: FloatArray, rng: np.random.Generator) -> FloatArray:
    ohm = _REST_OHM / (1.0 + excess) * np.exp(rng.normal(0.0, _NOISE, excess.size))
    return volts_to_counts(ohm_to_volts(ohm, divider=_DIVIDER), divider=_DIVIDER).astype(float)
