"""Figure 4 of the paper: 2 500 cycles, and what re-zeroing and wear checks make of the drift."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate_studies.fatigue_cycles import (
    CHECK_GRASPS,
    CLOSED_S,
    KINDS,
    OPEN_S,
    PAUSE_S,
    ROOM_SWING_C,
    Wearing,
)
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, section 2.1.
CYCLES = 2500
#: After these cycles the station pauses, takes rest values, and reads the reference load (the same
#: object here).
CHECKED_AT = (100, 500, 1000, 2000)
#: The first of the sensors; the protocol was worked out on those before.
SENSORS, FIRST_SENSOR = 2, 20
#: Drift counts from the median of this many cycles: one contact scatters by a third at `field`.
BEGINNING = 30
#: Cycles whose running median is drawn.
_DRAWN = 51


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Wear simulated sheets over 2 500 grasps; re-zero, correct, and advise when to recalibrate.

    Example: palpate study fatigue --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(
    *, sensors: int = SENSORS, cycles: int = CYCLES, checked_at: Sequence[int] = CHECKED_AT
) -> StudyReport:
    """Wear every sensor and report the drift from the first cycle."""
    found = {
        level: [
            Wearing(sensor, level=level, cycles=cycles, checked_at=checked_at)
            for sensor in range(FIRST_SENSOR, FIRST_SENSOR + sensors)
        ]
        for level in LEVELS
    }
    return StudyReport(
        name="fatigue",
        title="Figure 4: 2 500 cycles of 10 s closed and 10 s open",
        provenance=_provenance(found, cycles, checked_at),
        tables=[
            Table(
                title="Drift from the first cycles on: median over sensors (worst sensor)",
                columns=("quantity", "cycles", *LEVELS),
                rows=_rows(found, cycles),
            )
        ],
        payload={
            "study": "fatigue",
            "origin": "twin",
            "cycles": cycles,
            "levels": {
                level: [
                    {
                        "advised_at": one.advised_at,
                        "rezeroed": one.rezeroed,
                        "rezeroed_in_pauses": one.rezeroed_in_pauses,
                        "resistance_ohm": one.ohm.tolist(),
                        "change_percent": one.change_percent.tolist(),
                        "force_n": dict(zip(KINDS, one.force_n.tolist(), strict=True)),
                        "true_n": one.true_n.tolist(),
                    }
                    for one in found[level]
                ]
                for level in LEVELS
            },
        },
        figures={"figure4": lambda: draw(found)},
    )


def _provenance(
    found: dict[str, list[Wearing]], cycles: int, checked_at: Sequence[int]
) -> list[str]:
    sensors, pauses = len(found["lab"]), sum(at < cycles for at in checked_at)

    def each(of: Callable[[Wearing], str]) -> str:
        return "; ".join(f"{level}: {', '.join(map(of, found[level]))}" for level in LEVELS)

    return [
        f"Simulated: {sensors} sensors per level, each of {cycles} cycles of {CLOSED_S:g} s closed "
        f"and {OPEN_S:g} s open worked through, in a room that swings by {ROOM_SWING_C:g} K. The "
        "paper prints no numbers in Figure 4; the twin's break-in and wear are plausible ranges, "
        "not measurements.",
        "Force: a power law calibrated on a load cell before the first cycle. Re-zeroing is "
        "`palpate_studies.rezero`, frame by frame, from the frames and the hand's width alone. It "
        f"waits until the sheet has forgotten its load, and {OPEN_S:g} s are too short for most: "
        f"of {cycles} openings it took rest values in "
        + each(lambda one: str(one.rezeroed))
        + f". So the station pauses for {PAUSE_S:g} s after cycles "
        f"{', '.join(map(str, checked_at))}, and re-zeroes then: taken in "
        + each(lambda one: f"{one.rezeroed_in_pauses} of {pauses}")
        + " pauses; what moved by more than a load might is left alone.",
        f"Wear correction: the same object as a reference load, {CHECK_GRASPS} grasps in the same "
        "rhythm before the first cycle and after each pause; between checks it runs behind. Read "
        "in grasps apart from each other, as the study did before, the reference corrected twice "
        "too much: a sheet that has just been loaded answers otherwise.",
        "Advised to recalibrate (reference load 10 % off) at cycle "
        + each(lambda one: "never" if one.advised_at is None else str(one.advised_at))
        + ".",
    ]


def _rows(found: dict[str, list[Wearing]], cycles: int) -> list[list[str]]:
    """Return the drift of each quantity early and late: the size of its median over cycles."""
    quantities: dict[str, Callable[[Wearing], FloatArray]] = {
        "absolute resistance, %": lambda one: 100 * _ratio(one.ohm)
    }
    for k, kind in enumerate(KINDS[:-1]):
        quantities[f"relative change, {kind}, points"] = partial(_drift_points, k)
    for k, kind in enumerate(KINDS):
        quantities[f"force, {kind}, %"] = partial(_force_drift_percent, k)
    middle = min(CHECKED_AT[1], cycles // 2)
    offset = _cells(found, _offset_percent, 0, BEGINNING)
    rows = [["measured force against the load cell, %", f"0 to {BEGINNING}", *offset]]
    for low, high in ((0, middle), (middle, cycles)):
        for name, of in quantities.items():
            rows.append([f"drift of {name}", f"{low} to {high}", *_cells(found, of, low, high)])
    return rows


def _cells(
    found: dict[str, list[Wearing]], of: Callable[[Wearing], FloatArray], low: int, high: int
) -> list[str]:
    """Return the size of a quantity's median over cycles: of the sensors the middle and worst."""
    cells = []
    for level in LEVELS:
        sizes = [float(abs(np.median(of(one)[low:high]))) for one in found[level]]
        cells.append(f"{np.median(sizes):.3g} ({max(sizes):.3g})")
    return cells


def _ratio(values: FloatArray) -> FloatArray:
    return np.asarray(values / np.median(values[:BEGINNING]) - 1)


def _offset_percent(one: Wearing) -> FloatArray:
    return np.asarray(100 * (one.force_n[0] / one.true_n - 1))


def _drift_points(kind: int, one: Wearing) -> FloatArray:
    values = one.change_percent[kind]
    return np.asarray(values - np.median(values[:BEGINNING]))


def _force_drift_percent(kind: int, one: Wearing) -> FloatArray:
    return 100 * _ratio(one.force_n[kind] / one.true_n)


def draw(found: dict[str, list[Wearing]]) -> Figure:
    """Draw resistance, relative change and force over cycles on the first sensor of each level."""
    from palpate.plots.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, new_figure

    colours, widths = (ORANGE, PURPLE, BLUE, GREEN), (3.0, 2.0, 1.2, 1.2)
    with new_figure(rows=2, columns=3, width_in=11.0, height_in=5.8) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            one = found[level][0]
            cycle = np.arange(one.true_n.size)
            row[0].plot(cycle, one.ohm, ".", color=GREY, ms=1, alpha=0.4)
            row[0].plot(cycle, _smooth(one.ohm), color=INK, lw=1.2)
            row[0].set(ylabel="resistance when closed (ohm)", title=f"simulated, {level}")
            for values, colour, lw in zip(
                one.change_percent, colours[:-1], widths[:-1], strict=True
            ):
                row[1].plot(cycle, _smooth(values), color=colour, lw=lw)
            row[1].set(ylabel="relative change (%)")
            row[2].plot(cycle, one.force_n[0], ".", color=GREY, ms=1, alpha=0.4)
            for values, colour, lw, name in zip(one.force_n, colours, widths, KINDS, strict=True):
                row[2].plot(cycle, _smooth(values), color=colour, lw=lw, label=name)
            row[2].plot(cycle, one.true_n, color=INK, lw=1.2, label="load cell")
            row[2].set(ylabel="force (N)", ylim=(0, 2 * np.median(one.true_n)))
            for axis in row:
                axis.set_xlabel("cycle")
        handles, labels = axes[0, 2].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _smooth(values: FloatArray) -> FloatArray:
    return np.asarray(median_filter(values, size=_DRAWN, mode="reflect"))
