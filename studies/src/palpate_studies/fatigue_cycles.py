"""One sensor worn by its cycles, each worked through as the hand makes it (simulated)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.force import PowerForceLaw
from palpate.gripper.interface import GripperState
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import excess_conductance, mean_change, relative_change_percent
from palpate.twin.devices import TwinArray
from palpate.twin.velostat import Environment
from palpate_studies.equal_width import SEED
from palpate_studies.rezero import RezeroRule, RezeroState, rezero_step
from palpate_studies.twin_session import SETTLED_MEAN_S, Session, drawn
from palpate_studies.wear import WearTrack

#: Paper, section 2.1: cycles of 10 s closed and 10 s open.
CLOSED_S, OPEN_S = 10.0, 10.0
#: A reference load is read by this many grasps in the rhythm of the work, because a sheet answers
#: by it. Before, the station pauses and looks for rest values.
CHECK_GRASPS, PAUSE_S, LOOK_S = 30, 60.0, 5.0
OBJECT, CLOSURE_MM, OPENED_MM = "springs-8", 3.0, 12.0
#: The room swings by this much over a period, as a laboratory's does.
ROOM_C, ROOM_SWING_C, ROOM_PERIOD_S = 21.9, 1.5, 12 * 3600.0
#: Closures at which the force law is calibrated before the first cycle.
CALIBRATED_MM = (0.8, 1.2, 1.7, 2.3, 3.0, 3.8)
CALIBRATED_TIMES = 3
#: A closing is watched for this long: where contact began is seen then.
CLOSING_S = 0.5
#: Ways to come from a reading to a force, from cycle to cycle.
KINDS = (
    "rest of the calibration",
    "re-zeroed in the rhythm",
    "re-zeroed in pauses",
    "re-zeroed in pauses, wear corrected",
)
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
        self._track = WearTrack.started(cycles=0, excess=self._reference_excess())
        for cycle in range(cycles):
            self._cycle(cycle)

    def _calibrate(self) -> PowerForceLaw:
        made, size_mm = [], self._obj.size_mm
        for closure_mm in CALIBRATED_MM * CALIBRATED_TIMES:
            self._surround()
            made.append(
                self._session.grasp(size_mm, width_mm=size_mm - closure_mm, hold_s=CLOSED_S)
            )
        return PowerForceLaw.fit([r.excess for r in made], force_n=[r.force_n for r in made])

    def _reference_excess(self) -> float:
        """Read the reference load: the mean of several grasps in the rhythm of the work."""
        session, log_excess = self._session, []
        for _ in range(CHECK_GRASPS):
            self._surround()
            session.close_to(self._obj.size_mm - CLOSURE_MM)
            session.world.clock.sleep_s(CLOSED_S - SETTLED_MEAN_S)
            ohm = session.mean_ohm()
            excess = excess_conductance(ohm, rest_ohm=self._pauses.rest_ohm)
            log_excess.append(np.log(np.nansum(excess)))
            session.close_to(self._obj.size_mm + OPENED_MM)
            session.world.clock.sleep_s(OPEN_S)
        return float(np.exp(np.mean(log_excess)))

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
        self._track = self._track.checked(cycles=cycle, excess=self._reference_excess())

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
