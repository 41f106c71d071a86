"""The only control loop: it owns the devices, and leaves the gripper safe whatever happens."""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from statistics import median
from types import FrameType
from typing import TypeAlias, TypeVar

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.belief import Belief, Observation, commanded, counted
from palpate.grasp.controller import released, step, stopped
from palpate.grasp.current_watch import CurrentWatch
from palpate.grasp.phases import Phase
from palpate.grasp.pixel_watch import PixelWatch
from palpate.grasp.plan import Plan
from palpate.grasp.releasing import Move
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.rezero import strange_rest
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.tracking_error import Following, SpeedWatch, unbelievable
from palpate.gripper.interface import Gripper, GripperState
from palpate.sensor.array import Frame, PressureArray, wrong_counts

#: Gets every observation: a recorder, a view. It must return quickly; if it raises, only it ends.
Subscriber: TypeAlias = Callable[[Observation], None]
#: Gets what the controller makes of each observation, on the same terms.
Watcher: TypeAlias = Callable[[Belief], None]

_Event = TypeVar("_Event")

#: How long an opening hand may take before it is stopped where it is.
_OPENING_S = 10.0
#: A hand that did not move at this many commands does not hear them, or can't.
_IDLE = 4
#: Until some frames have shown the sensor's own rate, it gets this long for each.
_FIRST_FRAME_S = 2.0
#: The period is the median of the last intervals, of a few at least: no single frame that is late
#: or early moves the limit.
_INTERVALS, _FEWEST_INTERVALS = 15, 3
#: A frame may be scanned this far in the future: what two clocks differ by.
_AHEAD_S = 0.1


class _Feed:
    """Frames that are fresh, or an error: nothing is decided on what the sensor felt long ago."""

    def __init__(self, array: PressureArray, *, clock: Clock, plan: Plan) -> None:
        self._array, self._clock, self._safety = array, clock, plan.safety
        self._layout = plan.layout
        self._last_s: float | None = None
        self._intervals_s = deque[float](maxlen=_INTERVALS)

    def next(self, hand: _Hand, belief: Belief) -> Frame | Alarm:
        """Return the next frame, or what the hand does wrong while it is waited for."""
        stale_after_s = _FIRST_FRAME_S
        if len(self._intervals_s) >= _FEWEST_INTERVALS:
            stale_after_s = self._safety.stale_after_s(median(self._intervals_s))
        until_s, glanced = self._clock.now_s() + stale_after_s, False
        while True:
            left_s = until_s - self._clock.now_s()
            every_s = hand.glance_s(self._clock.now_s()) or left_s
            try:
                frame = self._array.read(timeout_s=max(min(every_s, left_s), 0.0))
                break
            except DeviceTimeoutError as late:
                if every_s < left_s:
                    alarm, glanced = hand.glance(belief, now_s=self._clock.now_s()), True
                elif glanced:
                    raise DeviceTimeoutError(
                        f"no frame in {stale_after_s:.2f} s; check the sensor's cable and power"
                    ) from late
                else:
                    raise
            if alarm is not None:
                return alarm
        self._check(frame, stale_after_s=stale_after_s)
        if self._last_s is not None:
            self._intervals_s.append(frame.time_s - self._last_s)
        self._last_s = frame.time_s
        return frame

    def _check(self, frame: Frame, *, stale_after_s: float) -> None:
        age_s = self._clock.now_s() - frame.time_s
        if not -max(stale_after_s, _AHEAD_S) <= age_s <= stale_after_s:
            raise DeviceTimeoutError(
                f"the newest frame is {age_s:.2f} s old (limit {stale_after_s:.2f} s); "
                "check the sensor's cable and that nothing else loads this machine"
            )
        if self._last_s is not None and frame.time_s <= self._last_s:
            raise DeviceError(
                f"frame times do not rise: {frame.time_s:.3f} s follows {self._last_s:.3f} s; "
                "check how the array times its frames"
            )
        wrong = wrong_counts(frame, layout=self._layout)
        if wrong is not None:
            raise DeviceError(wrong)


class _Hand:
    """The gripper, checked against its commands and against what its current shows."""

    def __init__(self, gripper: Gripper, *, plan: Plan) -> None:
        self._gripper, self._plan = gripper, plan
        self._limits, self._safety = plan.gripper, plan.safety
        self._current = CurrentWatch(plan)
        self._speed = SpeedWatch(plan.gripper, safety=plan.safety)
        self._following: Following | None = None
        #: The first command since the hand was last seen to move, or not to.
        self._unjudged: Following | None = None
        self._idle = 0
        self._last: GripperState | None = None

    def state(self) -> GripperState:
        """Return its state.

        Raises `DeviceError` if it does not answer, or reports what can't be.
        """
        state = self._gripper.state()
        wrong = unbelievable(state, limits=self._limits, before=self._last)
        if wrong is not None:
            raise DeviceError(wrong)
        self._last = state
        return state

    def alarm(self, state: GripperState, *, belief: Belief, now_s: float) -> Alarm | None:
        """Return what is wrong: it is not where it was sent, or presses more than it may."""
        complaint = None
        if self._following is not None:
            complaint = self._following.complaint(
                state, now_s=now_s, limits=self._limits, safety=self._safety
            )
        complaint = complaint or self._speed.complaint(state, way=self._following)
        if complaint is not None:
            return Alarm(danger=Danger.GRIPPER_FAULT, words=complaint)
        return self._current.alarm(state, belief=belief)

    def glance_s(self, now_s: float) -> float | None:
        """Return how often it must be looked at between frames; None if they are enough."""
        if self._following is None:
            return None
        return self._following.glance_s(now_s=now_s, limits=self._limits, safety=self._safety)

    def glance(self, belief: Belief, *, now_s: float) -> Alarm | None:
        """Look at it between two frames."""
        try:
            return self.alarm(self.state(), belief=belief, now_s=now_s)
        except DeviceError as error:
            return Alarm(danger=Danger.GRIPPER_FAULT, words=str(error))

    def send(self, move: Move, *, now_s: float) -> Belief:
        """Send a move's command, if there is one, and follow it; return the belief updated with it.

        Raises `DeviceError` if it does not answer, or did not move at the last commands.
        """
        belief, command = move
        if command is None:
            return belief
        if self._unjudged is not None and self._last is not None:
            idle = self._unjudged.idle(self._last, now_s=now_s, limits=self._limits)
            if idle is not None:
                self._idle = (self._idle + 1) * idle
            if idle is not None or now_s >= self._unjudged.ends_s:
                self._unjudged = None
            # An opening is sent all the same.
            if self._idle >= _IDLE and command.target != self._limits.target(0.0):
                raise DeviceError(
                    f"the gripper was sent on {_IDLE} times and did not move; is it blocked, "
                    "locked or without supply?"
                )
        sent = self._gripper.command(command)
        if self._last is not None:
            self._following = Following.of(
                sent, state=self._last, now_s=now_s, limits=self._limits, safety=self._safety
            )
            # Commands that follow each other faster than a hand can move are judged together.
            self._unjudged = self._unjudged or self._following
        return commanded(belief, sent, plan=self._plan)

    def finish_opening(self, clock: Clock) -> list[str]:
        """Wait for an opening without frames, by the gripper's own word; return what it lacked.

        The sensor is lost already, and a gripper on the same board may be as silent.
        """
        until_s = clock.now_s() + _OPENING_S
        try:
            while self._gripper.state().moving and clock.now_s() < until_s:
                clock.sleep_s(0.02)
        except DeviceError as error:
            return [str(error)]
        return []

    def stop(self) -> DeviceError | None:
        """Stop it; return why that failed, if it did."""
        try:
            self._gripper.stop()
        except DeviceError as error:
            return error
        return None


def run_grasp(
    plan: Plan,
    *,
    array: PressureArray,
    gripper: Gripper,
    clock: Clock,
    subscribers: Sequence[Subscriber] = (),
    watchers: Sequence[Watcher] = (),
    requests: Requests | None = None,
) -> GraspResult:
    """Run one grasp to its end; afterwards the gripper stands still or is open.

    Ctrl-C, SIGTERM and `requests.stop` end the grasp with outcome `stopped`; a silent or lost
    array, a pixel that fails, and a sheet that does not show what the gripper presses with
    `sensor_lost`; a gripper that fails or does not go where it is sent with `gripper_fault`; force
    above the ceiling, by the sheet or by the servo's current, with `force_limit`. The result's
    `faults` explain why. What that means for the hand is in `palpate.grasp.safety`.
    """
    belief, feed, faults = Belief(), _Feed(array, clock=clock, plan=plan), list[str]()
    hand, views, beliefs = _Hand(gripper, plan=plan), list(subscribers), list(watchers)
    pixels = PixelWatch(plan)
    requests = Requests() if requests is None else requests
    try:
        with _signals_set(requests.stop):
            while not belief.ended:
                asked = _asked(belief, requests, plan=plan)
                if asked is not None:
                    belief = hand.send(asked, now_s=clock.now_s())
                    continue
                try:
                    frame = feed.next(hand, belief)
                except DeviceError as error:
                    faults.append(str(error))
                    lost = stopped(belief, Danger.SENSOR_LOST, plan=plan)
                    belief = hand.send(lost, now_s=clock.now_s())
                    if belief.phase is Phase.RELEASE:
                        faults += hand.finish_opening(clock)
                        break
                    continue
                if isinstance(frame, Alarm):
                    move = _heeded((belief, None), frame, faults, plan=plan)
                    belief = hand.send(move, now_s=clock.now_s())
                    continue
                observation = Observation(frame=frame, gripper=hand.state())
                alarm = _cut_off(frame, plan=plan) or pixels.alarm(observation)
                move = _decided(belief, observation, doubtful=pixels.doubtful, plan=plan)
                alarm = alarm or _strange(belief, move[0], plan=plan)
                alarm = alarm or hand.alarm(observation.gripper, belief=move[0], now_s=frame.time_s)
                _tell(views, observation, faults)
                # Whatever fails from here on is attributed to this moment.
                before, belief = belief, move[0]
                if pixels.beyond is not None and pixels.beyond not in faults:
                    faults.append(pixels.beyond)
                faults += _given_up(before, belief, plan=plan)
                if alarm is not None:
                    move = _heeded(move, alarm, faults, plan=plan)
                belief = hand.send(move, now_s=frame.time_s)
                _tell(beliefs, belief, faults)
    except DeviceError as error:
        faults.append(str(error))
        belief, _ = stopped(belief, Danger.GRIPPER_FAULT, plan=plan)
    except KeyboardInterrupt:
        belief, _ = stopped(belief, Danger.STOPPED, plan=plan)
    finally:
        unstopped = hand.stop()
    if unstopped is not None:
        faults.append(f"the stop command failed: {unstopped}")
        belief, _ = stopped(belief, Danger.GRIPPER_FAULT, plan=plan)
    return replace(
        belief.result,
        faults=(*belief.result.faults, *faults),
        frames=belief.frames,
        frames_lost=belief.lost,
        peak_force_n=belief.peak_force_n if belief.contact_s is not None else None,
    )


def _decided(belief: Belief, observation: Observation, *, doubtful: bool, plan: Plan) -> Move:
    """Decide on an observation, or wait for the next one; an opening needs no pixel."""
    if doubtful and belief.phase is not Phase.RELEASE:
        return counted(belief, observation.frame), None
    return step(belief, observation, plan=plan)


def _cut_off(frame: Frame, *, plan: Plan) -> Alarm | None:
    """Open where the sensor's board has tripped: it saw more on one pixel than is allowed."""
    if not frame.ceiling_tripped:
        return None
    words = (
        "the board's own ceiling has tripped: a pixel reads more than "
        f"{plan.safety.force_ceiling_n:g} N allow; take the cause away, then open the rig again"
    )
    return Alarm(danger=Danger.FORCE_LIMIT, words=words)


def _strange(before: Belief, now: Belief, *, plan: Plan) -> Alarm | None:
    """Refuse rest values, as soon as they are taken, that can't be this sheet's."""
    if before.rest_ohm is not None or now.rest_ohm is None:
        return None
    why = strange_rest(now.rest_ohm, plan=plan)
    return None if why is None else Alarm(danger=Danger.SENSOR_LOST, words=why)


def _given_up(before: Belief, now: Belief, *, plan: Plan) -> list[str]:
    """Return why the controller itself has just ended the grasp, unless its outcome shows it."""
    if now.phase is not Phase.RELEASE or before.phase is Phase.RELEASE or now.result.faults:
        return []
    reasons = {
        Outcome.FORCE_LIMIT: f"the sheet shows {now.force_n:.1f} N, and "
        f"{plan.safety.force_ceiling_n:g} N is the most allowed",
        Outcome.TIMED_OUT: f"not done within {plan.longest_s:g} s",
    }
    reason = reasons.get(now.result.outcome)
    return [] if reason is None else [reason]


def _heeded(move: Move, alarm: Alarm, faults: list[str], *, plan: Plan) -> Move:
    """End the grasp as an alarm asks; a hand that opens or has ended needs none but its own.

    Raises `DeviceError` if it is the gripper that failed: nothing more is sent to it than a stop.
    """
    if alarm.danger is Danger.GRIPPER_FAULT:
        raise DeviceError(alarm.words)
    if move[0].phase in (Phase.RELEASE, Phase.STOPPED):
        return move
    faults.append(alarm.words)
    return stopped(move[0], alarm.danger, plan=plan)


def _asked(belief: Belief, requests: Requests, *, plan: Plan) -> Move | None:
    """Return the move that a request asks for; an opening that has begun is completed."""
    if belief.phase is Phase.RELEASE:
        return None
    if requests.stop.is_set():
        return stopped(belief, Danger.STOPPED, plan=plan)
    if requests.release.is_set():
        return released(belief, plan=plan)
    return None


def _tell(views: list[Callable[[_Event], None]], event: _Event, faults: list[str]) -> None:
    for view in tuple(views):
        try:
            view(event)
        # Whatever a recorder or view does wrong, the hand must not feel it; the result reports it.
        except Exception as error:
            views.remove(view)
            name = getattr(view, "__name__", type(view).__name__)
            faults.append(f"{name} failed and was left out from then on: {error}")


@contextmanager
def _signals_set(requested: threading.Event) -> Iterator[None]:
    """Turn Ctrl-C and SIGTERM into a flag, so that none interrupts a transfer halfway.

    A second Ctrl-C does interrupt: the old handlers are back after the first.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    old = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in old.items():
            signal.signal(number, handler)

    def request(number: int, frame: FrameType | None) -> None:
        requested.set()
        restore()

    for number in old:
        signal.signal(number, request)
    try:
        yield
    finally:
        restore()
