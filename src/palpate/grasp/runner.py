"""The only control loop: it owns the devices and always leaves the gripper safe."""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from types import FrameType
from typing import TypeAlias, TypeVar

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.config import GUARDS
from palpate.grasp.controller import GraspController
from palpate.grasp.current_monitor import CurrentMonitor
from palpate.grasp.estimator import ContactEstimate, Observation, closure_of
from palpate.grasp.monitors import BoardMonitor, RestMonitor
from palpate.grasp.phases import Phase
from palpate.grasp.pixel_monitor import PixelMonitor
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.state import GraspState
from palpate.grasp.tracking_monitor import CommandTracking, SpeedMonitor, find_impossible_value
from palpate.gripper.interface import Gripper, GripperCommand, GripperState
from palpate.sensor.array import Frame, PressureArray, find_impossible_count

#: Gets every observation: a recorder, a view. It must return quickly; if it raises, only it ends.
Subscriber: TypeAlias = Callable[[Observation], None]
#: Gets what the controller makes of each observation, on the same terms.
Watcher: TypeAlias = Callable[[GraspState], None]

_Event = TypeVar("_Event")

#: Fewest intervals between frames that show a period, once the first frames have come.
_FEWEST_INTERVALS = 3


class _Feed:
    """Fresh frames only: an old one is an error."""

    def __init__(self, array: PressureArray, *, clock: Clock, plan: Plan) -> None:
        self._array, self._clock, self._safety = array, clock, plan.safety
        self._layout = plan.layout
        self._last_s: float | None = None
        self._intervals_s = deque[float](maxlen=GUARDS.period_frames)

    def next(self, hand: _Hand, estimate: ContactEstimate) -> Frame | Alarm:
        """Return the next frame, or the hand's alarm during the wait."""
        stale_after_s = GUARDS.patience_s
        if len(self._intervals_s) >= _FEWEST_INTERVALS:
            stale_after_s = self._safety.stale_after_s(median(self._intervals_s))
        until_s, polled = self._clock.now_s() + stale_after_s, False
        while True:
            left_s = until_s - self._clock.now_s()
            every_s = hand.poll_interval_s(self._clock.now_s()) or left_s
            try:
                frame = self._array.read(timeout_s=max(min(every_s, left_s), 0.0))
                break
            except DeviceTimeoutError as late:
                if every_s < left_s:
                    alarm, polled = hand.poll(estimate, now_s=self._clock.now_s()), True
                elif polled:
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
        if not abs(age_s) <= stale_after_s:
            raise DeviceTimeoutError(
                f"the newest frame is {age_s:.2f} s old (limit {stale_after_s:.2f} s); "
                "check the sensor's cable and that nothing else loads this machine"
            )
        if self._last_s is not None and frame.time_s <= self._last_s:
            raise DeviceError(
                f"frame times do not rise: {frame.time_s:.3f} s follows {self._last_s:.3f} s; "
                "check how the array times its frames"
            )
        wrong = find_impossible_count(frame, layout=self._layout)
        if wrong is not None:
            raise DeviceError(wrong)


class _Hand:
    """The gripper, with checks of its movement and current."""

    def __init__(self, gripper: Gripper, *, plan: Plan) -> None:
        self._gripper, self._plan = gripper, plan
        self._limits, self._safety = plan.gripper, plan.safety
        self._current = CurrentMonitor(plan)
        self._speed = SpeedMonitor(plan.gripper, safety=plan.safety)
        self._tracking: CommandTracking | None = None
        #: The first command since the hand was last seen to move, or not to.
        self._unchecked: CommandTracking | None = None
        self._idle = 0
        self._last: GripperState | None = None

    def state(self) -> GripperState:
        """Return its state.

        Raises `DeviceError` if it does not answer, or reports an impossible state.
        """
        state = self._gripper.state()
        wrong = find_impossible_value(state, limits=self._limits, before=self._last)
        if wrong is not None:
            raise DeviceError(wrong)
        self._last = state
        return state

    def check(
        self, state: GripperState, estimate: ContactEstimate, *, now_s: float
    ) -> Alarm | None:
        """Return an alarm if the hand is not at its target or presses too hard."""
        fault = None
        if self._tracking is not None:
            fault = self._tracking.find_fault(
                state, now_s=now_s, limits=self._limits, safety=self._safety
            )
        fault = fault or self._speed.find_fault(state, way=self._tracking)
        if fault is not None:
            return Alarm(danger=Danger.GRIPPER_FAULT, message=fault)
        return self._current.check(state, estimate=estimate)

    def poll_interval_s(self, now_s: float) -> float | None:
        """Return the interval of checks between frames; None if frames suffice."""
        if self._tracking is None:
            return None
        return self._tracking.poll_interval_s(now_s=now_s, limits=self._limits, safety=self._safety)

    def poll(self, estimate: ContactEstimate, *, now_s: float) -> Alarm | None:
        """Read the gripper between two frames."""
        try:
            return self.check(self.state(), estimate, now_s=now_s)
        except DeviceError as error:
            return Alarm(danger=Danger.GRIPPER_FAULT, message=str(error))

    def send(self, command: GripperCommand, *, now_s: float) -> float:
        """Send a command, and follow it; return the closure that was really sent.

        Raises `DeviceError` if it does not answer, or did not move at the last commands.
        """
        if self._unchecked is not None and self._last is not None:
            idle = self._unchecked.is_idle(self._last, now_s=now_s, limits=self._limits)
            if idle is not None:
                self._idle = (self._idle + 1) * idle
            if idle is not None or now_s >= self._unchecked.ends_s:
                self._unchecked = None
            # An opening is sent all the same.
            if self._idle >= GUARDS.idle_commands and command.target != self._limits.target(0.0):
                raise DeviceError(
                    f"the gripper was sent on {GUARDS.idle_commands} times and did not move; is it "
                    "blocked, locked or without supply?"
                )
        sent = self._gripper.command(command)
        if self._last is not None:
            self._tracking = CommandTracking.start(
                sent, state=self._last, now_s=now_s, limits=self._limits, safety=self._safety
            )
            # Commands that follow each other faster than a hand can move are judged together.
            self._unchecked = self._unchecked or self._tracking
        # Grippers clamp commands, and round them to their own steps.
        return closure_of(sent.target, self._plan)

    def finish_opening(self, state: GraspState, *, clock: Clock) -> None:
        """Wait for an opening without frames, by the gripper's own report.

        The sensor is lost already, and a gripper on the same board may be as silent.
        """
        until_s = clock.now_s() + GUARDS.max_opening_s
        try:
            while self._gripper.state().moving and clock.now_s() < until_s:
                clock.sleep_s(0.02)
        except DeviceError as error:
            state.add_fault(str(error))

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
    """Run one grasp to its end; afterwards the gripper is still or open.

    Ctrl-C, SIGTERM and `requests.stop` end the grasp with outcome `stopped`; a silent or lost
    array, a pixel that fails, and a sheet that does not show what the gripper presses with
    `sensor_lost`; a gripper that fails or does not go where it is sent with `gripper_fault`; force
    above the ceiling, by the sheet or by the servo's current, with `force_limit`. The result's
    `faults` explain why. What that means for the hand is in `palpate.grasp.safety`.
    """
    controller, feed = GraspController(plan), _Feed(array, clock=clock, plan=plan)
    state, hand = controller.state, _Hand(gripper, plan=plan)
    board, pixels, rest = BoardMonitor(), PixelMonitor(plan), RestMonitor(plan)
    views, watching = list(subscribers), list(watchers)
    requests = Requests() if requests is None else requests

    def send(command: GripperCommand | None, now_s: float) -> None:
        if command is not None:
            state.estimate.sent = hand.send(command, now_s=now_s)

    try:
        with _signals_as_flag(requests.stop):
            while not state.has_ended:
                # An opening that has begun is completed.
                if state.phase is not Phase.RELEASE:
                    if requests.stop.is_set():
                        send(controller.stop(Alarm(danger=Danger.STOPPED)), clock.now_s())
                        continue
                    if requests.release.is_set():
                        send(controller.release(), clock.now_s())
                        continue
                try:
                    frame = feed.next(hand, state.estimate)
                except DeviceError as error:
                    lost = Alarm(danger=Danger.SENSOR_LOST, message=str(error))
                    send(controller.stop(lost), clock.now_s())
                    if state.phase is Phase.RELEASE:
                        hand.finish_opening(state, clock=clock)
                        break
                    continue
                if isinstance(frame, Alarm):
                    send(_apply_alarm(frame, controller, None), clock.now_s())
                    continue
                seen = Observation(frame=frame, gripper=hand.state())
                failed = pixels.check(seen, state)
                command = None
                # Nothing is decided on an uncertain frame; an opening needs no pixel.
                if pixels.is_frame_uncertain and state.phase is not Phase.RELEASE:
                    state.estimate.count_frame(frame)
                else:
                    command = controller.step(seen)
                _notify(views, seen, state)
                if (
                    pixels.saturation_warning is not None
                    and pixels.saturation_warning not in state.result.faults
                ):
                    state.add_fault(pixels.saturation_warning)
                alarm = board.check(seen, state) or failed or rest.check(seen, state)
                alarm = alarm or hand.check(seen.gripper, state.estimate, now_s=frame.time_s)
                if alarm is not None:
                    command = _apply_alarm(alarm, controller, command)
                send(command, frame.time_s)
                _notify(watching, state.snapshot(), state)
    except DeviceError as error:
        controller.stop(Alarm(danger=Danger.GRIPPER_FAULT, message=str(error)))
    except KeyboardInterrupt:
        controller.stop(Alarm(danger=Danger.STOPPED))
    finally:
        unstopped = hand.stop()
    if unstopped is not None:
        message = f"the stop command failed: {unstopped}"
        controller.stop(Alarm(danger=Danger.GRIPPER_FAULT, message=message))
    return state.final_result


def _apply_alarm(
    alarm: Alarm, controller: GraspController, command: GripperCommand | None
) -> GripperCommand | None:
    """End the grasp by an alarm's reaction, unless the hand opens already or has ended.

    Raises `DeviceError` if it is the gripper that failed: nothing more is sent to it than a stop.
    """
    if alarm.danger is Danger.GRIPPER_FAULT:
        raise DeviceError(alarm.message)
    if controller.state.phase in (Phase.RELEASE, Phase.DONE):
        return command
    return controller.stop(alarm)


def _notify(views: list[Callable[[_Event], None]], event: _Event, state: GraspState) -> None:
    for view in tuple(views):
        try:
            view(event)
        # Any error of a recorder or view must not reach the hand; the result reports it.
        except Exception as error:
            views.remove(view)
            name = getattr(view, "__name__", type(view).__name__)
            state.add_fault(f"{name} failed and was dropped: {error}")


@contextmanager
def _signals_as_flag(requested: threading.Event) -> Iterator[None]:
    """Turn Ctrl-C and SIGTERM into a flag, so that no transfer is interrupted.

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
