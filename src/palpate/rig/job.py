"""One grasp on a rig: its plan, limit, recording, listeners and requests."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from palpate.errors import CalibrationError, InputError, RecordingLostError
from palpate.grasp.damage_limit import DamageLimit
from palpate.grasp.document import GraspDocument
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.phases import Phase
from palpate.grasp.plan import HOLD_S, LONGEST_S
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import Subscriber, Watcher, run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.no_gripper import NO_GRIPPER, NoGripper
from palpate.rig import Rig
from palpate.rig.recorded import GraspRecorder, record_grasp
from palpate.sensor.array import PressureArray


class GraspJob:
    """One grasp on a rig, for `Rig.grasp`, `palpate grasp`, the page and ROS.

    A `with` block keeps the recording open; `run` grasps on the calling thread.

    Parameters
    ----------
    rig : Rig
        The open rig.
    target_force_n, lift_force_n, expect_size_mm, tries, tighten, hold_s, longest_s
        The task, as in `plan_grasp`.
    limit : DamageLimit, optional
        Learned damage limit that the grasp obeys.
    paper : Paper, optional
        Settings of the paper's method, which has neither a target force nor an expected size.
    record : path, optional
        New .mcap file for every frame until the end.
    array : PressureArray, optional
        The rig's array, paced to real time; the rig's own by default.
    requests : Requests, optional
        The requests to this grasp; new ones by default.

    Attributes
    ----------
    plan : Plan
        Plan of the grasp.
    requests : Requests
        Stop and release, from any thread.
    grasp_state : GraspState
        Newest state of the controller.
    result : GraspResult
        The result so far; `held` while the object is held, final after `run`.
    known : Event
        Set when the object is held and the answer is known. A thread that runs the job sets it at
        the end, too, so that others can wait for it.
    lost : RecordingLostError or None
        Why the recording is incomplete, after the block. The result has it as a fault.

    Raises
    ------
    InputError
        If a force or the expected size is out of range or does not fit the method, or the rig has
        no gripper.
    CalibrationError
        If the calibration lacks data for this grasp.

    Examples
    --------
    >>> from palpate.rig import open_rig
    >>> with open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
    ...     with GraspJob(rig, target_force_n=2.0) as job:
    ...         result = job.run()
    >>> str(result.outcome), job.document().to_dict()["verdict"]["on_target"]
    ('held', True)
    """

    def __init__(
        self,
        rig: Rig,
        *,
        target_force_n: float | None = None,
        lift_force_n: float | None = None,
        expect_size_mm: float | None = None,
        limit: DamageLimit | None = None,
        paper: Paper | None = None,
        record: Path | None = None,
        array: PressureArray | None = None,
        requests: Requests | None = None,
        tries: int = 1,
        tighten: int = 0,
        hold_s: float = HOLD_S,
        longest_s: float = LONGEST_S,
    ) -> None:
        if paper is not None and (target_force_n is not None or expect_size_mm is not None):
            raise InputError(
                "the paper's method has neither a target force nor an expected size; omit them"
            )
        if paper is not None and tighten:
            raise InputError("the paper's method does not tighten a grip; omit one of them")
        if isinstance(rig.gripper, NoGripper):
            raise InputError(NO_GRIPPER)
        if rig.calibration.force.force_n and not rig.calibration.block.force_n:
            raise CalibrationError(
                "the compliance of the hand is not calibrated: run `palpate calibrate compliance` "
                "with a rigid block of known size"
            )
        self._rig, self._limit, self._record = rig, limit, record
        self._array = rig.array if array is None else array
        plan = plan_grasp(
            rig.calibration,
            gripper=rig.gripper,
            target_force_n=target_force_n,
            lift_force_n=lift_force_n,
            expect_size_mm=expect_size_mm,
            damage=None if limit is None else limit.file.model,
            kind="" if limit is None else limit.kind,
            tries=tries,
            tighten=tighten,
            hold_s=hold_s,
            longest_s=longest_s,
        )
        if paper is not None:
            plan = use_paper_method(plan, paper, calibration=rig.calibration)
        self.plan = plan
        self.requests = Requests() if requests is None else requests
        self.grasp_state = GraspState()
        self.result = GraspResult(outcome=Outcome.STOPPED)
        self.known = threading.Event()
        self.lost: RecordingLostError | None = None
        self._stack = ExitStack()
        self._recorder: GraspRecorder | None = None

    def __enter__(self) -> Self:
        """Create the recording.

        Raises `RecordingError` if it exists or can't be created, `DeviceError` if the board is
        lost.
        """
        if self._record is not None:
            text = None if self._limit is None else self._limit.file.as_text()
            recording = record_grasp(self._record, rig=self._rig, plan=self.plan, damage=text)
            self._recorder = self._stack.enter_context(recording)
        return self

    def run(
        self, *, subscribers: Sequence[Subscriber] = (), watchers: Sequence[Watcher] = ()
    ) -> GraspResult:
        """Grasp, and return the result once the gripper is at rest or open.

        `subscribers`, `watchers`: receive every observation and every state, as in `run_grasp`.
        """
        recorder = self._recorder
        self.result = run_grasp(
            self.plan,
            array=self._array,
            gripper=self._rig.gripper,
            clock=self._rig.clock,
            subscribers=[*([] if recorder is None else [recorder]), *subscribers],
            # Last, so that the others have seen the hold before anybody waits for `known`.
            watchers=[*watchers, self._follow],
            requests=self.requests,
        )
        if recorder is not None:
            recorder.end(self.result, self.requests)
        return self.result

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the recording."""
        try:
            self._stack.__exit__(kind, error, traceback)
        except RecordingLostError as lost:
            self.lost, faults = lost, self.result.faults
            if not any(str(lost) in fault for fault in faults):
                self.result = replace(self.result, faults=(*faults, str(lost)))

    @property
    def damage_low_n(self) -> float:
        """The damage limit of this object, newtons; infinite if the closing did not show it."""
        return self.grasp_state.estimate.damage_low_n

    def document(self) -> GraspDocument:
        """Return the document of the grasp so far."""
        rig = self._rig
        return GraspDocument(
            result=self.result,
            target_force_n=self.plan.target_force_n,
            limit=self._limit,
            damage_low_n=self.damage_low_n,
            is_simulated=rig.is_simulated,
            subject=rig.subject,
            truth=None if rig.truth is None else dict(rig.truth()),
        )

    def _follow(self, grasp_state: GraspState) -> None:
        self.grasp_state = grasp_state
        if grasp_state.phase is Phase.HOLD and not self.known.is_set():
            self.result = replace(
                grasp_state.result,
                outcome=Outcome.HELD,
                peak_force_n=grasp_state.estimate.peak_force_n,
            )
            self.known.set()
