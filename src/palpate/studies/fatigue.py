"""Figure 4 of the paper: 2 500 cycles, and what re-zeroing and wear checks make of the drift."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from palpate.estimate.force import PowerForceLaw
from palpate.gripper.interface import GripperState
from palpate.sensor.rezero import RezeroRule, RezeroState, rezero_step
from palpate.sensor.wear import WearTrack
from palpate.settling.result import FloatArray
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import excess_conductance, mean_change, relative_change_percent
from palpate.studies.equal_width import SEED
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table
from palpate.studies.twin_session import LEVELS, SETTLED_MEAN_S, Reading, Session, drawn
from palpate.twin.devices import TwinArray
from palpate.twin.velostat import Environment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Paper, section 2.1: 2 500 cycles of 10 s closed and 10 s open.
CYCLES, CLOSED_S, OPEN_S = 2500, 10.0, 10.0
#: After these cycles the station pauses: rest values are taken, and the reference load is read
#: again (the same grasp here).
CHECKED_AT = (100, 500, 1000, 2000)
CHECK_GRASPS, PAUSE_S, LOOK_S = 8, 60.0, 5.0
SENSORS, OBJECT, CLOSURE_MM, OPENED_MM = 4, "springs-8", 3.0, 12.0
#: The room swings by so much over a period, as a laboratory's does.
ROOM_C, ROOM_SWING_C, ROOM_PERIOD_S = 21.9, 1.5, 12 * 3600.0
#: Closures at which the force law is calibrated before the first cycle.
CALIBRATED_MM = (0.8, 1.2, 1.7, 2.3, 3.0, 3.8)
CALIBRATED_TIMES = 3
#: A closing is watched for so long: where contact began is seen then.
CLOSING_S = 0.5
KINDS = (
    "rest of the calibration",
    "re-zeroed in the rhythm",
    "re-zeroed in pauses",
    "re-zeroed in pauses, wear corrected",
)


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Wear simulated sheets over 2 500 grasps; re-zero, correct, and say when to recalibrate.

    Example: palpate study fatigue --out reports
    """
    report().emit(as_json=as_json, out=out)


#: A frame's resistances, shape (rows, cols), and the hand at that time.
Seen: TypeAlias = tuple[FloatArray, GripperState]


class Wearing:
    """One sensor through its cycles, every one of them as the hand makes it.

    Arrays are filled cycle by cycle; the first is the first after the calibration.
    """

    def __init__(self, sensor: int, *, level: str, cycles: int, checked_at: Sequence[int]) -> None:
        self.ohm = np.empty(cycles)
        self.change_percent = np.empty((len(KINDS) - 1, cycles))
        self.force_n = np.empty((len(KINDS), cycles))
        self.true_n = np.empty(cycles)
        #: Openings in the rhythm, and pauses, in which rest values were taken.
        self.rezeroed = self.rezeroed_in_pauses = 0
        self.advised_at: int | None = None
        self._closings, self._checked_at = 0, checked_at
        self._obj = drawn(OBJECT, seed=SEED)
        self._session = Session(sensor, level=level)
        self._session.place(self._obj)
        self._law = self._calibrate()
        self._calibrated_ohm = self._session.mean_ohm()
        self._rule = RezeroRule()
        self._rhythm = self._pauses = RezeroState.calibrated(self._calibrated_ohm)
        self._track = WearTrack.started(cycles=0, excess=self._checked_excess())
        for cycle in range(cycles):
            self._cycle(cycle)

    def _calibrate(self) -> PowerForceLaw:
        made = [self._reference(mm) for mm in CALIBRATED_MM * CALIBRATED_TIMES]
        return PowerForceLaw.fit([r.excess for r in made], force_n=[r.force_n for r in made])

    def _reference(self, closure_mm: float) -> Reading:
        self._surround()
        size_mm = self._obj.size_mm
        return self._session.grasp(size_mm, width_mm=size_mm - closure_mm, hold_s=CLOSED_S)

    def _checked_excess(self) -> float:
        """Read the reference load: the mean of several grasps, each with its own rest values."""
        read = [self._reference(CLOSURE_MM).excess for _ in range(CHECK_GRASPS)]
        return float(np.exp(np.mean(np.log(read))))

    def _surround(self) -> None:
        """Let the room be what it is by now, and count one closing more."""
        world = self._session.world
        phase = 2 * np.pi * world.clock.now_s() / ROOM_PERIOD_S
        world.surround(
            Environment(
                temperature_c=ROOM_C + ROOM_SWING_C * float(np.sin(phase)),
                cycles=self._closings,
                cycles_are_all=True,
            )
        )
        self._closings += 1

    def _cycle(self, cycle: int) -> None:
        session, clock = self._session, self._session.world.clock
        if cycle in self._checked_at:
            self._pause(cycle)
        self._surround()
        session.close_to(self._obj.size_mm - CLOSURE_MM)
        seen = self._watch(CLOSING_S)
        self._rhythm, self._pauses = self._fed(self._rhythm, seen), self._fed(self._pauses, seen)
        clock.sleep_s(CLOSED_S - CLOSING_S - SETTLED_MEAN_S)
        self._score(cycle, session.mean_ohm(), session.cell.read_n())
        session.close_to(self._obj.size_mm + OPENED_MM)
        before = self._rhythm.rest_ohm
        self._rhythm = self._fed(self._rhythm, self._watch(OPEN_S))
        self.rezeroed += self._rhythm.rest_ohm is not before

    def _pause(self, cycle: int) -> None:
        """Wait until the sheet has forgotten most of its load, re-zero, read the reference load."""
        self._session.world.clock.sleep_s(PAUSE_S)
        before = self._pauses.rest_ohm
        self._pauses = self._fed(self._pauses, self._watch(LOOK_S))
        self.rezeroed_in_pauses += self._pauses.rest_ohm is not before
        self._track = self._track.checked(cycles=cycle, excess=self._checked_excess())

    def _watch(self, duration_s: float) -> list[Seen]:
        """Read frames, each with the hand's state."""
        session = self._session
        array, counts, hands = TwinArray(session.world), [], []
        for _ in range(int(duration_s * session.world.frame_rate_hz)):
            counts.append(array.read(timeout_s=1.0).counts)
            hands.append(session.gripper.state())
        array.close()
        ohm = resistance_ohm(np.stack(counts), divider=session.world.layout.divider)
        return list(zip(ohm, hands, strict=True))

    def _fed(self, state: RezeroState, seen: list[Seen]) -> RezeroState:
        for ohm, hand in seen:
            state = rezero_step(
                state,
                ohm,
                time_s=hand.time_s,
                width_mm=hand.width_mm,
                moving=hand.moving,
                rule=self._rule,
            )
        return state

    def _score(self, cycle: int, ohm: FloatArray, force_n: float) -> None:
        rests = (self._calibrated_ohm, self._rhythm.rest_ohm, self._pauses.rest_ohm)
        excess = [float(np.nansum(excess_conductance(ohm, rest_ohm=rest))) for rest in rests]
        if self.advised_at is None and "calibrate" in self._track.advice(cycles=cycle):
            self.advised_at = cycle
        mended = self._track.corrected(excess[-1], cycles=cycle)
        self.force_n[:, cycle] = self._law.force_n([*excess, mended]).value
        self.true_n[cycle] = force_n
        self.ohm[cycle] = ohm.mean()
        self.change_percent[:, cycle] = [
            float(mean_change(relative_change_percent(ohm, rest_ohm=rest))) for rest in rests
        ]


def report(
    *, sensors: int = SENSORS, cycles: int = CYCLES, checked_at: Sequence[int] = CHECKED_AT
) -> StudyReport:
    """Wear every sensor and report the drift from the first cycle."""
    found = {
        level: [
            Wearing(sensor, level=level, cycles=cycles, checked_at=checked_at)
            for sensor in range(sensors)
        ]
        for level in LEVELS
    }
    return StudyReport(
        name="fatigue",
        title="Figure 4: 2 500 cycles of 10 s closed and 10 s open",
        provenance=_provenance(found, cycles, checked_at),
        tables=[
            Table(
                title="Drift, and error of force: median over sensors (worst sensor)",
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
    sensors, pauses = len(found["paper"]), sum(at < cycles for at in checked_at)

    def each(of: Callable[[Wearing], str]) -> str:
        return "; ".join(f"{level}: {', '.join(map(of, found[level]))}" for level in LEVELS)

    return [
        f"Simulated: {sensors} sensors per level, each of {cycles} cycles of {CLOSED_S:g} s closed "
        f"and {OPEN_S:g} s open worked through, in a room that swings by {ROOM_SWING_C:g} K. The "
        "paper prints no numbers in Figure 4; the twin's break-in and wear are plausible ranges, "
        "not measurements.",
        "Force: a power law calibrated on a load cell before the first cycle. Re-zeroing is "
        "`palpate.sensor.rezero`, frame by frame, from the frames and the hand's width alone. It "
        f"waits until the sheet has forgotten its load, and {OPEN_S:g} s are too short for most: "
        f"of {cycles} openings it took rest values in "
        + each(lambda one: str(one.rezeroed))
        + f". So the station pauses for {PAUSE_S:g} s after cycles "
        f"{', '.join(map(str, checked_at))}, and re-zeroes then: taken in "
        + each(lambda one: f"{one.rezeroed_in_pauses} of {pauses}")
        + " pauses; what moved by more than a load might is left alone.",
        f"Wear correction: the same object as a reference load, {CHECK_GRASPS} grasps before the "
        "first cycle and after each pause; between checks it runs behind. With one grasp per check "
        "it made `field` worse in an earlier form of this study.",
        "Advised to recalibrate (reference load 10 % off) at cycle "
        + each(lambda one: "never" if one.advised_at is None else str(one.advised_at))
        + ".",
    ]


def _rows(found: dict[str, list[Wearing]], cycles: int) -> list[list[str]]:
    """Return the drift of each quantity early and late: the size of its median over cycles."""
    quantities: dict[str, Callable[[Wearing], FloatArray]] = {
        "absolute resistance, %": lambda one: 100 * (one.ohm / one.ohm[0] - 1)
    }
    for k, kind in enumerate(KINDS[:-1]):
        quantities[f"relative change, {kind}, points"] = partial(_drift_points, k)
    for k, kind in enumerate(KINDS):
        quantities[f"force error, {kind}, %"] = partial(_force_error_percent, k)
    middle = min(CHECKED_AT[1], cycles // 2)
    rows = []
    for low, high in ((1, middle), (middle, cycles)):
        for name, of in quantities.items():
            cells = []
            for level in LEVELS:
                drift = [float(abs(np.median(of(one)[low:high]))) for one in found[level]]
                cells.append(f"{np.median(drift):.3g} ({max(drift):.3g})")
            rows.append([name, f"{low} to {high}", *cells])
    return rows


def _drift_points(kind: int, one: Wearing) -> FloatArray:
    return np.asarray(one.change_percent[kind] - one.change_percent[kind, 0])


def _force_error_percent(kind: int, one: Wearing) -> FloatArray:
    return np.asarray(100 * (one.force_n[kind] / one.true_n - 1))


def draw(found: dict[str, list[Wearing]]) -> Figure:
    """Draw resistance, relative change and force over cycles on the first sensor of each level."""
    from palpate.plots.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, new_figure

    colours = (ORANGE, PURPLE, BLUE, GREEN)
    with new_figure(rows=2, columns=3, width_in=11.0, height_in=5.8) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            one = found[level][0]
            cycle = np.arange(one.true_n.size)
            row[0].plot(cycle, one.ohm, color=GREY, lw=0.6)
            row[0].set(ylabel="resistance when closed (ohm)", title=f"simulated, {level}")
            for values, colour in zip(one.change_percent, colours[:-1], strict=True):
                row[1].plot(cycle, values, color=colour, lw=0.6, alpha=0.7)
            row[1].set(ylabel="relative change (%)")
            for values, colour, name in zip(one.force_n, colours, KINDS, strict=True):
                row[2].plot(cycle, values, color=colour, lw=0.6, alpha=0.7, label=name)
            row[2].plot(cycle, one.true_n, color=INK, lw=1.2, label="load cell")
            row[2].set(ylabel="force (N)", ylim=(0, None))
            for axis in row:
                axis.set_xlabel("cycle")
        handles, labels = axes[0, 2].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure
