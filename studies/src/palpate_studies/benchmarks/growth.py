"""Batch predictions from a thousand holds up, compared with what no program can do without.

The floors are one matrix product (each hold's samples against every rate of a search), and reading
the samples once from memory.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from palpate.arrays import FloatArray
from palpate.settling.predict import predict_settled
from palpate.settling.result import SettledEstimate
from palpate_studies.benchmarks.protocol import Measured, Ratio, side_by_side_s
from palpate_studies.benchmarks.running import command_of
from palpate_studies.benchmarks.synthetic import CUTOFF_S, NOTE, synthetic_holds

#: Holds per call from which the wanted ratio applies, and that ratio: at most 12 matrix products.
LARGE, WANTED = 1_000_000, 1 / 12
_RATES, _BLOCK = 40, 4096


def measure(full: bool) -> Measured:
    """Time and weigh batches up to a million holds, ten million at full size."""
    sizes = [10**power for power in range(3, 8 if full else 7)]
    return Measured(
        ratios=[ratio for size in sizes for ratio in _of_size(size)],
        notes=(
            NOTE,
            f"The matrix product takes each hold's samples against {_RATES} rates, in blocks of "
            f"{_BLOCK} holds; reading is NumPy's sum over the same blocks.",
            "Memory is the peak beyond the input, compared with twice the result.",
        ),
    )


command = command_of("growth")


def _of_size(size: int) -> Iterator[Ratio]:
    time_s, holds = synthetic_holds(size)
    product, reading = _floors(holds)
    for method in ("exponential", "relaxation"):
        ours = partial(predict_settled, time_s, holds, cutoff_s=CUTOFF_S, method=method)
        wanted = WANTED if method == "exponential" and size >= LARGE else None
        ours_s, product_s, reading_s = side_by_side_s(
            ours, product, reading, repeats=1 if size >= LARGE else 5
        )
        for peer, theirs_s, least in (
            ("matrix product (BLAS)", product_s, wanted),
            ("reading the samples", reading_s, None),
        ):
            yield Ratio(
                what=method, size=size, of="holds", peer=peer, ours=ours_s, theirs=theirs_s,
                wanted=least,
            )  # fmt: skip
        yield _memory(method, size, ours)


def _memory(method: str, size: int, act: Callable[[], SettledEstimate]) -> Ratio:
    tracemalloc.start()
    found = act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    fields = ("value", "low", "high", "window_s", "status")
    result = sum(np.asarray(getattr(found, name)).nbytes for name in fields)
    return Ratio(
        what=f"{method}, memory",
        size=size,
        of="holds",
        peer="twice the result",
        ours=peak / 1e6,
        theirs=2 * result / 1e6,
        unit="MB",
        # A block's own 10 MB no longer count there.
        wanted=0.8 if size >= LARGE else None,
    )


def _floors(holds: FloatArray) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return what multiplies, and what reads, every block of the holds."""
    table = np.random.default_rng(0).normal(size=(holds.shape[1], _RATES))
    blocks = np.split(holds, range(_BLOCK, len(holds), _BLOCK))

    def multiply() -> None:
        for block in blocks:
            block @ table

    def read() -> None:
        for block in blocks:
            block.sum()

    return multiply, read
