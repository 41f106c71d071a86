"""A thread that owns a rig: it reads the sensor, grasps, and ends safely."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.grasp.damage_limit import choose_limit
from palpate.grasp.estimator import Observation
from palpate.grasp.result import Outcome
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.object.damage_file import DamageFile
from palpate.rig import Rig
from palpate.rig.job import GraspJob
from palpate.sensor.array import Frame, PressureArray

#: Timeout of a frame, and pause after a fault, seconds.
_FRAME_S, _RETRY_S = 0.5, 0.5
#: Time limit of approach and squeeze, in addition to the hold, seconds.
_CLOSING_S = 120.0
#: Outcomes after which the hand keeps its position, and a held object, until a release.
_STOPPED_OUTCOMES = (Outcome.STOPPED, Outcome.SENSOR_LOST, Outcome.GRIPPER_FAULT)

#: Called with every frame and the gripper's state; None if the gripper does not reply.
Viewer = Callable[[Frame, GripperState | None], None]


@dataclass(slots=True, eq=False)
class Grasping:
    """A running grasp, shared with other threads; `over` is set after its last command."""

    job: GraspJob
    over: threading.Event = field(default_factory=threading.Event)


@dataclass(slots=True, eq=False)
class Moving:
    """A running opening to a width, or fully (None)."""

    width_mm: float | None
    stop: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    refusal: str = ""


class Hand:
    """A rig operated by its own thread.

    Parameters
    ----------
    rig : Rig
        Open rig, which `close` closes.
    array : PressureArray
        The rig's array, or the same array paced to real time.
    hold_s : float
        Duration of a hold without a request; the object is then released.
    damage : path or None
        File of a damage limit that each grasp obeys.
    viewer, on_fault : callable
        Called with every frame, and with every fault.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        array: PressureArray,
        hold_s: float,
        damage: Path | None,
        viewer: Viewer,
        on_fault: Callable[[str], None],
    ) -> None:
        self._rig, self._array, self._hold_s = rig, array, hold_s
        self._damage = None if damage is None else DamageFile.load(damage)
        self._damage_path, self._viewer, self._on_fault = damage, viewer, on_fault
        self._orders: queue.Queue[Grasping | Moving] = queue.Queue()
        self._ending, self._lock = threading.Event(), threading.Lock()
        self._now: Grasping | Moving | None = None
        #: Whether the hand may hold an object after a stop; it must then be released first.
        self._gripped = False
        self.state: GripperState | None = None
        self._thread = threading.Thread(target=self._work, name="palpate-hand", daemon=True)
        self._thread.start()

    @property
    def limits(self) -> Any:
        """Drive and range of the gripper."""
        return self._rig.gripper.limits

    def grasp(self, *, target_force_n: float | None, kind: str = "") -> Grasping | None:
        """Start a grasp; return None if the hand is busy or may hold an object.

        Raises `InputError` or `CalibrationError` if this grasp is not possible.
        """
        job = GraspJob(
            self._rig,
            target_force_n=target_force_n,
            limit=choose_limit(self._damage, path=self._damage_path, kind=kind or None),
            array=self._array,
            hold_s=self._hold_s,
            longest_s=self._hold_s + _CLOSING_S,
        )
        with self._lock:
            if self._now is not None or self._gripped:
                return None
            self._now = order = Grasping(job)
        self._orders.put(order)
        return order

    def open(self, width_mm: float | None = None) -> Moving | None:
        """Open fully or to a width; a held object is released fully.

        Returns None if the hand is already moving.
        """
        with self._lock:
            busy = self._now
            if isinstance(busy, Grasping):
                busy.job.requests.release.set()
                self._now = order = Moving(width_mm=None)
            elif busy is not None:
                return None
            else:
                self._now = order = Moving(width_mm=None if self._gripped else width_mm)
        self._orders.put(order)
        return order

    def stop(self) -> None:
        """Stop the hand immediately; rigid fingers keep their position, soft fingers vent."""
        with self._lock:
            busy = self._now
        if isinstance(busy, Grasping):
            busy.job.requests.stop.set()
        elif busy is not None:
            busy.stop.set()

    def close(self) -> None:
        """Stop, wait until the hand is safe, and close the rig."""
        self.stop()
        self._ending.set()
        self._thread.join()
        self._rig.close()

    # -- on its own thread ------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._ending.is_set():
            try:
                order = self._orders.get_nowait()
            except queue.Empty:
                self._watch()
                continue
            if isinstance(order, Grasping):
                self._grasp(order)
            else:
                self._move(order)
            with self._lock:
                if self._now is order:
                    self._now = None

    def _watch(self) -> None:
        try:
            frame = self._array.read(timeout_s=_FRAME_S)
        except DeviceTimeoutError as error:
            self._on_fault(str(error))
            return
        except DeviceError as error:
            self._on_fault(str(error))
            self._ending.wait(_RETRY_S)
            return
        try:
            self.state = self._rig.gripper.state()
        except DeviceError as error:
            self._on_fault(str(error))
            self.state = None
        self._viewer(frame, self.state)

    def _grasp(self, order: Grasping) -> None:
        def show_frame(observation: Observation) -> None:
            self.state = observation.gripper
            self._viewer(observation.frame, observation.gripper)

        try:
            result = order.job.run(subscribers=[show_frame])
            self._gripped = result.outcome in _STOPPED_OUTCOMES
            for fault in result.faults:
                self._on_fault(fault)
        except PalpateError as error:
            self._on_fault(str(error))
        finally:
            order.job.known.set()
            order.over.set()

    def _move(self, order: Moving) -> None:
        gripper, limits = self._rig.gripper, self._rig.gripper.limits
        try:
            if order.stop.is_set():
                order.refusal = "stopped"
                return
            if order.width_mm is None:
                gripper.release()
            else:
                gripper.command(GripperCommand(target=order.width_mm, rate=limits.fastest))
            self._gripped = False
            self._watch()
            while self.state is not None and self.state.moving:
                self._watch()
                if order.stop.is_set():
                    gripper.stop()
                    order.refusal = "stopped"
                    return
        except DeviceError as error:
            order.refusal = str(error)
            self._on_fault(str(error))
        finally:
            order.over.set()
