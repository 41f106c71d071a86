"""The thread that owns a rig: it reads the sensor, grasps, and leaves safely."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from palpate import plan_grasp, run_grasp
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.rig import Rig
from palpate.sensor.array import Frame, PressureArray

_FRAME_S, _RETRY_S = 0.5, 0.5
#: Approach and squeeze may take so long beside the hold.
_CLOSING_S = 120.0
#: These leave the hand where it is: what it holds is held until it is asked back.
_LEFT_STANDING = (Outcome.STOPPED, Outcome.SENSOR_LOST, Outcome.GRIPPER_FAULT)

#: Gets every frame with the hand's state; None where the hand does not answer.
Viewer = Callable[[Frame, GripperState | None], None]


@dataclass(slots=True, eq=False)
class Grasping:
    """One grasp under way, as other threads see it.

    Attributes
    ----------
    grasp_state : GraspState
        The newest.
    known : Event
        Set when there is an answer and the object is held, or the grasp is over.
    result : GraspResult or None
        What `known` made known; None after it where the equipment refused to begin.
    refusal : str
        Why it did not begin.
    over : Event
        Set when nothing more will be commanded.
    """

    target_force_n: float | None
    kind: str
    grasp_state: GraspState = field(default_factory=GraspState)
    requests: Requests = field(default_factory=Requests)
    known: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    result: GraspResult | None = None
    refusal: str = ""


@dataclass(slots=True, eq=False)
class Moving:
    """An opening under way: to a width, or fully (None)."""

    width_mm: float | None
    stop: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    refusal: str = ""


class Hand:
    """A rig at work on a thread of its own.

    Parameters
    ----------
    rig : Rig
        Open; closed at the end.
    array : PressureArray
        The rig's, or the same held to the wall's clock.
    hold_s : float
        How long an object is held before it is released unasked.
    options : dict
        Further options of each plan: `damage`.
    viewer, complain : callable
        Get every frame, and every fault outside a grasp.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        array: PressureArray,
        hold_s: float,
        options: dict[str, Any],
        viewer: Viewer,
        complain: Callable[[str], None],
    ) -> None:
        self._rig, self._array, self._hold_s = rig, array, hold_s
        self._options, self._viewer, self._complain = options, viewer, complain
        self._orders: queue.Queue[Grasping | Moving] = queue.Queue()
        self._ending, self._lock = threading.Event(), threading.Lock()
        self._now: Grasping | Moving | None = None
        #: The hand stands closed on something after a stop: release comes before anything else.
        self._gripped = False
        self.state: GripperState | None = None
        self._thread = threading.Thread(target=self._work, name="palpate-hand", daemon=True)
        self._thread.start()

    @property
    def limits(self) -> Any:
        """Drive and range of the gripper."""
        return self._rig.gripper.limits

    def grasp(self, *, target_force_n: float | None, kind: str = "") -> Grasping | None:
        """Begin a grasp; None while the hand is at work or closed on something."""
        with self._lock:
            if self._now is not None or self._gripped:
                return None
            self._now = order = Grasping(target_force_n=target_force_n, kind=kind)
        self._orders.put(order)
        return order

    def open(self, width_mm: float | None = None) -> Moving | None:
        """Open fully or to a width; a held object is released fully.

        None means that the gripper is busy.
        """
        with self._lock:
            busy = self._now
            if isinstance(busy, Grasping):
                busy.requests.release.set()
                self._now = order = Moving(width_mm=None)
            elif busy is not None:
                return None
            else:
                self._now = order = Moving(width_mm=None if self._gripped else width_mm)
        self._orders.put(order)
        return order

    def stop(self) -> None:
        """Stop at once, whatever it does: it holds still, soft fingers vent."""
        with self._lock:
            busy = self._now
        if isinstance(busy, Grasping):
            busy.requests.stop.set()
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
            self._complain(str(error))
            return
        except DeviceError as error:
            self._complain(str(error))
            self._ending.wait(_RETRY_S)
            return
        try:
            self.state = self._rig.gripper.state()
        except DeviceError as error:
            self._complain(str(error))
            self.state = None
        self._viewer(frame, self.state)

    def _grasp(self, order: Grasping) -> None:
        try:
            plan = plan_grasp(
                self._rig.calibration,
                gripper=self._rig.gripper,
                target_force_n=order.target_force_n,
                kind=order.kind,
                hold_s=self._hold_s,
                longest_s=self._hold_s + _CLOSING_S,
                **self._options,
            )

            def watch(grasp_state: GraspState) -> None:
                order.grasp_state = grasp_state
                if grasp_state.phase is Phase.HOLD and not order.known.is_set():
                    order.result = grasp_state.result
                    order.known.set()

            def see(observation: Observation) -> None:
                self.state = observation.gripper
                self._viewer(observation.frame, observation.gripper)

            result = run_grasp(
                plan,
                array=self._array,
                gripper=self._rig.gripper,
                clock=self._rig.clock,
                subscribers=[see],
                watchers=[watch],
                requests=order.requests,
            )
            self._gripped = result.outcome in _LEFT_STANDING
            if not order.known.is_set():
                order.result = result
            for fault in result.faults:
                self._complain(fault)
        except PalpateError as error:
            order.refusal = str(error)
        finally:
            order.known.set()
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
            self._complain(str(error))
        finally:
            order.over.set()
