"""The reading must follow the hand, in the middle of a movement too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tests.factories import touch

from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.response_monitor import ResponseMonitor
from palpate.grasp.safety import Danger
from palpate.grasp.state import Correction, GraspState
from palpate.gripper.interface import GripperState
from palpate.sensor.array import Frame

RATE_HZ, MM_PER_S = 250.0, 5.0


@dataclass
class Hand:
    """A hand that closes on a spring in one movement; contact at a closure of 20 mm.

    `excess`: from the deformation in mm to the excess conductance of each finger.
    `free_percent`: what the movement adds to the resistance.
    """

    plan: Plan
    excess: Callable[[float], tuple[float, float]]
    free_percent: float = 0.0
    contact: float = 20.0
    is_rest_known: bool = True

    def __post_init__(self) -> None:
        self.monitor = ResponseMonitor(self.plan)
        self.closure = self.sent = 19.0
        self.now_s = 0.0
        self.still_since_s: float | None = 0.0
        self.activity: Phase | Activity = Activity.TOUCH

    def frame(self) -> str | None:
        """See one frame; return the message of an alarm."""
        self.now_s += 1.0 / RATE_HZ
        free = 1.0 + (self.still_since_s is None) * self.free_percent / 100.0
        percents = tuple(
            100.0 * (free / (1.0 + excess) - 1.0)
            for excess in self.excess(max(self.closure - self.contact, 0.0))
        )
        last = replace(touch(1.0, time_s=self.now_s), finger_percent=percents)
        estimate = ContactEstimate(
            now_s=self.now_s,
            sent=self.sent,
            still_since_s=self.still_since_s,
            last=last,
            rest_ohm=self.plan.rest_ohm if self.is_rest_known else None,
        )
        state = GraspState(estimate=estimate)
        if isinstance(self.activity, Phase):
            state.phase = self.activity
        else:
            state.attempt.activity = self.activity
            state.correction = Correction(activity=self.activity)
            state.phase = Phase.SETTLE if self.activity is Activity.EASE else Phase.APPROACH
        seen = Observation(
            frame=Frame(time_s=self.now_s, sequence=1, counts=np.full((4, 2), 300)),
            gripper=GripperState(time_s=self.now_s, width_mm=74.0 - self.closure),
        )
        alarm = self.monitor.check(seen, state)
        assert alarm is None or alarm.danger is Danger.UNSEEN_FORCE
        return None if alarm is None else alarm.message

    def move(self, closure: float) -> str | None:
        """Move at constant speed to a closure; return the first alarm."""
        self.sent, self.still_since_s = closure, None
        step = MM_PER_S / RATE_HZ * (1.0 if closure > self.closure else -1.0)
        for _ in range(round((closure - self.closure) / step)):
            self.closure += step
            if message := self.frame():
                return message
        return None

    def rest(self, seconds: float) -> str | None:
        """Stay; return the first alarm."""
        self.still_since_s = self.now_s
        return next((said for _ in range(round(seconds * RATE_HZ)) if (said := self.frame())), None)


def both(excess: float) -> tuple[float, float]:
    return excess, excess


@pytest.mark.parametrize(
    ("excess", "words"),
    [
        (lambda mm: both(0.5 * mm), None),
        # A stiffening and a hard object, and one finger that reads a quarter of the other.
        (lambda mm: both(0.3 * mm**1.5), None),
        (lambda mm: both(5.0 * mm), None),
        (lambda mm: (0.5 * mm, 0.125 * mm), None),
        # From 1.5 mm on: at rest, one finger at rest, half the counts, and no further rise.
        (lambda mm: both(0.5 * mm * (mm < 1.5)), "falls while the hand closes"),
        (lambda mm: (0.5 * mm, 0.5 * mm * (mm < 1.5)), "falls while the hand closes"),
        (lambda mm: both(0.5 * mm if mm < 1.5 else -0.6), "falls while the hand closes"),
        (lambda mm: both(0.5 * min(mm, 1.5)), "does not rise while the hand closes"),
        (lambda mm: (0.5 * mm, 0.5 * min(mm, 1.5)), "does not rise while the hand closes"),
        # Falling slowly.
        (lambda mm: both(0.5 * min(mm, 3.0 - mm)), "falls while the hand closes"),
    ],
)
@pytest.mark.parametrize("free_percent", [0.0, 3.0])
def test_reading_that_does_not_follow_a_closing_hand_raises_an_alarm_in_the_movement(
    plan: Plan,
    excess: Callable[[float], tuple[float, float]],
    words: str | None,
    free_percent: float,
) -> None:
    """The movement itself raises the resistance, as it did in the approach."""
    plan = replace(plan, squeeze_rate=plan.rate)
    hand = Hand(plan, excess=excess, free_percent=free_percent)
    assert hand.move(20.2) is None
    hand.activity = Phase.SQUEEZE
    said = hand.move(24.0)
    assert (said is not None) == (words is not None)
    assert words is None or words in str(said)
    # From the fault at 1.5 mm on, the force of a linear object grows to 2.2 times at most.
    assert words is None or hand.closure <= 23.3


@pytest.mark.parametrize(("level", "is_alarm"), [(0.02, False), (0.2, True)])
def test_constant_weak_reading_raises_no_alarm_within_noise_and_drift(
    plan: Plan, level: float, is_alarm: bool
) -> None:
    """Over this travel, a reading of 2 % would rise by less than a hint of contact."""
    hand = Hand(plan, excess=lambda mm: both(level * min(mm / 0.1, 1.0)))
    hand.activity = Phase.SQUEEZE
    assert (hand.move(20.1 + 6.0 * plan.fine_step) is not None) == is_alarm


def push(mm: float) -> tuple[float, float]:
    """One finger pushes the object over 3 mm, and then less, when the other one touches it."""
    return max(0.2 * min(mm, 3.0 - mm), mm - 3.0), max(mm - 3.0, 0.0)


@pytest.mark.parametrize("is_second_try", [False, True])
def test_pushing_finger_raises_no_alarm(plan: Plan, is_second_try: bool) -> None:
    """Before a second try, the rest values are measured again."""
    hand = Hand(plan, excess=lambda mm: both(0.5 * mm))
    if is_second_try:
        hand.activity = Phase.SQUEEZE
        assert hand.move(22.0) is None
        assert hand.move(19.0) is None
        hand.activity, hand.is_rest_known = Activity.TOUCH, False
        assert hand.rest(0.5) is None
        hand.is_rest_known = True
    hand.excess = push
    assert hand.move(22.8) is None
    hand.activity = Phase.SQUEEZE
    assert hand.move(24.0) is None


def test_object_that_relaxes_at_rest_raises_no_alarm(plan: Plan) -> None:
    """The reading of a hand at rest falls by a tenth in each second."""
    hand = Hand(plan, excess=lambda mm: both(0.5 * mm))
    hand.activity = Phase.SQUEEZE
    assert hand.move(22.0) is None
    assert hand.rest(0.6) is None
    hand.excess = lambda mm: both(0.5 * mm * (1.0 - 0.1 * (hand.now_s - 1.2)))
    hand.activity = Phase.HOLD
    assert hand.rest(5.0) is None


@pytest.mark.parametrize(
    ("rise", "rested_s", "is_alarm"), [(1.2, 1.0, True), (1.01, 1.0, False), (1.2, 0.2, False)]
)
def test_reading_that_rises_while_the_hand_opens_raises_an_alarm(
    plan: Plan, rise: float, rested_s: float, is_alarm: bool
) -> None:
    """It is compared with that just before, which the sheet's creep has raised since the closing.

    Just after a closing the sheet has not responded yet.
    """
    hand = Hand(plan, excess=lambda mm: both(0.5 * mm))
    hand.activity = Phase.SQUEEZE
    assert hand.move(22.0) is None
    hand.excess = lambda mm: both(1.3)
    assert hand.rest(rested_s) is None
    hand.activity = Activity.EASE
    hand.excess = lambda mm: both(1.3 * rise)
    said = hand.move(21.0)
    assert (said is not None) == is_alarm
    assert said is None or "rises while the hand opens" in said
