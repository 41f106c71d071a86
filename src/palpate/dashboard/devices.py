"""The process that owns the devices: it watches, carries out orders, and hears a stop at once.

It shares nothing with the page but a pipe. If the page's process is gone, whatever runs is stopped
as by the stop button, and this process ends.
"""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from palpate.clock import ManualClock
from palpate.dashboard.calibrating import calibrate_force, calibrate_rest
from palpate.dashboard.examining import look_at
from palpate.dashboard.grasping import grasp, open_hand
from palpate.dashboard.language import Message, error_text
from palpate.dashboard.messages import (
    Began,
    BeingRecorded,
    Calibrated,
    CalibrateForce,
    CalibrateRest,
    Confirm,
    Ended,
    Examine,
    Goodbye,
    Grasped,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    Pause,
    Play,
    Record,
    ReleaseNow,
    Seek,
    SetSpeed,
    StopNow,
    Stopped,
    Trouble,
    Urgent,
)
from palpate.dashboard.outlet import Outlet
from palpate.dashboard.pacing import PacedArray
from palpate.dashboard.replaying import play
from palpate.dashboard.station import BenchOpener, Station, state_of
from palpate.dashboard.transport import Transport
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.grasp.requests import Requests
from palpate.recording import RecordingWriter
from palpate.rig import Rig, open_rig
from palpate.rig.recorded import recording_info
from palpate.rig.sensor_only import SensorRig, names_no_gripper, open_sensor
from palpate.sensor.health import Health

#: A silent sensor must not make an order wait; a lost one is asked again after a while.
_WATCH_TIMEOUT_S, _LOST_S = 0.2, 0.5


def run_devices(connection: Connection, benches: dict[str, BenchOpener]) -> None:
    """Serve the page at the other end of a pipe until it is gone: the process's main function."""
    # Ctrl-C in the terminal reaches this process too; while a grasp runs, the runner hears it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Devices(connection, benches=benches).run()


class Devices:
    """Carries out one order after the other, and watches the sensor in between.

    Parameters
    ----------
    connection : Connection
        Orders and requests come in, updates go out.
    benches : dict
        Opens the bench with a load cell, for rigs that have one.
    """

    def __init__(self, connection: Connection, *, benches: dict[str, BenchOpener]) -> None:
        self._connection, self._benches = connection, benches
        self._lock = threading.Lock()
        self._orders: deque[Order] = deque()
        self._arrived = threading.Event()
        self._gone = threading.Event()
        self._station: Station | None = None
        self._requests = Requests()
        self._confirmed = threading.Event()
        self._transport: Transport | None = None
        self._stop_asked_s: float | None = None
        self._stop_number = self._stop_confirmed = 0
        self._writer: RecordingWriter | None = None
        self._troubled = ""
        self._outlet = Outlet(connection.send, on_lost=lambda: self._hear(Goodbye()))

    def run(self) -> None:
        """Serve until the page is gone; leave the hand standing still."""
        threading.Thread(target=self._listen, name="listen", daemon=True).start()
        self._outlet.start()
        try:
            while not self._gone.is_set():
                self._heed_stop()
                order = self._next_order()
                if order is not None:
                    self._carry_out(order)
                elif self._station is not None:
                    self._watch(self._station)
                else:
                    self._arrived.wait(_WATCH_TIMEOUT_S)
        finally:
            self._let_go()
            self._outlet.close()

    # -- what comes in --------------------------------------------------------------------------

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                self._hear(self._connection.recv())
        self._hear(Goodbye())

    def _hear(self, message: Order | Urgent) -> None:
        station = self._station
        match message:
            case StopNow():
                self._stop_number = message.number
                self._stop(station)
            case Goodbye():
                self._gone.set()
                self._stop(station)
            case ReleaseNow():
                self._requests.release.set()
            case Confirm():
                self._confirmed.set()
            case Seek() | Pause() | SetSpeed() if (transport := self._transport) is not None:
                _steer(transport, message)
            case SetSpeed():
                if station is not None and isinstance(station.array, PacedArray):
                    station.array.speed = message.speed
            case Seek() | Pause():
                pass  # the replay has just ended
            case _:
                with self._lock:
                    self._orders.append(message)
                self._arrived.set()
        if station is not None and isinstance(station.array, PacedArray):
            station.array.hurry()

    def _stop(self, station: Station | None) -> None:
        """Stop what runs, and whatever was to run next: no order may outlive a stop."""
        with self._lock:
            dropped = list(self._orders)
            self._orders.clear()
            if station is not None and not self._requests.stop.is_set():
                self._stop_asked_s = station.rig.clock.now_s()
            self._requests.stop.set()
        self._arrived.set()
        if station is None:
            self._confirm_stop()
        for order in dropped:
            self._outlet.note(Ended(order=order, trouble=Message("stopped before it began")))

    def _next_order(self) -> Order | None:
        """Take the next order, with requests of its own: a stop from now on is meant for it."""
        with self._lock:
            self._arrived.clear()
            if not self._orders:
                return None
            self._renew_requests()
            return self._orders.popleft()

    def _renew_requests(self) -> None:
        self._requests, self._stop_asked_s = Requests(), None
        if self._station is not None:
            self._station.requests, self._station.reacted_s = self._requests, None

    def _heed_stop(self) -> None:
        """Stop the hand when that was asked for between two orders, or while one ended."""
        station = self._station
        with self._lock:
            if station is None or not self._requests.stop.is_set():
                return
            # First: a stop that comes meanwhile is heeded next.
            self._renew_requests()
        self._try(station.stop_hand)

    def _confirm_stop(self) -> None:
        """Say that the hand was told, once for each stop."""
        if self._stop_confirmed < self._stop_number:
            self._stop_confirmed = self._stop_number
            self._outlet.note(Stopped(self._stop_number), at_once=True)

    # -- what is done ---------------------------------------------------------------------------

    def _carry_out(self, order: Order) -> None:
        if isinstance(order, Record):
            self._record(order)
            return
        self._outlet.note(Began(order=order))
        found: Grasped | Calibrated | Health | None = None
        trouble = ""
        try:
            found = self._done(order)
        except (PalpateError, OSError) as error:
            trouble = error_text(error)
        self._outlet.note(
            Ended(order=order, found=found, trouble=trouble, stopped_after_s=self._took_s())
        )
        station = self._station
        if isinstance(order, Play | CalibrateRest | CalibrateForce) and station is not None:
            self._outlet.begin(station.source(), events=station.link_events)
        self._outlet.think(None)

    def _done(self, order: Order) -> Grasped | Calibrated | Health | None:
        if isinstance(order, OpenRig):
            self._open(order)
            return None
        if isinstance(order, Play):
            self._play(order)
            return None
        if self._station is None:
            raise DeviceError("no rig is open: choose one")
        match order:
            case GraspOrder():
                self._record(Record(None))
                return grasp(order, station=self._station)
            case OpenHand():
                open_hand(order, station=self._station)
            case CalibrateRest():
                return calibrate_rest(order, station=self._station)
            case CalibrateForce():
                return calibrate_force(order, station=self._station)
            case Examine():
                return look_at(order, station=self._station)
        return None

    def _play(self, order: Play) -> None:
        def steered(transport: Transport) -> None:
            self._transport = transport

        try:
            play(
                order,
                outlet=self._outlet,
                requests=self._requests,
                confirmed=self._confirmed,
                steered=steered,
            )
        finally:
            self._transport = None

    def _took_s(self) -> float | None:
        """Return how long ago a stop was asked for, on the rig's clock; None if it was not."""
        with self._lock:
            station, asked_s = self._station, self._stop_asked_s
            if station is None or asked_s is None:
                return None
            told_s = station.reacted_s or station.rig.clock.now_s()
            return max(told_s - asked_s, 0.0)

    def _open(self, order: OpenRig) -> None:
        self._let_go()
        rig = _opened(order)
        paced = isinstance(rig.clock, ManualClock)
        self._station = station = Station(
            rig=rig,
            array=PacedArray(rig.array, speed=order.speed) if paced else rig.array,
            seed=order.seed,
            outlet=self._outlet,
            confirmed=self._confirmed,
            on_stopped=self._confirm_stop,
            open_bench=self._benches.get(rig.name),
        )
        self._outlet.begin(station.source(), events=station.link_events)

    def _watch(self, station: Station) -> None:
        """Read one frame and show it; record it if that was asked for."""
        try:
            frame = station.array.read(timeout_s=_WATCH_TIMEOUT_S)
        except DeviceTimeoutError:
            return
        except DeviceError as error:
            self._complain(str(error))
            self._arrived.wait(_LOST_S)
            return
        self._complain("")
        state = state_of(station.rig.gripper)
        self._outlet.see(frame, state)
        if self._writer is not None:
            try:
                if state is not None:
                    self._writer.add(state)
                self._writer.add(frame)
            except PalpateError as error:
                self._complain(str(error))
                self._record(Record(None))

    def _record(self, order: Record) -> None:
        """Begin or end a recording of what is watched."""
        try:
            if self._writer is not None:
                self._writer.close()
            self._writer = None
            if order.file is not None and self._station is not None:
                info = recording_info(self._station.rig, seed=self._station.seed)
                order.file.parent.mkdir(parents=True, exist_ok=True)
                self._writer = RecordingWriter(order.file, info=info)
        except (PalpateError, OSError) as error:
            self._writer = None
            self._complain(str(error))
        self._outlet.note(BeingRecorded(None if self._writer is None else self._writer.path))

    def _let_go(self) -> None:
        station, self._station = self._station, None
        if station is None:
            return
        self._record(Record(None))
        if station.rig.gripper is not None:
            self._try(station.rig.gripper.stop)
        self._try(station.rig.close)

    def _try(self, act: Callable[[], None]) -> None:
        try:
            act()
        except DeviceError as error:
            self._complain(str(error))

    def _complain(self, text: str) -> None:
        """Say it once, not at every frame."""
        if text != self._troubled:
            self._troubled = text
            self._outlet.note(Trouble(text))


def _steer(transport: Transport, message: Seek | Pause | SetSpeed) -> None:
    match message:
        case Seek():
            transport.seek(message.time_s)
        case Pause():
            transport.pause(message.paused)
        case SetSpeed():
            transport.set_speed(message.speed)


def _opened(order: OpenRig) -> Rig | SensorRig:
    if order.name.endswith(".toml") and names_no_gripper(Path(order.name)):
        return open_sensor(Path(order.name))
    return open_rig(order.name, object_name=order.object_name, seed=order.seed)
