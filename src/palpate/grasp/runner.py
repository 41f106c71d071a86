"""Control loop of a grasp, which owns the devices and always leaves the gripper safe."""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import TypeAlias, TypeVar

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.config import GUARDS, READING
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
from palpate.sensor.array import Frame, PressureArray, find_impossible_count, read_newest
from palpate.stop_signals import handle_once, handle_stop_signals

#: Receives every observation, for a recorder or view. It must return quickly; after an exception it
#: is called no more, and the grasp continues.
Subscriber: TypeAlias = Callable[[Observation], None]
#: Receives the grasp state after every observation, under the same conditions.
Watcher: TypeAlias = Callable[[GraspState], None]

_Event = TypeVar("_Event")


class _FrameReader:
    """Reads the newest frame; raises an error for stale or impossible ones."""

    def __init__(self, array: PressureArray, *, clock: Clock, plan: Plan) -> None:
        self._array, self._clock, self._safety = array, clock, plan.safety
        self._layout = plan.layout
        self._last_s: float | None = None
        self._intervals_s = deque[float](maxlen=GUARDS.period_frames)
        #: Frames skipped since the last one returned, and in all after the first one.
        self._skipped = self.skipped = 0
        #: Largest age of a frame returned.
        self.largest_age_s = 0.0

    def read(self, hand: _Hand, estimate: ContactEstimate) -> Frame | Alarm:
        """Return the newest frame, or an alarm of the hand during the wait.

        An old frame is not stale as long as newer ones arrive: this program may have been late to
        read it. It is skipped, and a newer one must arrive in time.
        """
        stale_after_s = GUARDS.patience_s
        if len(self._intervals_s) >= READING.fewest_frames:
            stale_after_s = self._safety.stale_after_s(median(self._intervals_s))
        until_s, polled = self._clock.now_s() + stale_after_s, False
        is_late = False
        while True:
            left_s = until_s - self._clock.now_s()
            every_s = hand.poll_interval_s(self._clock.now_s()) or left_s
            try:
                frame = read_newest(
                    self._array,
                    clock=self._clock,
                    timeout_s=max(min(every_s, left_s), 0.0),
                    fresh_s=self._safety.latency_s,
                )
            except DeviceTimeoutError as late:
                if every_s < left_s:
                    polled = True
                    alarm = hand.poll(estimate, now_s=self._clock.now_s())
                    if alarm is not None:
                        return alarm
                    continue
                if not polled:
                    raise
                raise DeviceTimeoutError(
                    f"no frame in {stale_after_s:.2f} s; check the sensor's cable and power"
                ) from late
            self._skipped += frame.skipped
            age_s = self._clock.now_s() - frame.time_s
            if not age_s > stale_after_s:
                break
            now_s = self._clock.now_s()
            if is_late and now_s >= until_s:
                raise DeviceTimeoutError(
                    f"the latest frame is {age_s:.2f} s old (limit {stale_after_s:.2f} s); "
                    "check the sensor's cable and the load on this computer"
                )
            # From the first look at an old frame on, a newer one must arrive in time.
            until_s, is_late = until_s if is_late else now_s + stale_after_s, True
            self._skipped += 1
        self._check(frame, age_s=age_s, stale_after_s=stale_after_s)
        if self._last_s is not None:
            self._intervals_s.append(frame.time_s - self._last_s)
            self.skipped += self._skipped
        self._last_s = frame.time_s
        self.largest_age_s = max(self.largest_age_s, age_s)
        if frame.skipped != self._skipped:
            frame = replace(frame, skipped=self._skipped)
        self._skipped = 0
        return frame

    def _check(self, frame: Frame, *, age_s: float, stale_after_s: float) -> None:
        if not -age_s <= stale_after_s:
            raise DeviceError(
                f"the latest frame is dated {-age_s:.2f} s in the future; the times of the array "
                "must be those of the rig's clock"
            )
        if self._last_s is not None and frame.time_s <= self._last_s:
            raise DeviceError(
                f"frame times do not increase: {frame.time_s:.3f} s follows {self._last_s:.3f} s; "
                "check the timestamps of the array"
            )
        wrong = find_impossible_count(frame, layout=self._layout)
        if wrong is not None:
            raise DeviceError(wrong)


class _Hand:
    """The gripper, with checks of its movement and current."""

    def __init__(self, gripper: Gripper, *, clock: Clock, plan: Plan) -> None:
        self._gripper, self._clock, self._plan = gripper, clock, plan
        self._limits, self._safety = plan.gripper, plan.safety
        self._current = CurrentMonitor(plan)
        self._speed = SpeedMonitor(plan.gripper, safety=plan.safety)
        self._tracking: CommandTracking | None = None
        #: The first command since the last idle check.
        self._unchecked: CommandTracking | None = None
        self._idle = 0
        self._last: GripperState | None = None
        self._asked_s, self._replies, self._waited_s = 0.0, 0, 0.0

    @property
    def mean_reply_s(self) -> float:
        """Mean time of a report, seconds."""
        return self._waited_s / max(self._replies, 1)

    def state(self) -> GripperState:
        """Return the gripper's state.

        Raises `DeviceError` if the gripper does not answer, or reports an impossible state.
        """
        self._asked_s = self._clock.now_s()
        state = self._gripper.state()
        self._replies += 1
        self._waited_s += self._clock.now_s() - self._asked_s
        wrong = find_impossible_value(state, limits=self._limits, before=self._last)
        if wrong is not None:
            raise DeviceError(wrong)
        self._last = state
        return state

    def check(
        self, state: GripperState, estimate: ContactEstimate, *, now_s: float
    ) -> Alarm | None:
        """Return an alarm if the hand does not follow its command or presses too hard."""
        fault = None
        if self._tracking is not None:
            fault = self._tracking.find_fault(
                state, now_s=now_s, limits=self._limits, safety=self._safety
            )
        fault = fault or self._speed.find_fault(
            state, tracking=self._tracking, asked_s=self._asked_s
        )
        if fault is not None:
            return Alarm(danger=Danger.GRIPPER_FAULT, message=fault)
        return self._current.check(state, estimate=estimate)

    def poll_interval_s(self, now_s: float) -> float | None:
        """Return the interval of checks between frames; None without such checks."""
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
        """Send a command and track it; return the closure that the gripper accepted.

        Raises `DeviceError` if the gripper does not answer, or did not move on the last commands.
        """
        if self._unchecked is not None and self._last is not None:
            idle = self._unchecked.is_idle(
                self._last, now_s=now_s, limits=self._limits, least=self._plan.visible_travel
            )
            if idle is not None:
                self._idle = (self._idle + 1) * idle
            if idle is not None or now_s >= self._unchecked.ends_s:
                self._unchecked = None
            # An opening command is always sent.
            if self._idle >= GUARDS.idle_commands and command.target != self._limits.target(0.0):
                raise DeviceError(
                    f"the gripper did not move after {GUARDS.idle_commands} commands; check for a "
                    "blockage, a locked servo or a missing supply, and the limits of travel stored "
                    "in it"
                )
        sent = self._gripper.command(command)
        if self._last is not None:
            self._tracking = CommandTracking.start(
                sent,
                state=self._last,
                now_s=now_s,
                limits=self._limits,
                safety=self._safety,
                earlier=self._tracking,
                sending_s=self._clock.now_s() - self._last.time_s,
            )
            # Commands in quicker succession than the hand can move are checked together, unless
            # the later one cancels the movement.
            earlier = self._unchecked
            if earlier is None or not earlier.is_continued_by(sent):
                self._unchecked = self._tracking
        # Grippers clamp and round commands.
        return closure_of(sent.target, self._plan)

    def finish_opening(self, state: GraspState, *, clock: Clock) -> None:
        """Wait for the end of an opening according to the gripper's reports, without frames.

        The sensor has failed, and a gripper on the same board may not answer either.
        """
        until_s = clock.now_s() + self._plan.longest_opening_s
        try:
            while self._gripper.state().moving and clock.now_s() < until_s:
                clock.sleep_s(0.02)
        except DeviceError as error:
            state.add_fault(str(error))
        state.enter(Phase.DONE)

    def stop(self) -> Exception | None:
        """Stop the gripper; return the error if that failed."""
        try:
            self._gripper.stop()
        except Exception as error:
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
    """Run one grasp to its end; afterwards the gripper is at rest or open.

    Faults and requests end the grasp with an outcome:

    - `stopped`: Ctrl-C, SIGTERM, SIGHUP, or `requests.stop`.
    - `sensor_lost`: an array without frames, a failed pixel, or a sheet that shows less force than
      the gripper exerts.
    - `gripper_fault`: a gripper that fails or does not follow its commands, or an error of this
      program or a driver.
    - `force_limit`: force above the ceiling, from the sheet or the servo current.

    The result's `faults` have the reasons. `palpate.grasp.safety` defines the hand's movement.
    """
    controller, reader = GraspController(plan), _FrameReader(array, clock=clock, plan=plan)
    state, hand = controller.state, _Hand(gripper, clock=clock, plan=plan)
    board, pixels, rest = BoardMonitor(), PixelMonitor(plan), RestMonitor(plan)
    views, watching = list(subscribers), list(watchers)
    requests = Requests() if requests is None else requests

    def send(command: GripperCommand | None, now_s: float) -> None:
        if command is not None:
            state.estimate.sent = hand.send(command, now_s=now_s)

    def advance() -> None:
        """Process the next frame, an alarm while waiting for it, or its absence."""
        try:
            frame = reader.read(hand, state.estimate)
        except DeviceError as error:
            lost = Alarm(danger=Danger.SENSOR_LOST, message=str(error))
            send(controller.stop(lost), clock.now_s())
            if state.phase is Phase.RELEASE:
                hand.finish_opening(state, clock=clock)
        else:
            if isinstance(frame, Alarm):
                send(_apply_alarm(frame, controller, None), clock.now_s())
            else:
                send(process(frame), frame.time_s)
                if watching:
                    _notify(watching, state.snapshot(), state)

    def process(frame: Frame) -> GripperCommand | None:
        """Return the controller's command after a frame, or the reaction to an alarm."""
        seen = Observation(frame=frame, gripper=hand.state())
        failed = pixels.check(seen)
        command = None
        # Uncertain frames are skipped, except during an opening, which needs no pixels.
        if pixels.is_frame_uncertain and state.phase is not Phase.RELEASE:
            state.estimate.count_frame(frame)
        else:
            command = controller.step(seen)
        _notify(views, seen, state)
        warning = pixels.saturation_warning
        if warning is not None and warning not in state.result.faults:
            state.add_fault(warning)
        alarm = board.check(seen, state) or failed or rest.check(seen, state)
        alarm = alarm or hand.check(seen.gripper, state.estimate, now_s=frame.time_s)
        return command if alarm is None else _apply_alarm(alarm, controller, command)

    try:
        with _set_flag_on_signal(requests.stop):
            while not state.has_ended:
                # Requests do not interrupt an opening.
                is_opening = state.phase is Phase.RELEASE
                if requests.stop.is_set() and not is_opening:
                    send(controller.stop(Alarm(danger=Danger.STOPPED)), clock.now_s())
                elif requests.release.is_set() and not is_opening:
                    send(controller.release(), clock.now_s())
                else:
                    advance()
    except DeviceError as error:
        controller.stop(Alarm(danger=Danger.GRIPPER_FAULT, message=str(error)))
    except KeyboardInterrupt:
        controller.stop(Alarm(danger=Danger.STOPPED))
    # An error of this program or of a driver must not leave the hand unwatched.
    except Exception as error:
        controller.stop(Alarm(danger=Danger.GRIPPER_FAULT, message=_explain(error)))
    finally:
        unstopped = hand.stop()
    if unstopped is not None:
        message = f"the stop command failed: {unstopped}"
        controller.stop(Alarm(danger=Danger.GRIPPER_FAULT, message=message))
    if reader.skipped > state.estimate.frames:
        state.add_fault(_explain_skipped_frames(reader, hand, state.estimate))
    return replace(state.final_result, largest_frame_age_s=reader.largest_age_s)


def _explain_skipped_frames(reader: _FrameReader, hand: _Hand, estimate: ContactEstimate) -> str:
    frames, why = reader.skipped + estimate.frames, "this computer was busy with other work"
    if hand.mean_reply_s > estimate.duration_s / frames:
        why = (
            f"each report of the gripper took {hand.mean_reply_s:.3f} s; a shorter latency of "
            "its adapter or a lower frame rate avoids this"
        )
    return f"{reader.skipped} of {frames} frames were skipped: {why}"


def _apply_alarm(
    alarm: Alarm, controller: GraspController, command: GripperCommand | None
) -> GripperCommand | None:
    """End the grasp after an alarm, unless it has ended or the hand is opening.

    Raises `DeviceError` if the gripper has failed, because a failed gripper must receive only a
    stop command.
    """
    if alarm.danger is Danger.GRIPPER_FAULT:
        raise DeviceError(alarm.message)
    if controller.state.phase in (Phase.RELEASE, Phase.DONE):
        return command
    return controller.stop(alarm)


def _explain(error: Exception) -> str:
    """Describe an unexpected error, with the place where it was raised."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(last.filename).name}, line {last.lineno}"
    return f"the program failed: {type(error).__name__}: {error} ({where}); please report this"


def _notify(views: list[Callable[[_Event], None]], event: _Event, state: GraspState) -> None:
    for view in tuple(views):
        try:
            view(event)
        # An error of a recorder or view must not affect the hand; it is reported as a fault.
        except Exception as error:
            views.remove(view)
            name = getattr(view, "__name__", type(view).__name__)
            state.add_fault(f"{name} failed and was removed: {error}")


@contextmanager
def _set_flag_on_signal(requested: threading.Event) -> Iterator[None]:
    """Set a flag on Ctrl-C, SIGTERM or SIGHUP, so that no device transfer is interrupted.

    A repeated signal interrupts a device that does not return (`handle_once`).
    """
    with handle_stop_signals(handle_once(requested.set)):
        yield
