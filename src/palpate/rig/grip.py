"""A grip that a control loop guards in the background until its release."""

from __future__ import annotations

import math
import threading

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.rig.job import GraspJob
from palpate.rig.paced_array import PacedArray
from palpate.rig.reading import Reader, Reading

#: Timeout for a reading; the control loop itself reports a missing frame sooner.
_READING_S = 2.0


class Grip:
    """Result of `Rig.grasp`: a held object, or an attempt that has ended.

    While `is_holding`, the control loop reads every frame in its own thread. On a fault it ends the
    grasp as described in `palpate.grasp.safety`.

    `job`: the grasp. `reader`: makes readings of its frames, with the rig's `clock`.
    `paced`: the job's array on a simulated rig, whose time runs at full speed until the object is
    held, then in real time.
    """

    def __init__(
        self, job: GraspJob, *, reader: Reader, clock: Clock, paced: PacedArray | None
    ) -> None:
        self._job, self._reader, self._clock, self._paced = job, reader, clock, paced
        self._failure: BaseException | None = None
        #: Whether the recording's error was raised, which `release` and `stop` do once.
        self._is_loss_told = False
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
            while not self._job.known.wait(0.1):
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
        return self._job.result

    @property
    def outcome(self) -> Outcome:
        """`held`, or the end of the attempt."""
        return self._job.result.outcome

    @property
    def size_mm(self) -> Measurement | None:
        """The object's extent along the closing axis before contact."""
        return self._job.result.size_mm

    @property
    def stiffness_n_per_mm(self) -> Measurement | None:
        """The object's own secant stiffness, without the compliance of pads and fingers."""
        return self._job.result.stiffness_n_per_mm

    @property
    def firmness(self) -> Measurement | None:
        """Firmness index from 0 to 100, also available if the stiffness is only bounded."""
        return self._job.result.firmness

    @property
    def settled_percent(self) -> Measurement | None:
        """Mean relative change at the 20 s horizon."""
        return self._job.result.settled_percent

    @property
    def force_n(self) -> Measurement | None:
        """Present grip force; the settled force once the object is no longer held."""
        if self.is_holding and self._reading is not None:
            return self._reading.force_n
        return self._job.result.force_n

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
        return self._end(self._job.requests.release)

    def stop(self) -> GraspResult:
        """Stop at once: rigid fingers stay in place, soft fingers vent (`palpate.grasp.safety`)."""
        return self._end(self._job.requests.stop)

    def to_dict(self) -> dict[str, object]:
        """Return the result in the JSON form of `palpate grasp`."""
        return self._job.document().to_dict()

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
        if self._paced is not None:
            self._paced.speed = math.inf
            self._paced.skip_wait()
        while self._thread.is_alive():
            self._thread.join(0.1)
        if self._failure is not None:
            raise self._failure
        if self._job.lost is not None and not self._is_loss_told:
            self._is_loss_told = True
            raise self._job.lost
        return self._job.result

    def _run(self) -> None:
        try:
            with self._job:
                self._job.run(subscribers=[self._store_reading], watchers=[self._update_hold])
        except BaseException as error:
            self._failure = error
        finally:
            self._job.known.set()
            with self._frame:
                self._frame.notify_all()

    def _store_reading(self, observation: Observation) -> None:
        reading = self._reader.read(observation.frame, now_s=self._clock.now_s())
        with self._frame:
            self._reading = reading
            self._frame.notify_all()

    def _update_hold(self, grasp_state: GraspState) -> None:
        if grasp_state.estimate.rest_ohm is not None:
            self._reader.rest_ohm = grasp_state.estimate.rest_ohm
        is_first = grasp_state.phase is Phase.HOLD and not self._job.known.is_set()
        if self._paced is not None and is_first:
            self._paced.speed = 1.0
