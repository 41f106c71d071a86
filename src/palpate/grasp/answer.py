"""From what was felt to the answer: settled value, force, size and stiffness, with intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from palpate.estimate.closing_stiffness import ClosingSteps, object_stiffness
from palpate.estimate.compliance import (
    SOFTEST_N_PER_MM,
    STIFFEST_N_PER_MM,
    Compliance,
    SoftFingerCompliance,
)
from palpate.estimate.firmness import firmness_index
from palpate.estimate.gain import Gain, MeasuredForce
from palpate.estimate.measurement import Measurement
from palpate.estimate.size import ContactPoint, contact_point
from palpate.estimate.soft_stiffness import soft_stiffness
from palpate.grasp.belief import Belief, Closing, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult
from palpate.grasp.servo_evidence import felt_by_gripper
from palpate.settling.percent import as_percent, of_rest
from palpate.settling.result import SettledEstimate, Status

#: Why a stiffness is only bounded.
_SOFT_FINGERS = "the soft fingers give way far more than the object"
_RIGID_FINGERS = (
    "the object gave way too little compared with the hand's own give; a firmer squeeze "
    "(--target-force-n) would show more"
)


#: Normal variables at five and three points with their probabilities (Gauss-Hermite).
_GAIN_NODES, _GAIN_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_BLIND_NODES, _BLIND_WEIGHTS = np.polynomial.hermite_e.hermegauss(3)
#: Use and climate change a sheet's gain between calibration and grasp: log sd in force, as long as
#: nobody checks (paper, Figures 3 and 4).
_SINCE_SD = 0.05
#: Share of the closing force that is left at the horizon, and its doubt (ln): a spring keeps all,
#: silicone loses a percent or two, fruit around a tenth. The sheet hides it: it creeps on.
_RELAXED, _RELAXED_SD = 0.96, 0.03
#: What is held still keeps at least this share of its reading until the horizon, and reaches at
#: most that multiple of it: fruit relaxes by a third, sheets creep by half. Beyond is extrapolated
#: noise.
_KEPT = (0.5, 2.0)
#: A fall below this is a touch: ten times the noise of a few frames' mean.
FELT_PERCENT = -1.0
#: How far before the first sure touch a step may count, in steps of the approach.
_FAINT_STEPS = 3.0
#: Less than this share of the faintest force of the calibration may be drift, or what the sheet
#: remembers: such a step bounds the size as one that felt nothing.
_FELT_FLOOR = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """The sheet's predicted reading at the horizon."""

    relative_percent: Measurement
    reading: Measurement


def forecast(belief: Belief, *, plan: Plan) -> Settled:
    """Predict the settled readings from the touches since the last movement.

    The predictor knows sheets, not objects; one that relaxes in the hand (fruit loses a tenth to a
    third of its force) works against the sheet's creep. So the interval is widened by as far as the
    forecast goes beyond what was seen. What the sheet's own calibration showed of its creep is
    weighed in.
    """
    time_s = np.array([t.time_s for t in belief.touches]) - belief.moved_s
    relative_percent = np.array([t.relative_percent for t in belief.touches])
    values = np.stack([of_rest(relative_percent), [t.reading for t in belief.touches]])
    found = plan.settling.predict(time_s, values, horizon_s=plan.horizon_s, level=plan.level)
    seen = (belief.now.relative_percent, belief.now.reading)
    relative, reading = (
        _widened(one, by=float(one.value) - now, unit=unit)
        for one, now, unit in zip(
            (as_percent(found.hold(0)), found.hold(1)), seen, ("percent", "reading"), strict=True
        )
    )
    reading = _kept(reading, now=belief.now.reading)
    if plan.creep is not None:
        reading = plan.creep.joined(reading, now=belief.now.reading, since_s=float(time_s[-1]))
        relative = _relative_by(reading, relative, now=belief.now)
    return Settled(relative_percent=relative, reading=reading)


def _relative_by(reading: Measurement, relative: Measurement, *, now: Touch) -> Measurement:
    """Return the forecast of the relative change that the forecast of the reading makes.

    The sheet's own creep is known for the reading; conductance grows by the same share in both.
    """
    if not (now.reading > 0 and now.relative_percent < 0):
        return relative
    excess = 1.0 / (1.0 + now.relative_percent / 100.0) - 1.0
    value, low, high = (
        100.0 * (1.0 / (1.0 + excess * end / now.reading) - 1.0)
        for end in (reading.middle, reading.high, reading.low)
    )
    return replace(relative, value=value, low=low, high=high)


def _widened(one: SettledEstimate, *, by: float, unit: str) -> Measurement:
    value = float(one.value)
    # A predictor without an interval of its own leaves only what it added to what was seen.
    down, up = np.nan_to_num([value - one.low, one.high - value])
    return Measurement(
        value=value,
        low=value - float(np.hypot(down, by)),
        high=value + float(np.hypot(up, by)),
        unit=unit,
        level=one.level,
        status=Status(str(one.status)),
    )


def _kept(reading: Measurement, *, now: float) -> Measurement:
    """Return the forecast, or the present reading in its place if nothing held could read that."""
    least, most = now * _KEPT[0], now * _KEPT[1]
    if now <= 0 or least <= reading.middle <= most:
        return reading
    return replace(reading, value=now, low=least, high=most, status=Status.FELL_BACK)


def sure_enough(settled: Settled, *, plan: Plan) -> bool:
    """Whether the interval of the settled reading is narrow enough to act on.

    Waiting is worth it only while the forecast is doubted more than half as much as the force law.
    """
    reading = settled.reading
    half = max(reading.high - reading.middle, reading.middle - reading.low)
    of_law = 0.5 * float(ndtri(0.5 + plan.level / 2)) * plan.settled_law.residual_sd
    enough = max(plan.decide_half_width, of_law)
    # The interval is widened by all that the forecast adds, so an unproven shape does no harm.
    known = reading.status in (Status.OK, Status.UNPROVEN)
    return known and half <= enough * abs(reading.middle)


def answered(belief: Belief, settled: Settled, *, plan: Plan) -> Belief:
    """Put the settled force into the result."""
    force = settled_force(settled, felt=felt_by_gripper(belief, plan), plan=plan)
    touched_s = (s for s in (belief.felt_s, belief.contact_s, belief.moved_s) if s is not None)
    result = replace(
        belief.result,
        decision_time_s=round(belief.now_s - next(touched_s), 6),
        settled_percent=settled.relative_percent,
        force_n=force,
        peak_force_n=max(belief.peak_force_n, force.middle),
    )
    return replace(belief, result=result, peak_force_n=max(belief.peak_force_n, force.middle))


def examined(belief: Belief, *, plan: Plan) -> Belief:
    """Put size and stiffness into the result, where the hand can measure them."""
    force = belief.result.force_n
    if force is None:
        return belief
    if plan.bend is not None:
        soft = _soft_stiffness(belief, force, plan, plan.bend)
        return replace(belief, result=_with_stiffness(belief.result, soft, reason=_SOFT_FINGERS))
    size = None if plan.give is None else _contact_point(belief, plan, plan.give)
    if plan.give is None or size is None:
        return belief
    result = replace(belief.result, size_mm=_size(size, plan, plan.give))
    stiffness = _stiffness(belief, force, plan, plan.give)
    return replace(belief, result=_with_stiffness(result, stiffness, reason=_RIGID_FINGERS))


def _with_stiffness(
    result: GraspResult, stiffness: Measurement | None, *, reason: str
) -> GraspResult:
    """Add firmness, and stiffness: a bound with this reason where the interval is wide."""
    if stiffness is None:
        return replace(result, stiffness_n_per_mm=None, firmness=None)
    bounded = stiffness.or_bound(reason, least=SOFTEST_N_PER_MM, most=STIFFEST_N_PER_MM)
    return replace(result, stiffness_n_per_mm=bounded, firmness=firmness_index(stiffness))


def settled_force(settled: Settled, *, felt: MeasuredForce | None, plan: Plan) -> Measurement:
    """Convert the settled reading to newtons, and weigh in what the gripper itself felt.

    Doubts add in ln force: the law's own scatter, use of the sheet since, and what the forecast
    leaves open, carried through the law.
    """
    reading = settled.reading
    more_sd = float(np.hypot(_SINCE_SD, _RELAXED_SD))
    law = Gain.unknown(law_sd=plan.settled_law.residual_sd, more_sd=more_sd).applied(
        plan.settled_law.force_n([reading.middle, reading.low, reading.high], level=plan.level)
    )
    value = float(law.value[0])
    status = Status.OK if bool(law.in_range[0]) else Status.SATURATED
    status = reading.status if status is Status.OK else status
    if value <= 0:
        low, high = 0.0, float(law.high[0])
        return Measurement(value=0.0, low=low, high=high, unit="n", level=plan.level, status=status)
    down = float(np.hypot(_log_ratio(value, law.low[0]), _log_ratio(value, law.value[1])))
    up = float(np.hypot(_log_ratio(law.high[0], value), _log_ratio(law.value[2], value)))
    if felt is not None:
        reach = float(ndtri(0.5 + plan.level / 2))
        relaxed = replace(
            felt,
            force_n=_RELAXED * felt.force_n,
            log_sd=float(np.hypot(felt.log_sd, _RELAXED_SD)),
        )
        gain = Gain.unknown(law_sd=0.5 * (down + up) / reach).updated(relaxed, sheet_n=value)
        value, down, up = value * float(np.exp(gain.log_mean)), *(reach * gain.log_sd,) * 2
    return Measurement(
        value=value,
        low=value * float(np.exp(-down)),
        high=value * float(np.exp(up)),
        unit="n",
        level=plan.level,
        status=status,
    )


def _log_ratio(large: float, small: float) -> float:
    # A bound at 0 N counts as a thousandth: its logarithm would dominate everything else.
    return float(np.log(large / max(small, 1e-3 * large)))


def _contact_point(belief: Belief, plan: Plan, give: Compliance) -> ContactPoint | None:
    """Extrapolate the staircase, read in early forces, to where contact began."""
    steps = _from_touch(belief, plan)
    if not steps:
        return None
    width = np.array([plan.gripper.target(c.closure) for c in steps])
    felt = np.array([c.touch.shared_percent < FELT_PERCENT for c in steps])
    reading = np.array([c.touch.reading for c in steps])
    read = belief.gain.applied(plan.early_law.force_n(reading, level=plan.level))
    # Below the weakest reading of the calibration the law can't distinguish forces.
    floor_n = float(plan.early_law.force_n(plan.early_law.range[0]).value)
    felt &= read.value > _FELT_FLOOR * floor_n
    if felt.sum() < 2:
        return None
    force = np.where(felt, read.value, 0.0)
    # One place on the sheet, one gain for the whole curve: it hardly bends it, but what is taken
    # out as the gripper's give goes with it.
    upper = np.log(read.high[felt] / read.value[felt])
    reach = float(ndtri(0.5 + plan.level / 2))
    gain_sd = float(np.median(upper)) / reach
    # Nor is it known how much force is lost before a pixel feels any: all forces have that error.
    blind_n = float(plan.early_law.force_n(0.0, level=plan.level).high) / reach
    points, weights = [], []
    for gain, share in zip(_GAIN_NODES, _GAIN_WEIGHTS, strict=True):
        for offset, part in zip(_BLIND_NODES, _BLIND_WEIGHTS, strict=True):
            read_n = force * float(np.exp(gain_sd * gain))
            shifted = np.where(read_n > 0, np.maximum(read_n + blind_n * offset, 0.3 * read_n), 0.0)
            points.append(
                contact_point(
                    width - give.zero_mm,
                    force_n=shifted,
                    give_mm=give.give_mm(shifted),
                    floor_n=floor_n,
                )
            )
            weights.append(float(share * part))
    return ContactPoint.mixture(points, weights=weights)


def _size(size: ContactPoint, plan: Plan, give: Compliance) -> Measurement:
    """Return the size, widened by the scatter of the gripper's own width."""
    tail = (1 - plan.level) / 2
    low, value, high = size.quantile([tail, 0.5, 1 - tail])
    own = float(ndtri(1 - tail)) * give.residual_mm
    return Measurement(
        value=float(value),
        low=float(value - np.hypot(value - low, own)),
        high=float(value + np.hypot(high - value, own)),
        unit="mm",
        level=plan.level,
    )


def _stiffness(
    belief: Belief, force: Measurement, plan: Plan, give: Compliance
) -> Measurement | None:
    """Return the object's own secant stiffness at the settled force."""
    curve = _closing_curve(belief, plan, give)
    if curve is None:
        return None
    opening_mm = plan.gripper.target(belief.closure) - give.zero_mm
    return object_stiffness(curve, give=give, opening_mm=opening_mm, force=force)


def measured_stiffness(belief: Belief, force: Measurement, *, plan: Plan) -> Measurement | None:
    """Return the object's secant stiffness at a force, if the hand can and felt enough."""
    if plan.bend is not None:
        return _soft_stiffness(belief, force, plan, plan.bend)
    return None if plan.give is None else _stiffness(belief, force, plan, plan.give)


def felt_steps(belief: Belief, plan: Plan) -> int:
    """Return how many steps of the closing a stiffness can be estimated from."""
    give = plan.give if plan.bend is None else plan.bend.give
    curve = None if give is None else _closing_curve(belief, plan, give)
    return 0 if curve is None else int(np.count_nonzero(curve.felt))


def _soft_stiffness(
    belief: Belief, force: Measurement, plan: Plan, bend: SoftFingerCompliance
) -> Measurement | None:
    """Return the same from fingers driven by pressure, as far as they can measure it."""
    curve = _closing_curve(belief, plan, bend.give, mm_per_unit=-bend.mm_per_kpa)
    if curve is None:
        return None
    opening_mm = -bend.mm_per_kpa * plan.gripper.target(belief.closure) - bend.give.zero_mm
    return soft_stiffness(curve, give=bend.give, opening_mm=opening_mm, force=force)


def _closing_curve(
    belief: Belief, plan: Plan, give: Compliance, *, mm_per_unit: float = 1.0
) -> ClosingSteps | None:
    """Return the staircase read in early forces, from just before the first touch on."""
    steps = _from_touch(belief, plan)
    if not steps:
        return None
    felt = np.array([c.touch.shared_percent < FELT_PERCENT for c in steps])
    read = belief.gain.applied(
        plan.early_law.force_n([c.touch.reading for c in steps], level=plan.level)
    )
    reach = float(ndtri(0.5 + plan.level / 2))
    firmest = int(np.argmax(read.value))
    return ClosingSteps(
        width_mm=mm_per_unit * np.array([plan.gripper.target(c.closure) for c in steps])
        - give.zero_mm,
        force_n=np.where(felt, read.value, 0.0),
        gain_sd=float(np.log(read.high[firmest] / read.value[firmest])) / reach,
        law_sd=belief.gain.law_sd,
        floor_n=floor_n(plan),
    )


def _from_touch(belief: Belief, plan: Plan) -> tuple[Closing, ...]:
    """Return the steps from just before the first sure touch on; none if there is none.

    Drift can look like a faint touch long before the real one: no more than two steps of it, and
    no way further than that.
    """
    hinted = [c.touch.shared_percent < plan.hint_percent for c in belief.staircase]
    if not any(hinted):
        return ()
    first = hinted.index(True)
    nearest = belief.staircase[first].closure - _FAINT_STEPS * plan.step
    before = [c for c in belief.staircase[max(first - 2, 0) : first] if c.closure > nearest]
    return (*before, *belief.staircase[first:])


def floor_n(plan: Plan) -> float:
    """Return the scatter of faint forces: how much there may be where the sheet reads nothing."""
    nothing = plan.early_law.force_n(0.0, level=plan.level)
    return float(nothing.high) / float(ndtri(0.5 + plan.level / 2))
