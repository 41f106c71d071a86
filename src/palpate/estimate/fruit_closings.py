"""Recorded closings that ended in rupture: the files they come in, and what each curve tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.estimate.closing import ClosingCurve, ClosingState
from palpate.tables import read_table


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitClosing:
    """One recorded closing until rupture."""

    #: As in the file.
    grasp_id: str
    fruit: str
    #: Labelled rupture force.
    rupture_force_n: float
    #: Shape (n_states,). Force of the sample at which each state became known: never below the
    #: state's own.
    force_n: NDArray[np.float64]
    #: What was known, strictly before the force first reached the label.
    states: Sequence[ClosingState]
    #: Shape (n_samples, 2). Closure (mm) and force (N) as recorded, up to there.
    samples: NDArray[np.float64]


def read_closings(curves: Path, index: Path) -> list[FruitClosing]:
    """Read recorded closings and their labels.

    Parameters
    ----------
    curves : Path
        CSV with ``grasp_id,closure_mm,force_n``, the samples of each closing in their order.
    index : Path
        CSV with ``grasp_id,fruit,rupture_force_n``, a line for each closing.

    Raises
    ------
    InputError
        If a file can't be used, a closing is listed twice, or one has no curve.
    """
    labels = read_table(
        index, columns={"grasp_id": "text", "fruit": "text", "rupture_force_n": "number"}
    )
    samples = read_table(
        curves, columns={"grasp_id": "text", "closure_mm": "number", "force_n": "number"}
    )
    owner = samples["grasp_id"]
    starts = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    ends = np.append(starts[1:], len(owner))
    where = dict(zip(owner[starts], zip(starts, ends, strict=True), strict=True))
    if len(where) < len(starts):
        split = next(name for name in where if np.sum(owner[starts] == name) > 1)
        raise InputError(f"{curves}: the samples of {split} don't stand together; sort the file")
    closings: list[FruitClosing] = []
    for name, fruit, limit_n in zip(*labels.values(), strict=True):
        if any(name == closing.grasp_id for closing in closings):
            raise InputError(f"{index}: {name} is listed twice; remove one line")
        if name not in where:
            raise InputError(f"{curves}: no curve for {name}, which {index} lists")
        if not fruit.strip():
            raise InputError(f"{index}: {name} has no fruit; name its kind")
        if limit_n <= 0:
            raise InputError(
                f"{index}: rupture_force_n of {name} is {limit_n}; it must be positive"
            )
        part = slice(*where[name])
        closings.append(
            follow(
                name,
                fruit=fruit,
                rupture_force_n=float(limit_n),
                closure_mm=samples["closure_mm"][part],
                force_n=samples["force_n"][part],
            )
        )
    return closings


def follow(
    grasp_id: str,
    *,
    fruit: str,
    rupture_force_n: float,
    closure_mm: NDArray[np.float64],
    force_n: NDArray[np.float64],
) -> FruitClosing:
    """Follow a recorded closing sample by sample, up to its rupture."""
    curve = ClosingCurve()
    states: list[ClosingState] = []
    known_at_n: list[float] = []
    above = np.flatnonzero(force_n >= rupture_force_n)
    before = slice(above[0] if above.size else len(force_n))
    samples = np.column_stack([closure_mm[before], force_n[before]])
    for closure, force in samples.tolist():
        passed = curve.push(closure, force_n=force)
        states += passed
        known_at_n += [force] * len(passed)
    return FruitClosing(
        grasp_id=grasp_id,
        fruit=fruit,
        rupture_force_n=rupture_force_n,
        force_n=np.array(known_at_n),
        states=states,
        samples=samples,
    )


def copies(closings: Sequence[FruitClosing]) -> dict[str, str]:
    """Return which closings are the same recording as an earlier one, and of which.

    Two names for one fruit are no second fruit: learned from twice, or learned from and then tested
    on, it would make a model look better than it is.
    """
    first: dict[tuple[str, float, bytes], str] = {}
    found = {}
    for closing in closings:
        content = (closing.fruit, closing.rupture_force_n, closing.samples.tobytes())
        earlier = first.setdefault(content, closing.grasp_id)
        if earlier != closing.grasp_id:
            found[closing.grasp_id] = earlier
    return found
