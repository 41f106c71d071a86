"""Framework of the benchmarks: ratios to named peers, tables, JSON and commands.

A benchmark is a module with a function `measure(full)`, which returns ratios and notes, and a row
in `palpate_studies.catalogue`. `full` selects the full sizes.
"""

from __future__ import annotations

import importlib
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any, TypeAlias

import numpy as np
import scipy
import typer

from palpate.cli.options import JsonOption
from palpate_studies.catalogue import BENCHMARKS
from palpate_studies.report import OutOption, StudyReport, Table

#: Name that runs all benchmarks.
ALL = "all"
COLUMNS = ("task", "size", "peer", "palpate", "peer's time", "ratio", "required ratio")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """The same work done by palpate and a peer in one run; less is better."""

    #: Description, and amount of work.
    what: str
    size: int
    of: str
    peer: str
    #: Measured seconds; None if the peer is not installed.
    ours: float
    theirs: float | None
    unit: str = "s"
    #: Required ratio of the peer's time to palpate's; None without a requirement.
    wanted: float | None = None
    #: Command that installs the peer.
    install: str = ""

    @property
    def times(self) -> float | None:
        """Ratio of the peer's time to palpate's."""
        return None if self.theirs is None else self.theirs / self.ours

    @property
    def is_missed(self) -> bool:
        """Whether the ratio is below the required ratio."""
        return self.times is not None and self.wanted is not None and self.times < self.wanted


#: Ratios, and notes on simulation and scaling.
Measured: TypeAlias = tuple[Sequence[Ratio], Sequence[str]]


def side_by_side_s(*acts: Callable[[], object], repeats: int) -> list[float]:
    """Return the median processor time of each act, s.

    The acts take turns, so that a temporary load of the machine affects all of them.
    """
    taken: list[list[float]] = [[] for _ in acts]
    for _ in range(repeats):
        for act, times in zip(acts, taken, strict=True):
            started_s = time.process_time()
            act()
            times.append(time.process_time() - started_s)
    return [median(times) for times in taken]


def command_of(name: str) -> Callable[..., None]:
    """Return the command of one benchmark, or of `ALL`."""

    def command(
        full: Annotated[
            bool, typer.Option("--full/--quick", help="Full sizes: minutes, and 6 GB of memory.")
        ] = False,
        as_json: JsonOption = False,
        out: OutOption = None,
    ) -> None:
        names = [one for one in BENCHMARKS if one != ALL] if name == ALL else [name]
        measured = {one: importlib.import_module(BENCHMARKS[one][0]).measure(full) for one in names}
        build_report(measured, full=full).emit(as_json=as_json, out=out)
        if any(ratio.is_missed for ratios, _ in measured.values() for ratio in ratios):
            raise typer.Exit(1)

    command.__doc__ = f"""{BENCHMARKS[name][1]}.

    Each figure is a ratio to a named peer in the same run. The exit status is 1 if a required ratio
    is missed.

    Example: palpate bench {"" if name == ALL else name + " "}--json
    """
    return command


command = command_of(ALL)


class BenchReport(StudyReport):
    """Report of all benchmarks that ran."""

    @property
    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return dict(self.payload)


def build_report(measured: Mapping[str, Measured], *, full: bool) -> BenchReport:
    """Return the report with one table per benchmark."""
    return BenchReport(
        name="bench",
        title="palpate compared with its peers",
        provenance=[
            f"{machine()}.",
            "Processor time of this process, with palpate and its peer taking turns. "
            "A ratio above 1 is better than the peer.",
            *(f"{name}: {note}" for name, (_, notes) in measured.items() for note in notes),
        ],
        tables=[
            Table(title=f"{name}: {BENCHMARKS[name][1]}", columns=COLUMNS, rows=[*map(row, ratios)])
            for name, (ratios, _) in measured.items()
        ],
        payload={
            "machine": machine(),
            "full": full,
            "benchmarks": [
                {
                    "name": name,
                    "what": BENCHMARKS[name][1],
                    "ratios": [
                        asdict(one) | {"times": one.times, "missed": one.is_missed}
                        for one in ratios
                    ],
                    "notes": list(notes),
                }
                for name, (ratios, notes) in measured.items()
            ],
        },
    )


def row(ratio: Ratio) -> tuple[str, ...]:
    """Return the formatted table cells of a ratio."""
    return (
        ratio.what,
        f"{ratio.size:,} {ratio.of if ratio.size > 1 else ratio.of.removesuffix('s')}",
        ratio.peer,
        _seconds(ratio.ours),
        "not installed" if ratio.theirs is None else _seconds(ratio.theirs),
        ratio.install if ratio.times is None else _three_digits(ratio.times),
        "" if ratio.wanted is None else _three_digits(ratio.wanted) + ", missed" * ratio.is_missed,
    )


def _three_digits(ratio: float) -> str:
    """Format a ratio with three digits.

    Examples
    --------
    >>> _three_digits(0.08333), _three_digits(2412.3)
    ('0.0833', '2,412')
    """
    return f"{ratio:,.0f}" if ratio >= 1000 else f"{ratio:.3g}"


def _seconds(amount: float) -> str:
    if amount >= 1:
        return f"{amount:.3g} s"
    return f"{1e3 * amount:.3g} ms" if amount >= 1e-3 else f"{1e6 * amount:.3g} µs"


def machine() -> str:
    """Return the processor and the versions of Python and its libraries."""
    cpu_info = Path("/proc/cpuinfo")
    lines = cpu_info.read_text().splitlines() if cpu_info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    cpu = names[0] if names else platform.processor() or platform.machine()
    return (
        f"{cpu}, {len(names) or '?'} cores; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    )
