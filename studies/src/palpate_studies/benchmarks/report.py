"""What a benchmark run prints: a table of each benchmark, or one JSON document."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy

from palpate_studies.benchmarks.protocol import Measured, Ratio
from palpate_studies.catalogue import BENCHMARKS
from palpate_studies.report import StudyReport, Table

COLUMNS = ("what", "size", "peer", "palpate", "peer's", "times as good", "wanted")


def report_of(measured: Mapping[str, Measured], *, full: bool) -> StudyReport:
    """Return what is printed."""
    titles = {name: BENCHMARKS[name][1] for name in measured}
    return StudyReport(
        name="bench",
        title="palpate next to its peers",
        provenance=[
            f"{machine()}.",
            "Processor time of this process, palpate and its peer taking turns; "
            "more than 1 is better than the peer.",
            *(f"{name}: {note}" for name, one in measured.items() for note in one.notes),
        ],
        tables=[
            Table(title=f"{name}: {titles[name]}", columns=COLUMNS, rows=[*map(row, one.ratios)])
            for name, one in measured.items()
        ],
        payload={
            "machine": machine(),
            "full": full,
            "benchmarks": [
                {
                    "name": name,
                    "what": titles[name],
                    "ratios": [ratio.to_dict() for ratio in one.ratios],
                    "notes": list(one.notes),
                }
                for name, one in measured.items()
            ],
        },
    )


def row(ratio: Ratio) -> tuple[str, ...]:
    """Return the cells of a table that people read."""
    return (
        ratio.what,
        sized(ratio),
        ratio.peer,
        _amount(ratio.ours, ratio.unit),
        "not installed" if ratio.theirs is None else _amount(ratio.theirs, ratio.unit),
        ratio.install if ratio.times is None else times(ratio.times),
        "" if ratio.wanted is None else times(ratio.wanted) + ", missed" * ratio.missed,
    )


def sized(ratio: Ratio) -> str:
    """Return the size of the work in words."""
    return f"{ratio.size:,} {ratio.of if ratio.size > 1 else ratio.of.removesuffix('s')}"


def times(ratio: float) -> str:
    """Return a ratio in three digits.

    Examples
    --------
    >>> times(0.08333), times(2412.3)
    ('0.0833', '2,412')
    """
    return f"{ratio:,.0f}" if ratio >= 1000 else f"{ratio:.3g}"


def _amount(amount: float, unit: str) -> str:
    if unit == "s" and amount < 1:
        return f"{1e3 * amount:.3g} ms" if amount >= 1e-3 else f"{1e6 * amount:.3g} µs"
    return f"{amount:.3g} {unit}"


def machine() -> str:
    """Return the processor and the versions that figures depend on."""
    cpu_info = Path("/proc/cpuinfo")
    lines = cpu_info.read_text().splitlines() if cpu_info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    cpu = names[0] if names else platform.processor() or platform.machine()
    return (
        f"{cpu}, {len(names) or '?'} cores; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    )
