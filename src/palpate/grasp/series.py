"""A series: one object grasped several times, a little firmer each time, for its stiffness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from palpate.clock import Clock
from palpate.errors import CalibrationError, DeviceError
from palpate.estimate.measurement import Measurement
from palpate.estimate.settled_series import SettledPoint, series_stiffness
from palpate.estimate.stiffness import Give
from palpate.grasp.belief import Belief
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import Watcher, run_grasp
from palpate.gripper.interface import Gripper
from palpate.sensor.array import PressureArray

#: Grasps of a series: the paper closes to five widths, too.
GRASPS = 5
#: The lightest of them: this share of the firmest, but not so light that a sheet may feel nothing
#: (newtons), nor so near the firmest that there is no curve.
_LIGHTEST_SHARE, _LIGHTEST_N, _NEAREST_SHARE = 0.2, 1.5, 0.5
#: So long the hand stands open between grasps: sheet and object forget the last squeeze. After 2 s
#: instead, a firm grasp of the twin said a tenth too much and missed its interval one time in four.
PAUSE_S = 20.0
#: A light grasp may slip where a firmer one holds; whatever else goes wrong ends the series.
_GOES_ON = (Outcome.HELD, Outcome.SLIPPED)
_FRAME_TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesGrasp:
    """One grasp of a series: what it aimed at, what came of it, and the final opening, mm."""

    target_force_n: float
    result: GraspResult
    opening_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """A finished series.

    Attributes
    ----------
    grasps : tuple of SeriesGrasp
        In order; fewer than five if the series ended early.
    stiffness_n_per_mm : Measurement or None
        Secant stiffness at the firmest settled force; None where fewer than three grasps held.
    """

    grasps: tuple[SeriesGrasp, ...]
    stiffness_n_per_mm: Measurement | None

    @property
    def held(self) -> tuple[SeriesGrasp, ...]:
        """The grasps that held."""
        return tuple(one for one in self.grasps if one.result.outcome is Outcome.HELD)

    @property
    def firmest_force_n(self) -> Measurement | None:
        """The largest settled force, at which the stiffness holds."""
        forces = [one.result.force_n for one in self.held if one.result.force_n is not None]
        return max(forces, key=lambda force: force.value, default=None)


def run_series(
    plan: Plan,
    *,
    up_to_n: float,
    array: PressureArray,
    gripper: Gripper,
    clock: Clock,
    told: Callable[[SeriesGrasp], object] | None = None,
    watchers: Sequence[Watcher] = (),
) -> Series:
    """Grasp an object to rising forces, with a pause between, and tell its stiffness from all.

    A grasp that neither holds nor slips ends the series; what was learned until then counts.

    Parameters
    ----------
    plan : Plan
        A plan for a width-driven gripper; its target force is not used.
    up_to_n : float
        Target of the firmest grasp, newtons: the object must bear it.
    told : callable, optional
        Gets each grasp as it ends.
    watchers : sequence of callable
        As for `run_grasp`, in every grasp.

    Raises
    ------
    CalibrationError
        If the gripper's pressure tells no width.

    Examples
    --------
    >>> import palpate
    >>> rig = palpate.open_rig("sim-rigid", object_name="springs-4", seed=3)
    >>> plan = palpate.plan_grasp(rig.calibration, gripper=rig.gripper)
    >>> series = palpate.run_series(
    ...     plan, up_to_n=8.0, array=rig.array, gripper=rig.gripper, clock=rig.clock
    ... )
    >>> rig.close()
    >>> len(series.held), round(series.stiffness_n_per_mm.value, 1)
    (5, 3.6)
    """
    give = plan.give
    if give is None:
        raise CalibrationError(
            "a series needs a gripper driven by width: pressure tells none, and the settled points "
            "of such fingers no stiffness"
        )
    grasps: list[SeriesGrasp] = []
    for target_n in targets_n(up_to_n):
        if grasps:
            _pause(array, until_s=clock.now_s() + PAUSE_S)
        opening = _Opening(plan, zero_mm=give.zero_mm)
        result = run_grasp(
            replace(plan, target_force_n=target_n),
            array=array,
            gripper=gripper,
            clock=clock,
            watchers=[opening.see, *watchers],
        )
        grasps.append(
            SeriesGrasp(target_force_n=target_n, result=result, opening_mm=opening.opening_mm)
        )
        if told is not None:
            told(grasps[-1])
        if result.outcome not in _GOES_ON:
            break
    return Series(grasps=tuple(grasps), stiffness_n_per_mm=_stiffness(grasps, give=give))


def targets_n(up_to_n: float) -> tuple[float, ...]:
    """Return the targets of a series, newtons, evenly spaced up to the firmest.

    Examples
    --------
    >>> targets_n(10.0)
    (2.0, 4.0, 6.0, 8.0, 10.0)
    """
    lightest_n = max(_LIGHTEST_SHARE * up_to_n, min(_LIGHTEST_N, _NEAREST_SHARE * up_to_n))
    return tuple(np.linspace(lightest_n, up_to_n, GRASPS).tolist())


def _stiffness(grasps: Sequence[SeriesGrasp], *, give: Give) -> Measurement | None:
    points = [
        SettledPoint(
            opening_mm=one.opening_mm,
            force=one.result.force_n,
            stiffness=one.result.stiffness_n_per_mm,
        )
        for one in grasps
        if one.result.outcome is Outcome.HELD
        and one.opening_mm is not None
        and one.result.force_n is not None
    ]
    return series_stiffness(points, give=give)


class _Opening:
    """Sees at which opening a grasp held."""

    def __init__(self, plan: Plan, *, zero_mm: float) -> None:
        self._plan, self._zero_mm = plan, zero_mm
        self.opening_mm: float | None = None

    def see(self, belief: Belief) -> None:
        """Take in what the controller believes."""
        if belief.phase is Phase.HOLD:
            self.opening_mm = self._plan.gripper.target(belief.closure) - self._zero_mm


def _pause(array: PressureArray, *, until_s: float) -> None:
    """Read and drop frames until a time, so that none is old when the next grasp begins.

    A sensor that is lost meanwhile is left to the next grasp, whose result says so.
    """
    with suppress(DeviceError):
        while array.read(timeout_s=_FRAME_TIMEOUT_S).time_s < until_s:
            pass
