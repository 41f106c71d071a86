"""Run batches of work on all processors."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

Batch = TypeVar("Batch")
Result = TypeVar("Result")

#: Fewest batches that justify new processes, each of which needs two seconds for its imports.
_FEWEST_BATCHES = 12


def map_batches(
    work: Callable[[Batch], Iterable[Result]],
    batches: Sequence[Batch],
    *,
    jobs: int | None = None,
) -> list[Result]:
    """Return the results of all batches in order; `work` must be a module-level function.

    `jobs`: number of processes; by default one for each processor, and for few batches this one.

    >>> map_batches(range, [2, 3])
    [0, 1, 0, 1, 2]
    """
    processes = jobs or (os.cpu_count() or 1 if len(batches) >= _FEWEST_BATCHES else 1)
    if processes == 1:
        return [result for batch in batches for result in work(batch)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        return [result for results in pool.map(work, batches) for result in results]
