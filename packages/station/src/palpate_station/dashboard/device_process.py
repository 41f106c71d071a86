"""The process that owns the devices: it reads the sensor, executes orders and handles stops.

Its only connection to the page is a pipe. If the page's process ends, the running job is stopped
like with the STOP button, and this process ends.
"""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.grasp.requests import Requests
from palpate.recording import RecordingWriter
from palpate.rig.paced_array import PacedArray
from palpate.rig.recorded import recording_info
from palpate.rig.sensor_only import open_rig_or_sensor
from palpate.sensor.health import Health
from palpate.sensor.serial_array import SerialArray
from palpate.stop_signals import install
from palpate_station.dashboard.jobs import (
    JobContext,
    StoppedByUserError,
    calibrate_force,
    calibrate_rest,
    examine_sensor,
    grasp,
    open_hand,
    read_state,
)
from palpate_station.dashboard.messages import (
    CalibrateForce,
    CalibrateRest,
    CalibrationRenewed,
    Confirm,
    Examine,
    Grasped,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    OrderEnded,
    OrderStarted,
    Pause,
    Play,
    Record,
    RecordingChanged,
    ReleaseNow,
    Request,
    Seek,
    SetSpeed,
    Shutdown,
    StopConfirmed,
    StopNow,
    Trouble,
)
from palpate_station.dashboard.replaying import PlaybackClock, play
from palpate_station.dashboard.telemetry import Telemetry

_JOBS: dict[type[Order], Callable[..., Grasped | CalibrationRenewed | Health | None]] = {
    GraspOrder: grasp,
    OpenHand: open_hand,
    CalibrateRest: calibrate_rest,
    CalibrateForce: calibrate_force,
    Examine: examine_sensor,
}
#: Read timeout between orders, so that a silent sensor delays no order, and the time before a
#: failed read is repeated, seconds.
_WATCH_TIMEOUT_S, _RETRY_S = 0.2, 0.5


def run_devices(connection: Connection) -> None:
    """Serve the page over a pipe until the pipe closes (main function of the process)."""
    # Ctrl-C, a closed terminal or a service manager also signals this process. The page ends it in
    # order, so signals are ignored, except during a grasp, when the runner handles them.
    install(signal.SIG_IGN)
    DeviceProcess(connection).run()


class DeviceProcess:
    """Executes orders one at a time, and reads the sensor between orders.

    Parameters
    ----------
    connection : Connection
        Receives orders and requests, and sends updates.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._orders: deque[Order] = deque()
        self._arrived = threading.Event()
        self._closing = threading.Event()
        self._context: JobContext | None = None
        self._requests = Requests()
        self._confirmed = threading.Event()
        self._playback: PlaybackClock | None = None
        self._stop_requested_s: float | None = None
        self._stop_number = self._stop_confirmed = 0
        self._writer: RecordingWriter | None = None
        self._last_error = ""
        self._grasping = False
        self._telemetry = Telemetry(
            connection.send, on_lost=lambda: self._handle_message(Shutdown())
        )

    def run(self) -> None:
        """Serve until the page closes the connection; then stop the hand."""
        threading.Thread(target=self._listen, name="listen", daemon=True).start()
        self._telemetry.start()
        try:
            while not self._closing.is_set():
                self._apply_stop()
                order = self._next_order()
                if order is not None:
                    self._execute(order)
                elif self._context is not None:
                    self._watch(self._context)
                else:
                    self._arrived.wait(_WATCH_TIMEOUT_S)
        finally:
            self._close_rig()
            self._telemetry.close()

    # -- incoming messages ----------------------------------------------------------------------

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                self._handle_message(self._connection.recv())
        self._handle_message(Shutdown())

    def _handle_message(self, message: Order | Request) -> None:
        context, playback = self._context, self._playback
        match message:
            case StopNow():
                self._stop_number = message.number
                self._stop(context)
            case Shutdown():
                self._closing.set()
                self._stop(context)
            case ReleaseNow() if self._grasping and not self._requests.stop.is_set():
                self._requests.release.set()
            case ReleaseNow():
                # The grasp was stopped or has already ended, so the hand opens next.
                self._queue_order(OpenHand())
            case Confirm():
                self._confirmed.set()
            case Seek() if playback is not None:
                playback.seek(message.time_s)
            case Pause() if playback is not None:
                playback.pause(message.paused)
            case SetSpeed() if playback is not None:
                playback.set_speed(message.speed)
            case SetSpeed():
                if context is not None and isinstance(context.array, PacedArray):
                    context.array.speed = message.speed
            case Seek() | Pause():
                pass  # the replay has already ended
            case _:
                self._queue_order(message)
        if context is not None and isinstance(context.array, PacedArray):
            context.array.skip_wait()

    def _queue_order(self, order: Order) -> None:
        with self._lock:
            self._orders.append(order)
        self._arrived.set()

    def _stop(self, context: JobContext | None) -> None:
        """Stop the running job and drop all queued orders."""
        with self._lock:
            dropped = list(self._orders)
            self._orders.clear()
            if context is not None and not self._requests.stop.is_set():
                self._stop_requested_s = context.rig.clock.now_s()
            self._requests.stop.set()
        self._arrived.set()
        if context is None:
            self._confirm_stop()
        for order in dropped:
            reason = "stopped before it started"
            self._telemetry.note(OrderEnded(order=order, trouble=reason, stopped=True))

    def _next_order(self) -> Order | None:
        """Return the next order, with cleared requests so that only later stops apply to it."""
        with self._lock:
            self._arrived.clear()
            if not self._orders:
                return None
            self._renew_requests()
            return self._orders.popleft()

    def _renew_requests(self) -> None:
        self._requests, self._stop_requested_s = Requests(), None
        if self._context is not None:
            self._context.requests, self._context.reacted_s = self._requests, None

    def _apply_stop(self) -> None:
        """Stop the hand if a stop was requested between orders or during one."""
        context = self._context
        with self._lock:
            if context is None or not self._requests.stop.is_set():
                return
            # Renewed before the stop is applied, so that a new stop during this call is not lost.
            self._renew_requests()
        self._report_errors(context.stop_hand)

    def _confirm_stop(self) -> None:
        """Confirm that the hand has received the latest stop, once per stop."""
        if self._stop_confirmed < self._stop_number:
            self._stop_confirmed = self._stop_number
            self._telemetry.note(StopConfirmed(self._stop_number), at_once=True)

    # -- execution of orders --------------------------------------------------------------------

    def _execute(self, order: Order) -> None:
        if isinstance(order, Record):
            self._record(order)
            return
        if isinstance(order, Play):
            self._playback = PlaybackClock(speed=order.speed)
        self._telemetry.note(OrderStarted(order=order))
        found: Grasped | CalibrationRenewed | Health | None = None
        trouble, stopped = "", False
        self._grasping = isinstance(order, GraspOrder)
        try:
            found = self._run_order(order)
        except (PalpateError, OSError) as error:
            # A failure during a stop is reported as a failure, not as a stop.
            trouble, stopped = str(error), isinstance(error, StoppedByUserError)
        finally:
            self._grasping, self._playback = False, None
        context = self._context
        if isinstance(order, Play | CalibrateRest | CalibrateForce) and context is not None:
            # Restarted before the end is reported, so that the next order finds a fresh link.
            self._start_telemetry(context)
        self._telemetry.note(
            OrderEnded(
                order=order,
                found=found,
                trouble=trouble,
                stopped=stopped,
                stopped_after_s=self._stop_delay_s(),
            )
        )
        self._telemetry.set_plan(None)

    def _run_order(self, order: Order) -> Grasped | CalibrationRenewed | Health | None:
        if isinstance(order, OpenRig):
            self._open(order)
            return None
        if isinstance(order, Play) and self._playback is not None:
            play(
                order.file,
                telemetry=self._telemetry,
                requests=self._requests,
                confirmed=self._confirmed,
                playback=self._playback,
            )
            return None
        if self._context is None:
            raise DeviceError("no rig is open: choose one")
        if isinstance(order, GraspOrder):
            self._record(Record(None))
        return _JOBS[type(order)](order, context=self._context)

    def _stop_delay_s(self) -> float | None:
        """Return the time until the hand received the stop, rig clock; None without a stop."""
        with self._lock:
            context, requested_s = self._context, self._stop_requested_s
            if context is None or requested_s is None:
                return None
            received_s = context.reacted_s or context.rig.clock.now_s()
            return max(received_s - requested_s, 0.0)

    def _open(self, order: OpenRig) -> None:
        self._close_rig()
        rig = open_rig_or_sensor(
            order.name, object_name=order.object_name, seed=order.seed, rate_hz=order.rate_hz
        )
        paced = isinstance(rig.clock, ManualClock)
        self._context = context = JobContext(
            rig=rig,
            array=PacedArray(rig.array, speed=order.speed) if paced else rig.array,
            seed=order.seed,
            telemetry=self._telemetry,
            confirmed=self._confirmed,
            on_stopped=self._confirm_stop,
        )
        self._start_telemetry(context)

    def _start_telemetry(self, context: JobContext) -> None:
        """Send the rig's frames to the page from now on."""
        twin = isinstance(context.array, PacedArray) and not isinstance(
            context.rig.array, SerialArray
        )
        self._telemetry.begin(context.source(), events=context.link_events, linked=not twin)

    def _watch(self, context: JobContext) -> None:
        """Read and send one frame, and record it during a recording."""
        try:
            frame = context.array.read(timeout_s=_WATCH_TIMEOUT_S)
        except DeviceTimeoutError:
            return
        except DeviceError as error:
            self._report_error(str(error))
            self._arrived.wait(_RETRY_S)
            return
        self._report_error("")
        state = read_state(context.rig.gripper)
        self._telemetry.add_frame(frame, state)
        if self._writer is not None:
            try:
                if state is not None:
                    self._writer.add(state)
                self._writer.add(frame)
            except PalpateError as error:
                self._report_error(str(error))
                self._record(Record(None))

    def _record(self, order: Record) -> None:
        """Start or end a recording of the frames between orders."""
        try:
            if self._writer is not None:
                self._writer.close()
            self._writer = None
            if order.file is not None and self._context is not None:
                info = recording_info(self._context.rig, seed=self._context.seed)
                order.file.parent.mkdir(parents=True, exist_ok=True)
                self._writer = RecordingWriter(order.file, info=info)
        except (PalpateError, OSError) as error:
            self._writer = None
            self._report_error(str(error))
        self._telemetry.note(RecordingChanged(None if self._writer is None else self._writer.path))

    def _close_rig(self) -> None:
        context, self._context = self._context, None
        if context is None:
            return
        self._record(Record(None))
        if context.rig.gripper is not None:
            self._report_errors(context.rig.gripper.stop)
        self._report_errors(context.rig.close)

    def _report_errors(self, act: Callable[[], None]) -> None:
        try:
            act()
        except DeviceError as error:
            self._report_error(str(error))

    def _report_error(self, text: str) -> None:
        """Report an error if it differs from the last reported error."""
        if text != self._last_error:
            self._last_error = text
            self._telemetry.note(Trouble(text))
