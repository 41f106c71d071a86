"""Grasp data for the page: phase, forecast, current answer, and force at every frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.calibrate.laws import laws_with_memory
from palpate.errors import CalibrationError
from palpate.estimate.force import StaticLaw
from palpate.estimate.force_now import ContactGains, ForceLaws
from palpate.estimate.gain import Gain
from palpate.estimate.measurement import Measurement
from palpate.grasp.answers import forecast
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Moment
from palpate.grasp.state import GraspState
from palpate.sensor.calibration import Calibration


def force_laws(calibration: Calibration | None) -> ForceLaws | None:
    """Return the force laws of a calibration; None without force pairs."""
    if calibration is None:
        return None
    try:
        return laws_with_memory(calibration.force)
    except CalibrationError:
        return None


def compute_settled_gain(force: Measurement, *, law_n: float, law: StaticLaw) -> Gain | None:
    """Return the gain from the settled law's reading to a settled force.

    Parameters
    ----------
    force : Measurement
        The settled force, with all that is known of it weighed in.
    law_n : float
        What the law alone reads.
    law : StaticLaw
        The settled law.

    Examples
    --------
    >>> from palpate.estimate.pixel_law import PixelForceLaw
    >>> law = PixelForceLaw(log_scale=0.0, exponent=1.0, residual_sd=0.2, floor_n=0.01,
    ...     range=(0.1, 10.0))
    >>> force = Measurement(value=3.0, low=2.7, high=3.3, unit="n")
    >>> gain = compute_settled_gain(force, law_n=2.0, law=law)
    >>> round(math.exp(gain.log_mean), 2), gain.log_sd < gain.law_sd
    (1.5, True)
    """
    if not (law_n > 0 and force.low > 0):
        return None
    z_limit = float(ndtri(0.5 + force.level / 2))
    return Gain(
        log_mean=math.log(force.middle / law_n),
        log_sd=math.log(force.high / force.low) / (2.0 * z_limit),
        law_sd=law.residual_sd,
    )


_FORECAST_PHASES = (Phase.SETTLE, Phase.HOLD)
#: Before these, a first answer may be corrected by another movement.
_DECIDED_PHASES = (Phase.HOLD, Phase.RELEASE, Phase.DONE)
#: A forecast from fewer touches than this is noise; with more than that, every other will do.
_MIN_TOUCHES, _MAX_TOUCHES = 4, 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Target force and force limit of a grasp, newtons; None without one."""

    target_n: float | None = None
    damage_low_n: float | None = None
    ceiling_n: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspProgress:
    """The controller's view of a grasp after a frame."""

    #: Time of its last frame.
    time_s: float
    #: Phase of the controller.
    phase: str
    #: Rest values taken for this grasp, shape (rows, cols).
    rest_ohm: NDArray[np.float64] | None
    #: When the grasp began.
    began_s: float
    #: Grip force as the last step read it.
    force_n: float
    #: Forecast of the mean relative change at the horizon, from the frames up to now.
    settled: Measurement | None
    #: The controller's own once it has decided; before that, what it would answer now.
    answer: GraspResult
    #: Whether the controller has decided.
    decided: bool
    #: Forecast of the grip force at the horizon, newtons; continues after the decision.
    settled_n: Measurement | None = None
    #: Gain of this contact relative to the laws.
    gains: ContactGains = field(default_factory=ContactGains)
    #: When the fingers first touched the object; None until that is certain.
    touched_s: float | None = None
    #: When the answer's forecast is of, and the data that it rests on, seconds; None before.
    settles_s: float | None = None
    data_s: float | None = None
    #: Events that the controller has noted.
    moments: tuple[Moment, ...] = ()
    #: Target and limits of the force.
    bounds: Bounds = field(default_factory=Bounds)


def grasp_progress_of(
    grasp_state: GraspState, *, plan: Plan, before: GraspProgress | None, forecasts: bool
) -> GraspProgress:
    """Return the progress of a grasp from the controller's grasp_state.

    The forecast is the controller's own function on the controller's own touches, so the band on
    the page is the one that it decides by. It continues after the decision, while the hand holds.

    Parameters
    ----------
    grasp_state : GraspState
        After the newest frame.
    plan : Plan
        The grasp's.
    before : GraspProgress or None
        The previous one: its forecast is kept until there is a newer one.
    forecasts : bool
        Whether to make a new one now; it costs milliseconds.
    """
    decided = grasp_state.result.force_n is not None and grasp_state.phase in _DECIDED_PHASES
    settled = settled_n = settled_gain = settles_s = data_s = None
    answer, touches = grasp_state.result, grasp_state.estimate.touches
    # A hand that eases off is about to close again.
    eases = grasp_state.activity == Activity.EASE
    foreseeable = grasp_state.phase in _FORECAST_PHASES and not eases
    if before is not None and (foreseeable or grasp_state.phase in (Phase.RELEASE, Phase.DONE)):
        settled, settled_n = before.settled, before.settled_n
        settled_gain = before.gains.settled
        answer = grasp_state.result if decided else before.answer
        settles_s, data_s = before.settles_s, before.data_s
    if forecasts and foreseeable and len(touches) >= _MIN_TOUCHES:
        every = len(touches) // _MAX_TOUCHES + 1
        # From the end: the newest touch is always among them.
        thinned = grasp_state.snapshot()
        thinned.estimate.touches = touches[::-every][::-1]
        foreseen = forecast(thinned.estimate, plan=plan)
        thinned.set_settled_force(foreseen, plan=plan)
        would_answer = thinned.result
        settled, settled_n = foreseen.relative_percent, would_answer.force_n
        settled_gain = None
        if settled_n is not None:
            law_n = float(plan.settled_law.force_n(foreseen.reading.middle).value)
            settled_gain = compute_settled_gain(settled_n, law_n=law_n, law=plan.settled_law)
        answer = grasp_state.result if decided else would_answer
        if not (decided and before is not None and before.decided):
            moved_s = grasp_state.estimate.moved_s
            settles_s, data_s = moved_s + plan.horizon_s, grasp_state.estimate.now_s - moved_s
    gain, limit_n = grasp_state.estimate.gain, grasp_state.estimate.damage_low_n
    return GraspProgress(
        time_s=grasp_state.estimate.now_s,
        phase=grasp_state.activity,
        rest_ohm=grasp_state.estimate.rest_ohm,
        began_s=grasp_state.estimate.began_s or 0.0,
        force_n=grasp_state.estimate.force_n,
        settled=settled,
        answer=answer,
        decided=decided,
        settled_n=settled_n,
        # Before its first step the closing has given none.
        gains=ContactGains(early=gain if gain.log_sd > 0 else None, settled=settled_gain),
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
    """Return the time of first contact, where the answer time starts."""
    if not any(moment.name == "contact" for moment in grasp_state.result.moments):
        return None
    felt_s = grasp_state.attempt.sweep_contact_s
    return grasp_state.estimate.contact_s if felt_s is None else felt_s
