"""Records, contacts and grasps of the twin, with defaults for all unmentioned values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.calibration import Calibration, ForcePairs
from palpate.force.sheet_law import N_SHARED, SheetLaw
from palpate.force.sheet_states import compute_states
from palpate.grasp.estimator import ClosingStep, Touch
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.world import World

#: Settled readings of three weights.
WEIGHTS = ForcePairs(
    run=(0, 0, 0),
    since_move_s=(20.0,) * 3,
    excess=(13.0, 42.0, 112.0),
    relative_percent=(-60.0, -80.0, -90.0),
    force_n=(1.5, 4.0, 9.0),
)


def touch(sheet_n: float, *, percent: float = -20.0, time_s: float = 1.0) -> Touch:
    """Return a force of the sheet while both fingers change alike."""
    return Touch(
        time_s=time_s, finger_percent=(percent, percent), relative_percent=percent, sheet_n=sheet_n
    )


def closing_steps(
    readings: Sequence[float], *, step_mm: float, begin: float = 20.0, percent: float = -20.0
) -> tuple[ClosingStep, ...]:
    """Return closing steps of equal length, one per second, with these readings."""
    return tuple(
        ClosingStep(
            closure=begin + step_mm * number,
            touch=touch(reading, percent=percent, time_s=float(number)),
        )
        for number, reading in enumerate(readings)
    )


def draw(name: str, *seed: int) -> TwinObject:
    """Draw an object by name with a seed."""
    return draw_object(np.random.default_rng(seed), name)


def grasp_on_twin(
    world: World, calibration: Calibration, *, views: dict[str, Any] | None = None, **wishes: Any
) -> GraspResult:
    """Grasp an object on the twin; `wishes` set the plan, `views` the loop."""
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper, **wishes)
    array = TwinArray(world)
    return run_grasp(plan, array=array, gripper=gripper, clock=world.clock, **(views or {}))


def make_sheet_law(pixels: int) -> SheetLaw:
    """Return a law without creep: about 1 N for each unit of excess conductance of a pixel."""
    mean = np.zeros(N_SHARED + pixels)
    mean[1] = 1.0
    contact = np.zeros(mean.size)
    contact[0] = 0.2**2
    return SheetLaw(
        mean=mean,
        covariance=np.zeros((mean.size, mean.size)),
        contact=contact,
        reach=5.0,
        noise=0.05,
        floor_n=0.01,
    )


def fit_even_sheet(pixels: int, *, force_n: np.ndarray, scatter: float) -> SheetLaw:
    """Return the law of a sheet without lag whose excess, summed over pixels, is twice the force.

    `scatter`: of ln force, alternately up and down.
    """
    each_n = np.append(0.0, np.repeat(force_n, 2))
    time_s = np.cumsum(np.append(0.0, np.tile([0.42, 20.0], force_n.size)))
    states = compute_states(time_s, np.outer(2.0 * each_n / pixels, np.ones(pixels)))
    signs = (-1.0) ** np.arange(each_n.size)
    return SheetLaw.fit([(states, each_n * np.exp(sd * signs)) for sd in (scatter, -scatter) * 2])
