"""Progress of a grasp for the page: phase, forecast, current answer and force gains."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.calibration import Calibration
from palpate.errors import CalibrationError
from palpate.force.force_law import ForceLaw
from palpate.force.gain import Gain
from palpate.force.of_calibration import HORIZON_S, force_law_of
from palpate.force.sheet_law import SheetLaw
from palpate.grasp.answers import forecast
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Moment
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.object.compliance import Compliance


def force_law(calibration: Calibration | None) -> SheetLaw | ForceLaw | None:
    """Return the force law of a calibration; None without force pairs."""
    if calibration is None:
        return None
    try:
        return force_law_of(calibration)
    except CalibrationError:
        return None


_FORECAST_PHASES = (Phase.SETTLE, Phase.HOLD)
#: Phases in which the answer is final; before them, a correction may follow.
_DECIDED_PHASES = (Phase.HOLD, Phase.RELEASE, Phase.DONE)
#: Minimum and maximum number of touches for a forecast; more touches are thinned.
_MIN_TOUCHES, _MAX_TOUCHES = 4, 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Target force and force limits of a grasp, newtons; None if not set."""

    target_n: float | None = None
    damage_low_n: float | None = None
    ceiling_n: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspProgress:
    """The controller's estimates in a grasp after a frame."""

    #: Time of the newest frame.
    time_s: float
    #: Name of the controller's activity or phase.
    phase: str
    #: Rest values of this grasp, shape (rows, cols).
    rest_ohm: NDArray[np.float64] | None
    #: Start of the grasp.
    began_s: float
    #: Grip force at the last step.
    force_n: float
    #: Forecast of the mean relative change at the horizon, from the frames so far.
    settled: Measurement | None
    #: The controller's answer; before its decision, the answer that the data would give now.
    answer: GraspResult
    #: Whether the controller has decided.
    decided: bool
    #: Forecast of the grip force at the horizon, newtons; continues after the decision.
    settled_n: Measurement | None = None
    #: Gain of this contact relative to the sheet; None before the first closing step.
    gain: Gain | None = None
    #: Compliance of a gripper that reports its width; None if unknown.
    compliance: Compliance | None = None
    #: Time of first contact; None until the contact is confirmed.
    touched_s: float | None = None
    #: Time to which the forecast refers, and duration of its data, seconds; None before a forecast.
    settles_s: float | None = None
    data_s: float | None = None
    #: Events reported by the controller.
    moments: tuple[Moment, ...] = ()
    #: Target and limits of the force.
    bounds: Bounds = field(default_factory=Bounds)


def grasp_progress_of(
    grasp_state: GraspState, *, plan: Plan, before: GraspProgress | None, forecasts: bool
) -> GraspProgress:
    """Return the progress of a grasp from the controller's state.

    The forecast uses the controller's own function and touches, so the band on the page is the
    basis of the controller's decision. The forecast continues after the decision while the hand
    holds.

    Parameters
    ----------
    grasp_state : GraspState
        The state after the newest frame.
    plan : Plan
        The plan of the grasp.
    before : GraspProgress or None
        The previous progress, whose forecast is retained until the next forecast.
    forecasts : bool
        Whether to compute a new forecast now, at a cost of milliseconds.
    """
    decided = grasp_state.result.force_n is not None and grasp_state.phase in _DECIDED_PHASES
    settled = settled_n = settles_s = data_s = None
    answer, touches = grasp_state.result, grasp_state.estimate.touches
    # A hand that reduces its force will close again, so no forecast is made.
    eases = grasp_state.activity is Activity.EASE
    foreseeable = grasp_state.phase in _FORECAST_PHASES and not eases
    if before is not None and (foreseeable or grasp_state.phase in (Phase.RELEASE, Phase.DONE)):
        settled, settled_n = before.settled, before.settled_n
        answer = grasp_state.result if decided else before.answer
        settles_s, data_s = before.settles_s, before.data_s
    if forecasts and foreseeable and len(touches) >= _MIN_TOUCHES:
        every = len(touches) // _MAX_TOUCHES + 1
        # Thinned from the end, so that the newest touch is included.
        thinned = grasp_state.snapshot()
        thinned.estimate.touches = touches[::-every][::-1]
        foreseen = forecast(thinned.estimate, plan=plan)
        thinned.set_settled_force(foreseen, plan=plan)
        would_answer = thinned.result
        settled, settled_n = foreseen, would_answer.force_n
        answer = grasp_state.result if decided else would_answer
        if not (decided and before is not None and before.decided):
            moved_s = grasp_state.estimate.moved_s
            settles_s, data_s = moved_s + HORIZON_S, grasp_state.estimate.now_s - moved_s
    gain, limit_n = grasp_state.estimate.gain, grasp_state.estimate.damage_low_n
    return GraspProgress(
        time_s=grasp_state.estimate.now_s,
        phase=grasp_state.activity.value,
        rest_ohm=grasp_state.estimate.rest_ohm,
        began_s=grasp_state.estimate.began_s or 0.0,
        force_n=grasp_state.estimate.force_n,
        settled=settled,
        answer=answer,
        decided=decided,
        settled_n=settled_n,
        compliance=plan.compliance,
        gain=gain if gain.log_sd > 0 else None,
        touched_s=_touch_time_s(grasp_state),
        settles_s=settles_s,
        data_s=data_s,
        moments=grasp_state.result.moments,
        bounds=Bounds(
            target_n=plan.target_force_n,
            damage_low_n=limit_n if math.isfinite(limit_n) else None,
            ceiling_n=plan.safety.force_ceiling_n,
        ),
    )


def _touch_time_s(grasp_state: GraspState) -> float | None:
    """Return the time of first contact, from which the decision time counts."""
    if not any(moment.name == "contact" for moment in grasp_state.result.moments):
        return None
    return grasp_state.first_contact_s
