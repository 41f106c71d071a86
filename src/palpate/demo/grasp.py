"""A simulated grasp as a sequence of moments, for the demo, its picture and the documentation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.answers import read_force
from palpate.grasp.document import GraspDocument
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.rig import open_rig
from palpate.rig.job import GraspJob
from palpate.rig.paced_array import PacedArray
from palpate.sensor.sample import SampleReader

#: The grasp of the demo: a strawberry in rigid fingers, seed 4, to 3 N.
RIG, OBJECT, SEED, TARGET_N = "sim-rigid", "strawberry", 4, 3.0
#: Simulated time between two moments, seconds: as often as a terminal can be redrawn.
INTERVAL_S = 0.04
#: Duration of the demo's hold, seconds; long enough to read the force.
_HOLD_S = 1.5
#: Phases with a force; while the hand opens, the sheet still recovers.
_FORCE_PHASES = (Phase.APPROACH, Phase.SQUEEZE, Phase.SETTLE, Phase.HOLD)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspMoment:
    """What a grasp shows after a frame.

    Attributes
    ----------
    time_s : float
        Simulated time since the first frame, seconds.
    phase : Phase
        Present phase.
    width_mm : float
        Distance between the fingers, mm.
    change_percent : ndarray, shape (rows, cols)
        Relative change of each pixel; 0 before the rest values are known, NaN for an open pixel.
    force_n : Measurement or None
        Grip force with its interval, newtons; None before the rest values are known
        and while the hand opens.
    """

    time_s: float
    phase: Phase
    width_mm: float
    change_percent: FloatArray
    force_n: Measurement | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DemoGrasp:
    """A simulated grasp: its moments, the finger of each row of pixels, seed and document."""

    moments: tuple[GraspMoment, ...]
    finger_of_row: tuple[int, ...]
    seed: int
    document: GraspDocument


def run_demo_grasp(
    *,
    follow: Callable[[GraspMoment], None] | None = None,
    record: Path | None = None,
    speed: float | None = None,
    object_name: str = OBJECT,
    seed: int = SEED,
    target_n: float = TARGET_N,
) -> DemoGrasp:
    """Run a simulated grasp, by default that of the demo, and return it.

    Parameters
    ----------
    follow : callable, optional
        Called with each moment while the grasp runs.
    record : path, optional
        New .mcap file for the grasp.
    speed : float, optional
        Seconds of simulated time per real second; by default as fast as the computer allows.
    object_name, seed, target_n
        Object, scatter of sensor and gripper, and target force in newtons.

    Examples
    --------
    >>> grasp = run_demo_grasp()
    >>> str(grasp.document.result.outcome), grasp.moments[-1].phase.value
    ('held', 'release')
    """
    with open_rig(RIG, object_name=object_name, seed=seed) as rig:
        array = None if speed is None else PacedArray(rig.array, speed=speed)
        job = GraspJob(rig, target_force_n=target_n, hold_s=_HOLD_S, record=record, array=array)
        moments = _Moments(job.plan, follow)
        with job:
            job.run(subscribers=[moments.add], watchers=[moments.watch])
        return DemoGrasp(
            moments=tuple(moments.found),
            finger_of_row=job.plan.layout.finger_of_row,
            seed=seed,
            document=job.document(),
        )


class _Moments:
    """Collects the moments of a grasp."""

    def __init__(self, plan: Plan, follow: Callable[[GraspMoment], None] | None) -> None:
        self._plan, self._follow = plan, follow
        self._newest: Observation | None = None
        self._began_s: float | None = None
        self.found: list[GraspMoment] = []

    def add(self, observation: Observation) -> None:
        """Keep the newest frame and gripper state, for the grasp state that follows."""
        self._newest = observation
        if self._began_s is None:
            self._began_s = observation.frame.time_s

    def watch(self, state: GraspState) -> None:
        """Add a moment, if one is due."""
        if self._newest is None or self._began_s is None or state.has_ended:
            return
        frame, estimate, layout = self._newest.frame, state.estimate, self._plan.layout
        time_s = frame.time_s - self._began_s
        if self.found and time_s < self.found[-1].time_s + INTERVAL_S:
            return
        change = np.zeros((layout.rows, layout.cols))
        if estimate.rest_ohm is not None:
            change = SampleReader(layout, estimate.rest_ohm).read(frame).change_percent
        force = None
        if estimate.last is not None and state.phase in _FORCE_PHASES:
            # At rest the mean of the last frames, as the controller reads it.
            touch = estimate.now if estimate.touches else estimate.last
            force = read_force(touch, estimate.gain, self._plan)
        moment = GraspMoment(
            time_s=time_s,
            phase=state.phase,
            width_mm=self._newest.gripper.width_mm,
            change_percent=change,
            force_n=force,
        )
        self.found.append(moment)
        if self._follow is not None:
            self._follow(moment)
