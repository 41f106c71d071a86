"""What every job works with: the rig, the requests of the user, and the telemetry to the page."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from palpate.dashboard.grasp_progress import force_laws
from palpate.dashboard.messages import FrameSource, Guide
from palpate.dashboard.telemetry import Telemetry
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.grasp.calibrating import Bench
from palpate.grasp.requests import Requests
from palpate.gripper.interface import Gripper, GripperState
from palpate.rig import Rig
from palpate.rig.sensor_only import SensorRig
from palpate.sensor.array import (
    FRAME_TIMEOUT_S,
    ArrayLayout,
    Frame,
    LinkCounters,
    PressureArray,
    link_counters,
)

NO_GRIPPER = "this rig has no gripper: name one in its file (`palpate init --gripper`)"
#: A stop takes effect within this time while the sensor is silent.
_PATIENCE_S = 0.1
#: A frame older than this waited in a buffer; after reading for this long, it is the link that is
#: late, and no more is waited for.
_OLD_S, _CAUGHT_UP_S = 0.05, 1.0


class StoppedByUserError(PalpateError):
    """A guided step was stopped."""


class CellBench(Protocol):
    """A bench with a load cell, and the hands that put it between the fingers."""

    @property
    def bench(self) -> Bench:
        """The devices."""
        ...

    @property
    def reseat(self) -> Callable[[int], None]:
        """Puts the load cell between the fingers for a run."""
        ...


#: Opens the bench of a rig by name and seed; raises `DeviceError` where there is none.
BenchOpener = Callable[[str, int], CellBench]


@dataclass(slots=True, kw_only=True)
class JobContext:
    """The rig and the channels of a job."""

    #: Devices; `calibration` is replaced when it is renewed.
    rig: Rig | SensorRig
    #: The rig's, held back to the pace of the wall's clock where it is simulated.
    array: PressureArray
    #: Seed of a simulated rig.
    seed: int
    #: Sends frames and messages to the page.
    telemetry: Telemetry
    #: Set when the user confirmed a step.
    confirmed: threading.Event
    #: Called when the hand has received the user's stop.
    on_stopped: Callable[[], None]
    #: Opens the bench with a load cell of this rig; None where it has none.
    open_bench: BenchOpener | None = None
    #: Requests of the user to the running job.
    requests: Requests = field(default_factory=Requests)
    #: When the hand received the stop, on the rig's clock.
    reacted_s: float | None = None

    @property
    def whole(self) -> Rig:
        """The rig with its gripper; raises `DeviceError` where there is a sensor alone."""
        if isinstance(self.rig, SensorRig):
            raise DeviceError(NO_GRIPPER)
        return self.rig

    def source(self) -> FrameSource:
        """Return the description of the rig for the page."""
        calibration, gripper = self.rig.calibration, self.rig.gripper
        return FrameSource(
            name=self.rig.name,
            layout=self.rig.array.layout,
            rest_ohm=None if calibration is None else calibration.rest_ohm,
            gripper=None if gripper is None else gripper.limits,
            origin=self.rig.origin,
            subject=self.rig.subject,
            has_load_cell=self.open_bench is not None,
            calibration="" if calibration is None else calibration.as_text(),
            calibrated_at="" if calibration is None else calibration.made_at or "",
            laws=force_laws(calibration),
        )

    def link_events(self) -> LinkCounters:
        """Return what the link has counted, where there is one."""
        return link_counters(self.rig.array) or LinkCounters()

    def watch_array(self, array: PressureArray | None = None) -> WatchedArray:
        """Return the array with every frame shown; a stop request ends its reading."""
        return WatchedArray(array or self.array, gripper=self.rig.gripper, context=self)

    def guide(self, text: str, *, share: float | None = None, asks: bool = False) -> None:
        """Show the user what goes on, or what to do."""
        self.telemetry.note(Guide(text=text, share=share, asks=asks))

    def stop_hand(self) -> None:
        """Stop the hand, and confirm it; a sensor alone has none that could move.

        Raises
        ------
        DeviceError
            If the hand can't be reached; nothing is confirmed then.
        """
        if self.rig.gripper is not None:
            self.rig.gripper.stop()
        self.confirm_stop()

    def confirm_stop(self) -> None:
        """Confirm that the hand received the stop."""
        if self.reacted_s is None:
            self.reacted_s = self.rig.clock.now_s()
        self.on_stopped()

    def catch_up(self) -> None:
        """Read what waited while nobody did: nothing is decided on old frames."""
        array, clock = self.watch_array(), self.rig.clock
        until_s = clock.now_s() + _CAUGHT_UP_S
        while clock.now_s() - array.read(timeout_s=FRAME_TIMEOUT_S).time_s > _OLD_S:
            if clock.now_s() > until_s:
                return


class WatchedArray:
    """An array whose every frame is shown, until the user stops what reads it."""

    def __init__(
        self, array: PressureArray, *, gripper: Gripper | None, context: JobContext
    ) -> None:
        self._array, self._gripper, self._context = array, gripper, context

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame.

        Raises
        ------
        StoppedByUserError
            If the user asked for a stop.
        DeviceTimeoutError
            If the sensor is silent.
        """
        tries = math.ceil(timeout_s / _PATIENCE_S)
        while True:
            if self._context.requests.stop.is_set():
                raise StoppedByUserError("stopped on request")
            tries -= 1
            try:
                frame = self._array.read(timeout_s=_PATIENCE_S)
            except DeviceTimeoutError:
                if tries <= 0:
                    raise
                continue
            self._context.telemetry.add_frame(frame, state_of(self._gripper))
            return frame

    def close(self) -> None:
        """Leave the array open: it is the rig's."""


def state_of(gripper: Gripper | None) -> GripperState | None:
    """Return the gripper's state, None while it does not answer or where there is none."""
    try:
        return None if gripper is None else gripper.state()
    except DeviceError:
        return None
