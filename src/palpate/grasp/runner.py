"""The only control loop: it owns the devices, and leaves the gripper safe whatever happens."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType
from typing import TypeAlias, TypeVar

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.belief import Belief, Observation, commanded
from palpate.grasp.controller import Move, released, step, stopped
from palpate.grasp.following import Following
from palpate.grasp.phases import Phase
from palpate.grasp.pixel_watch import PixelWatch
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult
from palpate.grasp.safety import Danger
from palpate.gripper.interface import Gripper, GripperState
from palpate.sensor.array import Frame, PressureArray

#: Gets every observation: a recorder, a view. It must return quickly; what it raises ends it alone.
Subscriber: TypeAlias = Callable[[Observation], None]
#: Gets what the controller makes of each observation, on the same terms.
Watcher: TypeAlias = Callable[[Belief], None]

Told = TypeVar("Told")

#: How long an opening hand may take before it is stopped where it is.
_OPENING_S = 10.0
#: Until two frames have told the sensor's own rate, it gets this long for each.
_FIRST_FRAME_S = 2.0
#: The period follows the frames with this weight, so that one late frame doesn't loosen the limit.
_PERIOD_WEIGHT = 0.1


class _Feed:
    """Frames that are fresh, or an error: nothing is decided on what the sensor felt long ago."""

    def __init__(self, array: PressureArray, *, clock: Clock, plan: Plan) -> None:
        self._array, self._clock, self._safety = array, clock, plan.safety
        self._last_s: float | None = None
        self._period_s: float | None = None

    def next(self) -> Frame:
        stale_after_s = (
            _FIRST_FRAME_S if self._period_s is None else self._safety.stale_after_s(self._period_s)
        )
        frame = self._array.read(timeout_s=stale_after_s)
        age_s = self._clock.now_s() - frame.time_s
        if age_s > stale_after_s:
            raise DeviceTimeoutError(
                f"the newest frame is {age_s:.2f} s old (limit {stale_after_s:.2f} s); "
                "check the sensor's cable and that nothing else loads this machine"
            )
        if self._last_s is not None:
            period_s = frame.time_s - self._last_s
            old_s = period_s if self._period_s is None else self._period_s
            self._period_s = old_s + _PERIOD_WEIGHT * (period_s - old_s)
        self._last_s = frame.time_s
        return frame


class _Hand:
    """The gripper, held to what it was told."""

    def __init__(self, gripper: Gripper, *, plan: Plan) -> None:
        self._gripper, self._plan = gripper, plan
        self._limits, self._safety = plan.gripper, plan.safety
        self._following: Following | None = None
        self._last: GripperState | None = None

    def state(self) -> GripperState:
        """Return its state."""
        self._last = self._gripper.state()
        return self._last

    def check(self, observation: Observation) -> None:
        """Raise `DeviceError` if it is not where it was sent."""
        if self._following is None:
            return
        complaint = self._following.complaint(
            observation.gripper,
            now_s=observation.frame.time_s,
            limits=self._limits,
            safety=self._safety,
        )
        if complaint is not None:
            raise DeviceError(complaint)

    def send(self, move: Move, *, now_s: float) -> Belief:
        """Send a move's command, if there is one, and follow it; return the belief, told of it."""
        belief, command = move
        if command is None:
            return belief
        sent = self._gripper.command(command)
        if self._last is not None:
            self._following = Following.of(
                sent, state=self._last, now_s=now_s, limits=self._limits, safety=self._safety
            )
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

    Ctrl-C, SIGTERM and `requests.stop` end the grasp with outcome `stopped`, a silent or lost array
    and a pixel that fails with `sensor_lost`, a gripper that fails or does not go where it is sent
    with `gripper_fault`; the result's `faults` say why. What that means for the hand is in
    `palpate.grasp.safety`.
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
                    frame = feed.next()
                except DeviceError as error:
                    faults.append(str(error))
                    lost = stopped(belief, Danger.SENSOR_LOST, plan=plan)
                    belief = hand.send(lost, now_s=clock.now_s())
                    if belief.phase is Phase.RELEASE:
                        faults += hand.finish_opening(clock)
                        break
                    continue
                observation = Observation(frame=frame, gripper=hand.state())
                move = step(belief, observation, plan=plan)
                ill = pixels.complaint(observation)
                if ill is not None and move[0].phase not in (Phase.RELEASE, Phase.STOPPED):
                    faults.append(ill)
                    move = stopped(move[0], Danger.SENSOR_LOST, plan=plan)
                _tell(views, observation, faults)
                # Whatever fails from here on is told of this moment.
                belief = move[0]
                hand.check(observation)
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
        faults.append(f"the hand could not be told to stop: {unstopped}")
        belief, _ = stopped(belief, Danger.GRIPPER_FAULT, plan=plan)
    return replace(
        belief.result,
        faults=(*belief.result.faults, *faults),
        frames=belief.frames,
        frames_lost=belief.lost,
        peak_force_n=belief.peak_force_n if belief.contact_s is not None else None,
    )


def _asked(belief: Belief, requests: Requests, *, plan: Plan) -> Move | None:
    """Return the move that a request asks for; an opening that has begun is completed."""
    if belief.phase is Phase.RELEASE:
        return None
    if requests.stop.is_set():
        return stopped(belief, Danger.STOPPED, plan=plan)
    if requests.release.is_set():
        return released(belief, plan=plan)
    return None


def _tell(views: list[Callable[[Told], None]], told: Told, faults: list[str]) -> None:
    for view in tuple(views):
        try:
            view(told)
        # Whatever a recorder or view does wrong, the hand must not feel it; the result tells.
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
