"""Jobs of the device process: grasp, open the hand, calibrate, examine."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.calibrate.dead_weights import KeptFrames, check_loads, measure_loads
from palpate.calibrate.force_law import add_force_law
from palpate.calibrate.guided import HOLDS_N, Bench, measure_force, measure_rest
from palpate.calibrate.rest import compute_rest, format_now, replace_rest
from palpate.calibration import Calibration, ForcePairs, RestValues
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.force.of_calibration import DWELL_S, HORIZON_S
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.requests import Requests
from palpate.grasp.result import Outcome
from palpate.grasp.state import GraspState
from palpate.gripper.interface import Gripper, GripperState
from palpate.gripper.no_gripper import NO_GRIPPER
from palpate.rig import Rig
from palpate.rig.bench import GuidedBench
from palpate.rig.job import GraspJob
from palpate.rig.sensor_only import SensorRig
from palpate.sensor.array import (
    FRAME_TIMEOUT_S,
    ArrayLayout,
    Frame,
    LinkCounters,
    PressureArray,
    get_link_counters,
)
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.health import Health, check_health
from palpate.sensor.sample import relative_change_percent
from palpate.sensor.serial_array import SerialArray
from palpate.twin.rig import open_twin_bench
from palpate_station.dashboard.grasp_progress import force_law
from palpate_station.dashboard.messages import (
    CalibrateForce,
    CalibrateRest,
    CalibrationRenewed,
    Examine,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
    Measured,
    OpenHand,
)
from palpate_station.dashboard.telemetry import Telemetry
from palpate_station.ripeness.closing import ClosingWatch

#: Read timeout, and thus the maximum delay of a stop while the sensor is silent, seconds.
_READ_TIMEOUT_S = 0.1
#: Buffered frames older than this are discarded for at most the timeout, seconds. Frames that are
#: still old then indicate a slow link, not a buffer.
_MAX_FRAME_AGE_S, _CATCH_UP_TIMEOUT_S = 0.05, 1.0


class StoppedByUserError(PalpateError):
    """A guided step was stopped."""


@dataclass(slots=True, kw_only=True)
class JobContext:
    """The rig and the channels of a job."""

    #: The devices; a new calibration replaces `rig.calibration`.
    rig: Rig | SensorRig
    #: The rig's array; a simulated array is paced to real time.
    array: PressureArray
    #: Seed of a simulated rig.
    seed: int
    #: Sends frames and messages to the page.
    telemetry: Telemetry
    #: Set when the user has confirmed a step.
    confirmed: threading.Event
    #: Called when the hand has received a stop.
    on_stopped: Callable[[], None]
    #: The user's requests to the running job.
    requests: Requests = field(default_factory=Requests)
    #: Number of objects so far, and item of the last one.
    objects: int = 0
    item_id: str = ""
    #: Time at which the hand received the stop, on the rig's clock.
    reacted_s: float | None = None

    @property
    def has_load_cell(self) -> bool:
        """Whether a load cell allows a force calibration without weights."""
        return self.rig.name == "sim-rigid"

    @property
    def rig_with_gripper(self) -> Rig:
        """The rig, which must have a gripper; otherwise raises `DeviceError`."""
        if isinstance(self.rig, SensorRig):
            raise DeviceError(NO_GRIPPER)
        return self.rig

    def present_object(self, item_id: str) -> None:
        """On a simulated rig, present a new object, unless the last item is grasped again."""
        if self.objects == 0 or not item_id or item_id != self.item_id:
            self.objects += 1
            place_object = self.rig_with_gripper.place_object
            if place_object is not None and self.objects > 1:
                place_object(self.objects)
        self.item_id = item_id

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
            has_load_cell=self.has_load_cell,
            calibration="" if calibration is None else calibration.as_text(),
            calibrated_at="" if calibration is None else calibration.made_at or "",
            law=force_law(calibration),
        )

    def link_events(self) -> LinkCounters:
        """Return the counters of the link; zeros without a link."""
        return get_link_counters(self.rig.array) or LinkCounters()

    def watch_array(self, array: PressureArray | None = None) -> WatchedArray:
        """Return an array that sends every frame to the page and raises after a stop."""
        return WatchedArray(array or self.array, self)

    def show_guide(
        self, text: str, *, fraction: float | None = None, needs_confirmation: bool = False
    ) -> None:
        """Show an instruction or the progress to the user."""
        self.telemetry.note(
            Guide(text=text, fraction=fraction, needs_confirmation=needs_confirmation)
        )

    def stop_hand(self) -> None:
        """Stop the hand, if any, and confirm the stop.

        Raises
        ------
        DeviceError
            If the hand can't be reached; the stop is then not confirmed.
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
        """Discard old frames from the buffer, so that no decision is based on them."""
        array, clock = self.watch_array(), self.rig.clock
        until_s = clock.now_s() + _CATCH_UP_TIMEOUT_S
        while clock.now_s() - array.read(timeout_s=FRAME_TIMEOUT_S).time_s > _MAX_FRAME_AGE_S:
            if clock.now_s() > until_s:
                return


class WatchedArray:
    """An array that sends every frame to the page until the user stops the job."""

    def __init__(self, array: PressureArray, context: JobContext) -> None:
        self._array, self._context = array, context

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame.

        Raises
        ------
        StoppedByUserError
            If the user requested a stop.
        DeviceTimeoutError
            If the sensor is silent.
        """
        tries = math.ceil(timeout_s / _READ_TIMEOUT_S)
        while True:
            if self._context.requests.stop.is_set():
                raise StoppedByUserError("stopped on request")
            tries -= 1
            try:
                frame = self._array.read(timeout_s=_READ_TIMEOUT_S)
            except DeviceTimeoutError:
                if tries <= 0:
                    raise
                continue
            self._context.telemetry.add_frame(frame, read_state(self._context.rig.gripper))
            return frame

    def close(self) -> None:
        """Do nothing: the rig owns the array."""


def read_state(gripper: Gripper | None) -> GripperState | None:
    """Return the gripper's state; None without a gripper or a response."""
    try:
        return None if gripper is None else gripper.state()
    except DeviceError:
        return None


#: Maximum hold time before the object is released, seconds; it limits the load on sheet, object and
#: servo.
HOLD_S = 60.0
#: Maximum time to wait for the hand to open, seconds.
_OPENING_TIMEOUT_S = 10.0


def grasp(order: GraspOrder, *, context: JobContext) -> Grasped:
    """Run one grasp and record every frame."""
    rig, telemetry = context.rig_with_gripper, context.telemetry
    job = GraspJob(
        rig,
        target_force_n=order.target_force_n,
        limit=order.limit,
        record=order.recording,
        array=context.array,
        requests=context.requests,
        hold_s=HOLD_S,
    )
    context.present_object(order.item_id)
    context.catch_up()
    order.recording.parent.mkdir(parents=True, exist_ok=True)
    closing = ClosingWatch(job.plan)
    observed: list[Observation] = []
    answered: list[Grasped] = []

    def observe(observation: Observation) -> None:
        """Send the frame to the page, and keep it until the answer."""
        telemetry.observe(observation)
        if not answered:
            observed.append(observation)

    def grasped() -> Grasped:
        """Return the grasp so far."""
        return Grasped(
            document=job.document(),
            observations=() if answered else tuple(observed),
            recording=order.recording,
            closing=closing.list_measurements(),
        )

    def send_answer(grasp_state: GraspState) -> None:
        """Send the answer once, when the hand holds the object."""
        if job.known.is_set() and not answered:
            answered.append(grasped())
            telemetry.note(Measured(answered[0]))

    def confirm_stop_on_opening(grasp_state: GraspState) -> None:
        """Confirm a stop as soon as the hand opens."""
        # A hand that vents or is already opening is stopped only when it is open.
        if grasp_state.phase is Phase.RELEASE and context.requests.stop.is_set():
            context.confirm_stop()

    with job:
        telemetry.set_plan(job.plan)
        job.run(
            subscribers=[observe],
            watchers=[
                telemetry.set_grasp_state,
                confirm_stop_on_opening,
                closing.add_state,
                send_answer,
            ],
        )
        # Stopped before the recording is closed: a slow disk must not delay the confirmation.
        if context.requests.stop.is_set():
            with suppress(DeviceError):
                context.stop_hand()
    requests, found = context.requests, grasped()
    is_alone = found.document.result.outcome is Outcome.HELD and not (
        requests.release.is_set() or requests.stop.is_set()
    )
    return replace(found, is_released_alone=is_alone)


def open_hand(order: OpenHand, *, context: JobContext) -> None:
    """Open the hand and wait until it is stationary; a stop request halts the hand."""
    gripper, clock, array = (
        context.rig_with_gripper.gripper,
        context.rig.clock,
        context.watch_array(),
    )
    gripper.release()
    until_s = clock.now_s() + _OPENING_TIMEOUT_S
    try:
        array.read(timeout_s=FRAME_TIMEOUT_S)
        while gripper.state().moving and clock.now_s() < until_s:
            array.read(timeout_s=FRAME_TIMEOUT_S)
    finally:
        if context.requests.stop.is_set():
            context.stop_hand()


#: Averaging time of the rest values, seconds.
_REST_S = 3.0


class _MissingLoadCell:
    """Placeholder for the load cell of a bench without one."""

    def read_n(self) -> float:
        """Raise `DeviceError`: there is no load cell."""
        raise DeviceError("this rig has no load cell that palpate can read")


def calibrate_rest(order: CalibrateRest, *, context: JobContext) -> CalibrationRenewed:
    """Open the hand, if any, and measure the rest values.

    Raises
    ------
    DeviceError
        If the sensor is silent; with a gripper, also if the readings do not settle (contact or
        movement) or a pixel has no signal.
    CalibrationError
        Without a gripper, if the sensor is loaded or moved, or a pixel is open or short.
    """
    rig = context.rig
    rest = (
        _measure_rest_without_gripper(context)
        if isinstance(rig, SensorRig)
        else _measure_rest_with_gripper(rig, context)
    )
    # A rig without a calibration is hardware, because simulated rigs always have one.
    calibration = replace_rest(rig.calibration, rest, layout=rig.array.layout, simulated=False)
    return _store_calibration(calibration, file=order.file, context=context)


def _measure_rest_with_gripper(rig: Rig, context: JobContext) -> RestValues:
    context.show_guide("The hand opens. Do not touch the sensor")
    bench = Bench(
        array=context.watch_array(),
        gripper=rig.gripper,
        cell=_MissingLoadCell(),
        clock=rig.clock,
        start=rig.gripper.limits.target(0.0),
    )
    return measure_rest(bench, duration_s=_REST_S)


def _measure_rest_without_gripper(context: JobContext) -> RestValues:
    """Measure the rest values of a sensor without a gripper."""
    context.catch_up()
    frames = _read_at_rest(_REST_S, context)
    if frames.time_s[-1] - frames.time_s[0] < _REST_S:
        raise DeviceTimeoutError("the sensor sends no frames: check its cable and power")
    return compute_rest(frames, layout=context.rig.array.layout)


def calibrate_force(order: CalibrateForce, *, context: JobContext) -> CalibrationRenewed:
    """Take readings at known forces and fit the force law.

    The result includes the expected errors on held-out loads.

    Raises
    ------
    InputError
        If the loads are unsuitable for a calibration.
    CalibrationError
        If the readings are unsuitable for a calibration.
    DeviceError
        If the rig has no load cell and no loads were given.
    """
    before = context.rig.calibration
    if before is None:
        raise DeviceError("no rest values: run the rest calibration first")
    if order.loads_n:
        pairs = _calibrate_with_weights(check_loads(order.loads_n, where="the loads"), context)
    elif context.has_load_cell:
        pairs = _calibrate_with_load_cell(open_twin_bench(context.rig.name, context.seed), context)
    else:
        raise DeviceError("this rig has no load cell that palpate can read: use dead weights")
    calibration = replace(add_force_law(replace(before, force=pairs)), made_at=format_now())
    return _store_calibration(calibration, file=order.file, context=context)


def _calibrate_with_load_cell(guided: GuidedBench, context: JobContext) -> ForcePairs:
    """Close on a simulated load cell at each placement, as fast as the computer allows."""
    bench = replace(guided.bench, array=context.watch_array(guided.bench.array))

    def reseat(run: int) -> None:
        """Show the number of the placement, and place the load cell again."""
        fraction = run / len(HOLDS_N)
        text = f"Placing the load cell again: {run + 1} of {len(HOLDS_N)}"
        context.show_guide(text, fraction=fraction)
        guided.reseat(run)

    return measure_force(
        bench, holds_n=HOLDS_N, reseat=reseat, dwell_s=DWELL_S, horizon_s=HORIZON_S
    )


def _calibrate_with_weights(loads_n: list[float], context: JobContext) -> ForcePairs:
    """Guide the user through the weights, and read each weight after its confirmation."""
    array, placements = KeptFrames(context.watch_array()), iter(range(len(loads_n)))

    def place(load_n: float) -> None:
        """Ask for a weight and wait until the user confirms its placement."""
        fraction = next(placements) / len(loads_n)
        instruction = "Remove all weights"
        if load_n:
            instruction = f"Place {load_n:g} N on the pad"
        context.confirmed.clear()
        context.show_guide(instruction, fraction=fraction, needs_confirmation=True)
        while not context.confirmed.is_set():
            array.read(timeout_s=FRAME_TIMEOUT_S)
        settles = f"{load_n:g} N settles: do not touch it for 20 s"
        context.show_guide(settles, fraction=fraction)

    context.show_guide("Reading the rest values. Do not touch the sensor")
    return measure_loads(array, loads_n=loads_n, place=place, clock=context.rig.clock).pairs


def _store_calibration(
    calibration: Calibration, *, file: Path, context: JobContext
) -> CalibrationRenewed:
    """Save the calibration to its file and use it from now on."""
    before = context.rig.calibration
    before_ohm = calibration.rest_ohm if before is None else before.rest_ohm
    file.parent.mkdir(parents=True, exist_ok=True)
    calibration.save(file)
    context.rig = replace(context.rig, calibration=calibration)
    return CalibrationRenewed(
        file=file,
        rest_ohm=calibration.rest_ohm,
        change_percent=relative_change_percent(calibration.rest_ohm, rest_ohm=before_ohm),
        held_out=calibration.held_out.get("error_percent", {}),
    )


def examine_sensor(order: Examine, *, context: JobContext) -> Health:
    """Read frames from the unloaded sensor and examine them.

    Raises
    ------
    DeviceError
        If the sensor is silent.
    """
    context.catch_up()
    before = context.link_events()
    frames, board = _read_at_rest(order.duration_s, context), context.rig.array
    identity = board.identity if isinstance(board, SerialArray) else None
    return check_health(
        frames,
        layout=board.layout,
        known_ohm=context.source().rest_ohm,
        requested_hz=None if identity is None else identity.rate_hz,
        counters=context.link_events().count_since(before),
    )


def _read_at_rest(duration_s: float, context: JobContext) -> FrameColumns:
    """Read frames for a duration, or until the sensor stops sending."""
    array = context.watch_array()
    frames = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while (lasted_s := frames[-1].time_s - frames[0].time_s) < duration_s:
        context.show_guide("Do not touch the sensor", fraction=lasted_s / duration_s)
        try:
            frames.append(array.read(timeout_s=FRAME_TIMEOUT_S))
        except DeviceTimeoutError:
            break
    return FrameColumns.from_frames(frames)
