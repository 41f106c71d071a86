"""How close a line from stiffness to rupture force comes if it is given what no guard can know."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.damage_learning import FruitClosing
from palpate_studies.report import Table


def told_half_load(
    splits: Sequence[tuple[Sequence[FruitClosing], Sequence[FruitClosing]]],
) -> list[dict[str, Any]]:
    """Return the mean error of a line per fruit, read just when half of the true limit is reached.

    A guard has to find that moment with its own prediction, which errs; here it is given away.

    Parameters
    ----------
    splits : sequence of (training, test)
        Closings to fit the lines on, and others to test them on.

    Returns
    -------
    list of dict
        Per fruit: `fruit`, `grasps` and `mean_abs_error_percent`.
    """
    errors: dict[str, list[float]] = {}
    for training, test in splits:
        for fruit in sorted({closing.fruit for closing in test}):
            known = _points([closing for closing in training if closing.fruit == fruit])
            asked = _points([closing for closing in test if closing.fruit == fruit])
            if len(known) < 2 or not len(asked):
                continue
            slope, offset = np.polyfit(known[:, 0], known[:, 1], 1)
            missed = np.abs(np.expm1(slope * asked[:, 0] + offset - asked[:, 1]))
            errors.setdefault(fruit, []).extend(missed.tolist())
    return [
        {
            "fruit": fruit,
            "grasps": len(found),
            "mean_abs_error_percent": 100 * float(np.mean(found)),
        }
        for fruit, found in sorted(errors.items())
    ]


def _points(closings: Sequence[FruitClosing]) -> NDArray[np.float64]:
    """Return log stiffness at half load with the log of the rupture force, shape (n, 2)."""
    points = []
    for closing in closings:
        upto = [s for s in closing.states if s.force_n <= closing.rupture_force_n / 2]
        if upto:
            points.append((upto[-1].log_stiffness, np.log(closing.rupture_force_n)))
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def table(entries: Sequence[dict[str, Any]]) -> Table:
    """Return the table of `told_half_load`."""
    return Table(
        title="What limits the prediction: a line per fruit given the true half load",
        columns=("fruit", "grasps", "mean error, %"),
        rows=[
            (entry["fruit"], str(entry["grasps"]), f"{entry['mean_abs_error_percent']:.1f}")
            for entry in entries
        ],
    )
