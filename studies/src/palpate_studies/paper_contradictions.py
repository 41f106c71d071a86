"""Printed numbers of the paper that exclude each other, from what it prints alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from palpate_studies.table2 import PUBLISHED as TABLE2
from palpate_studies.table4 import PUBLISHED as TABLE4

#: Load cells of section 3.3: 1 kg.
LOAD_CELL_N = 9.8
#: Mean absolute value of a normal error over its sd.
_MEAN_ABS = math.sqrt(2 / math.pi)


def contradictions(
    *, error_n: Mapping[str, float], error_percent: Mapping[str, float]
) -> dict[str, Any]:
    """Return each as numbers, from both rows of Table 5 and Tables 2 and 4.

    `mean_force_n`: newtons over percent, smallest and largest; `largest_intercept_n`: no force on
    that line is smaller. `table2_force_n`: of Table 2's changes by Table 4's lines.
    `sd_of_force_n`: of all forces on a sheet, were the smallest error one against the load cell;
    the sd about a line is sqrt(1 - R^2) of that.

    Examples
    --------
    >>> found = contradictions(error_n={"20 s": 0.045}, error_percent={"20 s": 2.07})
    >>> {name: [round(end, 2) for end in ends.values()] for name, ends in found.items()
    ...  if isinstance(ends, dict)}
    {'mean_force_n': [2.17, 2.17], 'table2_force_n': [5.37, 13.46], 'sd_of_force_n': [0.2, 0.48]}
    """
    means_n = [100 * error_n[name] / percent for name, percent in error_percent.items()]
    forces_n = [
        slope * TABLE2[name][0] + intercept_n for name, (_, slope, intercept_n) in TABLE4.items()
    ]
    about_n = min(error_n.values()) / _MEAN_ABS
    return {
        "mean_force_n": _ends(means_n),
        "largest_intercept_n": max(intercept_n for _, _, intercept_n in TABLE4.values()),
        "table2_force_n": _ends(forces_n),
        "load_cell_n": LOAD_CELL_N,
        "sd_of_force_n": _ends([about_n / math.sqrt(1 - r2) for r2, _, _ in TABLE4.values()]),
    }


def _ends(values: list[float]) -> dict[str, float]:
    return {"low": min(values), "high": max(values)}
