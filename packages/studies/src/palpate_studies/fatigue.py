"""Figure 4 of the paper: drift of resistance and force over 2 500 cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from palpate.arrays import FloatArray
from palpate.force.power_law import PowerForceLaw
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import mean_change
from palpate.twin.velostat import Environment
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import SETTLED_MEAN_S, Session, draw_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, section 2.1: cycles of 10 s closed and 10 s open.
CYCLES, CLOSED_S, OPEN_S = 2500, 10.0, 10.0
SENSORS, FIRST_SENSOR = 2, 20
OBJECT, CLOSURE_MM, OPENED_MM = "springs-8", 3.0, 12.0
#: Mean room temperature, and amplitude and period of its swing: guesses for a laboratory.
ROOM_C, ROOM_SWING_C, ROOM_PERIOD_S = 21.9, 1.5, 12 * 3600.0
#: Closures of the force calibration before the first cycle, mm, and repeats of each.
CALIBRATED_MM, CALIBRATED_TIMES = (0.8, 1.2, 1.7, 2.3, 3.0, 3.8), 3
#: The drift's reference is the median of this many first cycles, because a single contact scatters
#: by a third at `field`; and the end of the break-in, cycles.
BEGINNING, BREAK_IN = 30, 500
#: Window of the running median in the figure, cycles.
_DRAWN = 51


@dataclass(frozen=True, slots=True, kw_only=True)
class WearRun:
    """Readings of one sensor in each cycle; arrays of shape (cycles,)."""

    ohm: FloatArray
    change_percent: FloatArray
    force_n: FloatArray
    true_n: FloatArray


def report(*, sensors: int = SENSORS, cycles: int = CYCLES) -> StudyReport:
    """Run simulated sheets through 2 500 grasps and report the drift of their readings.

    Example: palpate study fatigue --out reports
    """
    found = {
        level: [
            run_cycles(sensor, level=level, cycles=cycles)
            for sensor in range(FIRST_SENSOR, FIRST_SENSOR + sensors)
        ]
        for level in LEVELS
    }
    return StudyReport(
        name="fatigue",
        title="Figure 4: 2 500 cycles of 10 s closed and 10 s open",
        provenance=[
            f"Simulated: {sensors} sensors per level, {cycles} cycles of {CLOSED_S:g} s closed "
            f"and {OPEN_S:g} s open, room temperature swinging by {ROOM_SWING_C:g} K. The paper "
            "prints no numbers in Figure 4; the twin's break-in and wear are plausible ranges, not "
            "measurements.",
            "Force: power law calibrated with a load cell before the first cycle, with the rest "
            "values of that calibration.",
        ],
        tables=[
            Table.of(
                "Drift relative to the first cycles: |median over cycles|, median sensor",
                [
                    {"quantity": name, "cycles": f"{low} to {high}"}
                    | {
                        level: float(
                            np.median([abs(np.median(of(one)[low:high])) for one in found[level]])
                        )
                        for level in LEVELS
                    }
                    for low, high in pairwise((0, min(BREAK_IN, cycles // 2), cycles))
                    for name, of in QUANTITIES.items()
                ],
            )
        ],
        payload={
            "origin": "twin",
            "cycles": cycles,
            "levels": {
                level: [
                    {name: getattr(one, name).tolist() for name in WearRun.__slots__}
                    for one in found[level]
                ]
                for level in LEVELS
            },
        },
        figures={"figure4": lambda: draw(found)},
    )


command = as_command(report)


def run_cycles(sensor: int, *, level: str, cycles: int) -> WearRun:
    """Calibrate a sensor, then close repeatedly on one object and open again."""
    obj, session = draw_named(OBJECT), Session(sensor, level=level)
    session.place(obj)
    clock, closings = session.world.clock, 0

    def surround() -> None:
        """Set the current room temperature and wear, and count one more closing."""
        nonlocal closings
        swing_c = ROOM_SWING_C * float(np.sin(2 * np.pi * clock.now_s() / ROOM_PERIOD_S))
        session.world.set_environment(
            Environment(temperature_c=ROOM_C + swing_c, cycles=closings, cycles_are_all=True)
        )
        closings += 1

    readings = []
    for closure_mm in CALIBRATED_MM * CALIBRATED_TIMES:
        surround()
        width_mm = obj.size_mm - closure_mm
        readings.append(session.grasp(obj.size_mm, width_mm=width_mm, hold_s=CLOSED_S))
    law = PowerForceLaw.fit([r.excess for r in readings], force_n=[r.force_n for r in readings])
    reader, rows = SampleReader(session.world.layout, session.mean_ohm()), []
    for _ in range(cycles):
        surround()
        session.close_to(obj.size_mm - CLOSURE_MM)
        clock.sleep_s(CLOSED_S - SETTLED_MEAN_S)
        ohm = session.mean_ohm()
        pixels = reader.read_ohm(ohm)
        excess = float(np.nansum(pixels.excess))
        change = mean_change(pixels.change_percent)
        force_n = law.force_n(excess).value
        rows.append((ohm.mean(), float(change), float(force_n), session.cell.read_n()))
        session.close_to(obj.size_mm + OPENED_MM)
        clock.sleep_s(OPEN_S)
    ohms, changes, forces_n, true_n = np.array(rows).T
    return WearRun(ohm=ohms, change_percent=changes, force_n=forces_n, true_n=true_n)


def _drift_percent(values: FloatArray) -> FloatArray:
    return np.asarray(100 * (values / np.median(values[:BEGINNING]) - 1))


QUANTITIES: dict[str, Callable[[WearRun], FloatArray]] = {
    "drift of absolute resistance, %": lambda one: _drift_percent(one.ohm),
    "drift of relative change, points": lambda one: (
        one.change_percent - np.median(one.change_percent[:BEGINNING])
    ),
    "drift of force, %": lambda one: _drift_percent(one.force_n / one.true_n),
}


def draw(found: dict[str, list[WearRun]]) -> Figure:
    """Draw resistance, relative change and force over cycles, first sensor of each level."""
    from palpate.plots.style import BLUE, GREY, INK, new_figure

    with new_figure(rows=2, columns=3, width_in=11.0, height_in=5.8) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            one = found[level][0]
            cycle = np.arange(one.true_n.size)
            for axis, values, label in (
                (row[0], one.ohm, "resistance when closed (ohm)"),
                (row[1], one.change_percent, "relative change (%)"),
                (row[2], one.force_n, "force (N)"),
            ):
                axis.plot(cycle, values, ".", color=GREY, ms=1, alpha=0.4)
                smooth = median_filter(values, size=_DRAWN, mode="reflect")
                axis.plot(cycle, smooth, color=BLUE, lw=1.2, label="sheet")
                axis.set(xlabel="cycle", ylabel=label, title=f"simulated, {level}")
            row[2].plot(cycle, one.true_n, color=INK, lw=1.2, label="load cell")
            row[2].set(ylim=(0, 2 * np.median(one.true_n)))
        axes[0, 2].legend()
    return figure
