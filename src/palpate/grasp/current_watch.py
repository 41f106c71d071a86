"""An upper check of the force that does not use the sheet: the servo's current, at all times.

The current of a closing servo covers the friction of its gears and the grip. At rest, friction may
carry part of the grip either way, but never makes the servo draw more than while closing. So a
current above the most that the gears take proves a force, whatever the sheet reads.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from palpate.estimate.servo_force import WARMTH_SD
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.gripper.interface import GripperState

#: Deviations at which one movement is believed, and at which two in a row are: of some fifty
#: movements of a grasp none may raise a false alarm.
_ALONE, _TWICE = 4.5, 3.0
#: Readings whose mean is taken; while the hand stands still the current changes slowly.
_MOVING, _STANDING = 4, 6
#: The current must show this many times the most that the sheet shows.
_TIMES = 2.0
#: The sheet is asked once it has answered the movement.
_ANSWERED_S = 0.2
#: A motor that turns is never quite steady: this many equal readings in a row are none.
_EQUAL = 16
#: Without a calibration of the current, the first readings of the grasp itself show what the gears
#: take: this many short movements, or as many groups of readings in one long one. Later ones may
#: take this many times the largest of them, and this more, mA.
_FEWEST, _TIMES_EMPTY, _MORE_MA = 4, 2.0, 20.0
#: A pixel hides its own fall under load for this long (fades with 0.06 to 0.12 s): a frame that was
#: scanned so much after the current rose would show a grip.
_SHEET_LAG_S = 0.06


class CurrentWatch:
    """Bounds the grip force by the servo's current, where the gripper reports it.

    `plan`: its current law, force law and ceiling. Without a current law nothing is known of
    newtons; then a pull that the approach of this grasp did not show and the sheet does not explain
    is an alarm.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._pull = deque[tuple[float, float]](maxlen=_MOVING)
        self._stand = deque[tuple[float, float]](maxlen=_STANDING)
        self._closure, self._moved_s = math.inf, math.nan
        self._turning = deque[float](maxlen=_EQUAL)
        self._read_s = math.nan
        self._judged = True
        self._twice = 0
        self._empty_ma = list[float]()
        self._grouped, self._risen_s = 0, math.nan

    def alarm(self, state: GripperState, *, belief: Belief) -> Alarm | None:
        """Take the gripper's next report; return an unexplained rise of the current."""
        if math.isnan(state.current_ma):
            return None
        reading = (state.current_ma, self._plan.gripper.reported(state))
        closure, before = self._plan.gripper.closure(state), self._closure
        self._closure = closure
        if self._stand and (state.moving or belief.moved_s != self._moved_s):
            # What was read before the last command shows nothing of what came after, even if that
            # was too short to be seen.
            self._stand.clear()
            self._pull.clear()
            self._judged = True
        self._moved_s = belief.moved_s
        if not state.moving:
            self._stand.append(reading)
            return self._too_much(self._stand) or self._unseen(belief)
        # A hand that is sent back and closes all the same is watched too.
        if not (closure <= belief.sent or closure > before + self._plan.resolution):
            self._judged = True
            return None
        self._pull.append(reading)
        # A recording that is decided again gives one report several times.
        if state.time_s != self._read_s:
            self._turning.append(state.current_ma)
        self._read_s = state.time_s
        self._judged = False
        return (
            self._too_much(self._pull)
            or self._stuck()
            or self._reversed()
            or self._risen(belief, time_s=state.time_s)
        )

    def _least_n(self, readings: deque[tuple[float, float]], *, deviations: float) -> float:
        """Return the force that is there for sure."""
        law = self._plan.current
        if law is None or not readings:
            return 0.0
        current_ma, width_mm = np.array(readings).T
        gears = law.gears
        most_ma = float(np.mean(gears.at(width_mm)))
        # Friction scatters in proportion; of a mean that is no friction, or less than its scatter,
        # no proportion is taken.
        scatter_ma = deviations * gears.movement_ma
        if gears.mean_ma > gears.movement_ma:
            scatter_ma = most_ma * math.expm1(scatter_ma / gears.mean_ma)
        most_ma += scatter_ma + deviations * law.noise_ma / math.sqrt(len(readings))
        per_n = law.ma_per_n * (1.0 + 2.0 * WARMTH_SD)
        return max(float(current_ma.mean()) - most_ma, 0.0) / per_n

    def _too_much(self, readings: deque[tuple[float, float]]) -> Alarm | None:
        least_n = self._least_n(readings, deviations=_TWICE)
        ceiling_n = self._plan.safety.force_ceiling_n
        if least_n <= ceiling_n:
            return None
        words = (
            f"the servo's current shows a grip of at least {least_n:.1f} N, and {ceiling_n:g} N is "
            "the most allowed"
        )
        return Alarm(danger=Danger.FORCE_LIMIT, words=words)

    def _stuck(self) -> Alarm | None:
        if len(self._turning) < _EQUAL or len(set(self._turning)) > 1:
            return None
        words = (
            f"the servo's current has read {self._turning[0]:.0f} mA {_EQUAL} times while the hand "
            "closed: it is stuck, and shows no force"
        )
        return Alarm(danger=Danger.GRIPPER_FAULT, words=words)

    def _reversed(self) -> Alarm | None:
        """Refuse a current with the other sign: it bounds no force."""
        law = self._plan.current
        usual = law is None or law.gears.mean_ma > 0
        mean_ma = float(np.mean(self._turning))
        if len(self._turning) < _EQUAL or mean_ma >= -_MORE_MA or not usual:
            return None
        words = (
            f"the servo's current is {mean_ma:.0f} mA while the hand closes: its driver must "
            "report it positive then"
        )
        return Alarm(danger=Danger.GRIPPER_FAULT, words=words)

    def _risen(self, belief: Belief, *, time_s: float) -> Alarm | None:
        """Compare the current within a long movement, where nothing is known of newtons."""
        if self._plan.current is not None or len(self._pull) < _MOVING:
            return None
        pull_ma = float(np.mean([current_ma for current_ma, _ in self._pull]))
        if len(self._empty_ma) < _FEWEST:
            self._grouped = (self._grouped + 1) % _MOVING
            if self._grouped == 0:
                self._empty_ma.append(pull_ma)
            return None
        if pull_ma <= self._most_empty_ma:
            self._risen_s = math.nan
            return None
        if math.isnan(self._risen_s):
            self._risen_s = time_s
        answered = belief.now_s > self._risen_s + _SHEET_LAG_S
        if not answered or belief.watched_n > self._plan.no_push_n:
            return None
        return self._unexplained(pull_ma)

    @property
    def _most_empty_ma(self) -> float:
        return _TIMES_EMPTY * max(*self._empty_ma, 0.0) + _MORE_MA

    def _unexplained(self, pull_ma: float) -> Alarm:
        words = (
            f"the servo's current rose to {pull_ma:.0f} mA, {max(self._empty_ma):.0f} mA moved the "
            "empty hand, and the sheet shows nothing; run `palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, words=words)

    def _unseen(self, belief: Belief) -> Alarm | None:
        """Compare the last movement, and the hand as it stands, with what the sheet shows."""
        if belief.still_s < _ANSWERED_S or not belief.touches:
            return None
        if self._plan.current is None:
            return self._unlearned(belief)
        force = self._plan.early_law.force_n(belief.now.reading, level=self._plan.level)
        shown_n = float(np.nan_to_num(force.high))
        bound_n = _TIMES * shown_n
        least_n = self._least_n(self._stand, deviations=_ALONE)
        if not self._judged:
            self._judged = True
            least_n = max(least_n, self._least_n(self._pull, deviations=_ALONE))
            again_n = self._least_n(self._pull, deviations=_TWICE)
            self._twice = self._twice + 1 if again_n > bound_n else 0
            if self._twice > 1:
                least_n = max(least_n, again_n)
        if least_n <= bound_n:
            return None
        words = (
            f"the servo's current shows a grip of at least {least_n:.1f} N, and the sheet at most "
            f"{shown_n:.1f} N: does the object lie beside the sheet? Run `palpate doctor`"
        )
        return Alarm(danger=Danger.UNSEEN_FORCE, words=words)

    def _unlearned(self, belief: Belief) -> Alarm | None:
        felt = belief.now.deepest_percent <= self._plan.hint_percent
        if self._judged or felt or not self._pull:
            return None
        self._judged = True
        pull_ma = float(np.mean([current_ma for current_ma, _ in self._pull]))
        if len(self._empty_ma) < _FEWEST:
            self._empty_ma.append(pull_ma)
            return None
        return None if pull_ma <= self._most_empty_ma else self._unexplained(pull_ma)
