"""How the time and memory of a prediction grow with the number of holds, and what is the floor."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.settling.predict import predict_settled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METHODS = ("exponential", "relaxation")
#: What no batch prediction can do without: each hold's samples against every rate of the search,
#: and, lower still, reading the samples once.
FLOORS = ("matrix product", "reading the samples")
_RATES, _BLOCK = 40, 4096

Holds = Callable[[int], tuple[FloatArray, FloatArray]]


def growth(sizes: Sequence[int], *, holds: Holds, cutoff_s: float) -> list[dict[str, Any]]:
    """Time predictions and floors at each size, and take the memory beyond the input.

    Parameters
    ----------
    sizes : sequence of int
        Holds per call.
    holds : callable
        Takes their number, returns times (n_times,) and values (n_holds, n_times).
    cutoff_s : float
        As of `predict_settled`.
    """
    rows = []
    for size in sizes:
        time_s, values = holds(size)
        for method in METHODS:
            started_s = time.process_time()
            found = predict_settled(time_s, values, cutoff_s=cutoff_s, method=method)
            seconds = time.process_time() - started_s
            result = sum(
                np.asarray(getattr(found, name)).nbytes
                for name in ("value", "low", "high", "window_s", "status")
            )
            del found
            tracemalloc.start()
            predict_settled(time_s, values, cutoff_s=cutoff_s, method=method)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            rows.append(_row(method, size, seconds, peak_mb=peak / 1e6, result_mb=result / 1e6))
        rows += [_row(name, size, seconds) for name, seconds in _floors(values)]
    return rows


def _row(
    name: str,
    holds: int,
    seconds: float,
    *,
    peak_mb: float | None = None,
    result_mb: float | None = None,
) -> dict[str, Any]:
    return {
        "method": name,
        "holds": holds,
        "seconds": seconds,
        "peak_beyond_input_mb": peak_mb,
        "result_mb": result_mb,
    }


def _floors(values: FloatArray) -> list[tuple[str, float]]:
    table = np.random.default_rng(0).normal(size=(values.shape[1], _RATES))
    blocks = np.split(values, range(_BLOCK, len(values), _BLOCK))
    taken = []
    for act in (lambda block: block @ table, np.sum):
        started_s = time.process_time()
        for block in blocks:
            act(block)
        taken.append(time.process_time() - started_s)
    return list(zip(FLOORS, taken, strict=True))


def draw(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw time and memory over the number of holds."""
    from palpate.plots.style import INK, look_of, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        left, right = axes[0]
        for name in METHODS:
            some = [row for row in rows if row["method"] == name]
            sizes = [row["holds"] for row in some]
            look = dict(zip(("color", "marker"), look_of(name), strict=True))
            left.plot(sizes, [row["seconds"] for row in some], label=name, **look)
            beyond = [row["peak_beyond_input_mb"] for row in some]
            right.plot(sizes, beyond, label=f"{name}, beyond the input", **look)
        right.plot(sizes, [row["result_mb"] for row in some], color=INK, ls=":", label="result")
        for name, dashes in zip(FLOORS, ("--", ":"), strict=True):
            some = [row for row in rows if row["method"] == name]
            left.plot(sizes, [row["seconds"] for row in some], color=INK, ls=dashes, label=name)
        left.set(ylabel="processor time (s)")
        right.set(ylabel="memory (MB)")
        for axis in (left, right):
            axis.set(xscale="log", yscale="log", xlabel="holds")
            axis.legend()
    return figure
