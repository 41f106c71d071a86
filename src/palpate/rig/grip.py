"""A grip that a control loop guards in the background until its release."""

from __future__ import annotations

import math
import threading
from contextlib import AbstractContextManager
from dataclasses import replace

from palpate.errors import DeviceError, DeviceTimeoutError, RecordingLostError
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.rig import Rig
from palpate.rig.reading import Reader, Reading
from palpate.rig.recorded import GraspRecorder
from palpate.twin.paced_array import PacedArray

#: Timeout for a reading; the control loop itself reports a missing frame sooner.
_READING_S = 2.0


class Grip:
    """Result of `Rig.grasp`: a held object, or an attempt that has ended.

    While `is_holding`, the control loop reads every frame in its own thread. On a fault it ends the
    grasp as described in `palpate.grasp.safety`.
    """

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        *,
        reader: Reader,
        recorder: AbstractContextManager[GraspRecorder | None],
    ) -> None:
        self._rig, self._plan, self._reader, self._recorder = rig, plan, reader, recorder
        self._requests, self._ready = Requests(), threading.Event()
        self._array: PacedArray | None = None
        if rig.is_simulated:
            # Simulated time runs at full speed until the object is held, then in real time.
            self._array = PacedArray(rig.array, speed=math.inf)
        self._result = GraspResult(outcome=Outcome.STOPPED)
        self._failure: BaseException | None = None
        #: The recording's error, which `release` or `stop` raises once.
        self._lost: RecordingLostError | None = None
        self._reading: Reading | None = None
        self._frame = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="palpate-grip", daemon=True)

    def start(self) -> None:
        """Grasp, and return once the object is held or the attempt has ended.

        Ctrl-C stops the attempt; `KeyboardInterrupt` is raised again.
        """
        self._thread.start()
        try:
            # On some systems, a wait without a timeout blocks Ctrl-C.
            while not self._ready.wait(0.1):
                pass
        except KeyboardInterrupt:
            self.stop()
            raise
        if self._failure is not None:
            raise self._failure

    @property
    def is_holding(self) -> bool:
        """Whether the object is held and guarded."""
        return self._thread.is_alive()

    @property
    def result(self) -> GraspResult:
        """The result so far; final once the object is no longer held."""
        return self._result

    @property
    def outcome(self) -> Outcome:
        """`held`, or the end of the attempt."""
        return self._result.outcome

    @property
    def size_mm(self) -> Measurement | None:
        """The object's extent along the closing axis before contact."""
        return self._result.size_mm

    @property
    def stiffness_n_per_mm(self) -> Measurement | None:
        """The object's own secant stiffness, without the compliance of pads and fingers."""
        return self._result.stiffness_n_per_mm

    @property
    def firmness(self) -> Measurement | None:
        """Firmness index from 0 to 100, also available if the stiffness is only bounded."""
        return self._result.firmness

    @property
    def settled_percent(self) -> Measurement | None:
        """Mean relative change at the 20 s horizon."""
        return self._result.settled_percent

    @property
    def force_n(self) -> Measurement | None:
        """Present grip force; the settled force once the object is no longer held."""
        if self.is_holding and self._reading is not None:
            return self._reading.force_n
        return self._result.force_n

    def read(self) -> Reading:
        """Return the reading of the next frame from the control loop.

        Raises `DeviceTimeoutError` if no frame arrives, `DeviceError` if the grasp has ended.
        """
        with self._frame:
            if not self._frame.wait(_READING_S):
                raise DeviceTimeoutError(f"no frame in {_READING_S:g} s; check the sensor's cable")
            if not self.is_holding or self._reading is None:
                raise DeviceError(f"the grasp has ended: {self.outcome}; grasp again")
            return self._reading

    def release(self) -> GraspResult:
        """Open the gripper, wait until it is open, and return the final result.

        After the end of the grasp, only return the result.
        Raises `RecordingLostError` once if the recording is not complete; `result` is.
        """
        return self._end(self._requests.release)

    def stop(self) -> GraspResult:
        """Stop at once: rigid fingers stay in place, soft fingers vent (`palpate.grasp.safety`)."""
        return self._end(self._requests.stop)

    def to_dict(self) -> dict[str, object]:
        """Return the result in the JSON form of `palpate grasp`."""
        from palpate.grasp.document import grasp_document

        rig = self._rig
        return grasp_document(
            self._result,
            target_force_n=self._plan.target_force_n,
            damage_limit=None,
            names={},
            simulated=rig.is_simulated,
            truth=None if rig.truth is None else dict(rig.truth()),
            subject=rig.subject,
        )

    def __repr__(self) -> str:
        parts = [str(self.outcome)]
        for label, unit, digits, value in (
            ("size", "mm", 1, self.size_mm),
            ("force", "N", 2, self.force_n),
            ("stiffness", "N/mm", 2, self.stiffness_n_per_mm),
            ("firmness", "of 100", 0, self.firmness),
        ):
            if value is not None:
                parts.append(f"{label} {value.text(digits=digits)} {unit}")
        return f"Grip({', '.join(parts)})"

    def _end(self, request: threading.Event) -> GraspResult:
        request.set()
        if self._array is not None:
            self._array.speed = math.inf
            self._array.skip_wait()
        while self._thread.is_alive():
            self._thread.join(0.1)
        if self._failure is not None:
            raise self._failure
        if self._lost is not None:
            lost, self._lost = self._lost, None
            raise lost
        return self._result

    def _run(self) -> None:
        record: GraspRecorder | None = None
        try:
            with self._recorder as record:
                self._result = run_grasp(
                    self._plan,
                    array=self._rig.array if self._array is None else self._array,
                    gripper=self._rig.gripper,
                    clock=self._rig.clock,
                    subscribers=[self._store_reading]
                    if record is None
                    else [record, self._store_reading],
                    watchers=[self._update_hold],
                    requests=self._requests,
                )
                if record is not None:
                    record.end(self._result, self._requests)
        except RecordingLostError as error:
            if record is None:  # not created, so the gripper has not moved
                self._failure = error
            else:
                self._lost = error
                faults, text = self._result.faults, str(error)
                if not any(text in fault for fault in faults):
                    self._result = replace(self._result, faults=(*faults, text))
        except BaseException as error:
            self._failure = error
        finally:
            self._ready.set()
            with self._frame:
                self._frame.notify_all()

    def _store_reading(self, observation: Observation) -> None:
        reading = self._reader.read(observation.frame, now_s=self._rig.clock.now_s())
        with self._frame:
            self._reading = reading
            self._frame.notify_all()

    def _update_hold(self, grasp_state: GraspState) -> None:
        if grasp_state.estimate.rest_ohm is not None:
            self._reader.rest_ohm = grasp_state.estimate.rest_ohm
        if grasp_state.phase is Phase.HOLD and not self._ready.is_set():
            self._result = replace(
                grasp_state.result,
                outcome=Outcome.HELD,
                peak_force_n=grasp_state.estimate.peak_force_n,
            )
            if self._array is not None:
                self._array.speed = 1.0
            self._ready.set()
