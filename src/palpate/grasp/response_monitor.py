"""Checks that the reading of each finger follows the hand: it rises while closing.

The law is over samples, and compares ratios only. The load of a finger is ln(rest resistance /
resistance), averaged over its pixels. A movement raises all resistances, at most in proportion to
its speed; the approach without contact shows by how much.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from statistics import fmean

from palpate.grasp.config import GUARDS, READING
from palpate.grasp.estimator import Observation, Touch
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.state import GraspState

#: Phases and activities in which both fingers grip.
GRIPPING = (Phase.SQUEEZE, Phase.HOLD, Activity.CONFIRM)


def is_gripping(state: GraspState) -> bool:
    """Return whether the hand grips, or confirms a grip."""
    return state.phase is Phase.SETTLE or state.activity in GRIPPING


def loads_of(touch: Touch) -> list[float]:
    """Return the load of each finger, ln(rest resistance / resistance).

    >>> touch = Touch(
    ...     time_s=0.0, finger_percent=(-50.0, -1.0), relative_percent=-25.5, sheet_n=1.0
    ... )
    >>> [round(load, 3) for load in loads_of(touch)]
    [0.693, 0.01]
    """
    return [-math.log1p(max(percent, -99.0) / 100.0) for percent in touch.finger_percent]


class FreeMovement:
    """How much the movement of an empty hand lowers the loads of its fingers.

    `hidden`: largest fall below rest in the approach, times the ratio of the speeds of squeeze and
    approach.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._free, self._rate = 0.0, plan.rate
        self._falls = deque[float](maxlen=READING.fewest_frames)

    def observe(self, touch: Touch, state: GraspState) -> None:
        """Include a frame of the approach."""
        if is_gripping(state):
            return
        if state.estimate.sweep is not None:
            self._rate = state.estimate.sweep.rate
        self._falls.append(-min(loads_of(touch)))
        self._free = max(self._free, min(self._falls))

    def hidden(self, state: GraspState) -> float:
        """Return the load that the present movement may hide; 0 at rest."""
        if state.estimate.still_s >= READING.quiet_s:
            return 0.0
        ratio = self._plan.squeeze_rate / self._rate if is_gripping(state) else 1.0
        return self._free * ratio


class _Finger:
    """The load of one finger since the hand last opened.

    `top`, `top_closure`: largest confirmed load, and the closure at which it was reached.
    """

    def __init__(self) -> None:
        self.top, self.top_closure = 0.0, 0.0
        #: Upper bounds of the excess conductance, each below all later ones, with their closures.
        self._lows = list[tuple[float, float]]()

    def add(self, low: float, high: float, *, closure: float, hidden: float) -> None:
        """Add the lowest and highest load of the last frames, and the present closure."""
        excess = max(math.expm1(high + hidden), 0.0)
        while self._lows and self._lows[-1][0] >= excess:
            self._lows.pop()
        self._lows.append((excess, closure))
        if low > self.top:
            self.top, self.top_closure = low, closure

    def has_stopped_rising(self, began: float, *, hidden: float, least: float, fine: float) -> bool:
        """Return whether the load did not rise over a travel that raises any grip force.

        D is the travel over which the excess conductance last doubled. 1.5 D further, that of a
        linear object and sheet is 1.75 times as large. It is 1.38 times as large for a sheet whose
        excess grows with the 0.4th power of the force, and this is expected: 1 + travel / (4 D).
        The expected rise of the load must certainly exceed what the movement may hide.

        `began`: closure before the sheet's lag. `least`: rise above noise and drift. `fine`:
        shortest D, mm or kPa.
        """
        excess = math.expm1(self.top)
        half = bisect_left(self._lows, (0.5 * excess,))
        if half == 0:
            return False
        doubling = max(self.top_closure - self._lows[half - 1][1], fine)
        further = (began - self.top_closure) / doubling
        if further < GUARDS.blind_doublings:
            return False
        expected = math.log1p(excess * (1.0 + 0.25 * further)) - self.top
        return expected > hidden + least


class ResponseMonitor:
    """Opens the hand if the reading does not follow the movement.

    With the load of a finger, L = ln(rest resistance / resistance), confirmed by three frames; the
    load that the movement may hide, H (`FreeMovement`); and a hint of contact, h = 3 %:

    - while closing, L of any finger < largest L since the hand last opened - H - h;
    - while closing, no rise of L of any finger over 1.5 times the travel in which the force last
      doubled (`_Finger.has_stopped_rising`);
    - while opening, L of both fingers > L before the opening + h.

    Before contact of both fingers the one may push the object, so nothing is judged. Relaxation of
    the object lowers L too, by less than h within a closing.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._free = plan, FreeMovement(plan)
        self._least = -math.log1p(plan.hint_percent / 100.0)
        self._contact = -math.log1p(READING.contact_percent / 100.0)
        self._fingers = list[_Finger]()
        #: Time, closure and loads of the last frames, as far back as the sheet's lag.
        self._recent = deque[tuple[float, float, list[float]]]()
        self._sent: float | None = None
        self._is_opening, self._is_gripped = False, False
        #: Loads at rest before the opening, if known; time at rest and closure at the last frame.
        self._before: list[float] | None = None
        self._still_s = 0.0
        self._closure = 0.0

    def check(self, observation: Observation, state: GraspState) -> Alarm | None:
        """Return an alarm if the reading does not follow the movement."""
        estimate, touch = state.estimate, state.estimate.last
        if touch is None or estimate.rest_ohm is None:
            self._reset()
            return None
        closure = self._plan.gripper.closure(observation.gripper)
        self._follow_command(closure, state)
        self._free.observe(touch, state)
        self._recent.append((touch.time_s, closure, loads_of(touch)))
        last = list(self._recent)[-READING.fewest_frames :]
        if len(last) < READING.fewest_frames:
            return None
        # A reading confirmed by three frames is that of the first one, and lags behind the force.
        then_s = last[0][0] - READING.lag_s
        while len(self._recent) > len(last) and self._recent[1][0] <= then_s:
            self._recent.popleft()
        loads = list(zip(*(one[2] for one in last), strict=True))
        if self._is_opening:
            wrong = "rises while the hand opens" if self._rises(loads) else None
        else:
            self._fingers = self._fingers or [_Finger() for _ in loads]
            if not self._is_gripped and min(map(min, loads)) >= self._contact:
                self._is_gripped = True
                # Until now one finger may have pushed the object.
                for finger in self._fingers:
                    finger.top = 0.0
            wrong = self._describe_closing(loads, self._recent[0][1], closure, state)
        if wrong is None or not is_gripping(state) or not self._is_gripped:
            return None
        message = (
            f"the reading {wrong}: the object yields, or the sheet does not show the force; run "
            "`palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, message=message)

    def _follow_command(self, closure: float, state: GraspState) -> None:
        """Note a new command; an opening begins a new comparison."""
        sent, was_still_s, began = state.estimate.sent, self._still_s, self._closure
        self._still_s, self._closure = state.estimate.still_s, closure
        if sent is None or sent == self._sent:
            return
        self._sent = sent
        opening = sent < began - READING.report_error_steps * self._plan.resolution
        if opening == self._is_opening:
            return
        last = [loads for _, _, loads in self._recent][-READING.fewest_frames :]
        is_known = opening and was_still_s >= READING.quiet_s
        self._before = [fmean(load) for load in zip(*last, strict=True)] if is_known else None
        self._fingers, self._is_opening = [], opening
        self._recent.clear()

    def _describe_closing(
        self, loads: list[tuple[float, ...]], began: float, closure: float, state: GraspState
    ) -> str | None:
        """Describe the failure of a finger's load to follow the closing hand; None without one."""
        hidden, wrong = self._free.hidden(state), None
        # Later the object relaxes.
        is_closing = state.estimate.still_s < self._plan.dwell_s
        # Soft fingers follow their pressure late.
        is_soft = self._plan.gripper.drive == "pressure"
        has_arrived = not is_soft or state.estimate.still_s >= READING.quiet_s
        for finger, seen in zip(self._fingers, loads, strict=True):
            finger.add(min(seen), max(seen), closure=closure, hidden=hidden)
            if is_closing and max(seen) < finger.top - hidden - self._least:
                wrong = "falls while the hand closes"
            elif (
                has_arrived
                and max(seen) <= finger.top
                and finger.has_stopped_rising(
                    began, hidden=hidden, least=self._least, fine=self._plan.fine_step
                )
            ):
                wrong = "does not rise while the hand closes"
        return wrong

    def _rises(self, loads: list[tuple[float, ...]]) -> bool:
        if self._before is None:
            return False
        pairs = zip(loads, self._before, strict=True)
        return all(min(seen) > before + self._least for seen, before in pairs)

    def _reset(self) -> None:
        self._fingers, self._is_gripped, self._before = [], False, None
        self._recent.clear()
