"""The paper's method: closing steps to contact (Figure 13), exponential fit, and force line.

Phase handlers for the controller. Its safety filter and monitors apply as in the default method.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import CalibrationError, InputError
from palpate.force.line_law import fit_settled_line
from palpate.force.of_calibration import HORIZON_S
from palpate.grasp.approach import abort_insensitive, end_attempt, wait_for_retry
from palpate.grasp.paper import Paper
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.rest import measure_rest
from palpate.grasp.state import GraspState
from palpate.grasp.step_size import close_by, record_step
from palpate.gripper.interface import GripperCommand
from palpate.measurement import Measurement, Status
from palpate.settling.exponential import Exponential


def use_paper_method(plan: Plan, paper: Paper, *, calibration: Calibration) -> Plan:
    """Return the plan changed to the paper's method.

    Parameters
    ----------
    plan : Plan
        Plan of the default method, with all limits.
    paper : Paper
        Settings; the line is fitted by this function.
    calibration : Calibration
        Its settled pairs determine the line of Table 4.

    Raises
    ------
    InputError
        If steps in mm are set for pressure-driven fingers.
    """
    pressure = plan.gripper.drive == "pressure"
    if pressure and (paper.step_mm, paper.extra_mm) != (Paper().step_mm, Paper().extra_mm):
        raise InputError("this gripper is pressure-driven: omit --step-mm and --extra-mm")
    try:
        line = fit_settled_line(calibration.force, horizon_s=HORIZON_S)
    except CalibrationError:
        line = None
    return replace(
        plan,
        paper=replace(paper, line=line),
        step=plan.step if pressure else paper.step_mm,
        epsilon_percent=paper.epsilon_percent,
    )


def close_until_contact(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Measure the rest values, then close in steps until the mean change shows contact."""
    if state.attempt.activity is Activity.WAIT:
        return wait_for_retry(state, plan)
    estimate = state.estimate
    if estimate.rest_ohm is None:
        return close_by(estimate, plan.step, plan) if measure_rest(state, plan=plan) else None
    if estimate.still_s < plan.dwell_s or not estimate.touches:
        return None
    before = estimate.steps[-1].closure if estimate.steps else 0.0
    record_step(estimate, plan)
    if estimate.now.relative_percent <= plan.epsilon_percent:
        estimate.contact_s = estimate.moved_s
        record_size(state, plan, before=before)
        state.enter(Phase.SQUEEZE, event="contact")
        return None
    if estimate.closure >= plan.gripper.span - 2 * plan.smallest_step:
        return end_attempt(state, plan)
    return close_by(estimate, plan.step, plan) or abort_insensitive(state, plan)


def record_size(state: GraspState, plan: Plan, *, before: float) -> None:
    """Set the result's size to the width at closure `before`, one step before contact."""
    if plan.compliance is None:
        return
    zero_mm, width_mm = plan.compliance.zero_mm, plan.gripper.target(before)
    size = Measurement(
        value=width_mm - zero_mm,
        low=plan.gripper.target(state.estimate.closure) - zero_mm,
        high=width_mm - zero_mm,
        unit="mm",
        level=plan.level,
    )
    state.result = replace(state.result, previous_width_mm=width_mm, size_mm=size)


def close_extra(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Close further by `extra_mm`, if that is safe."""
    assert plan.paper is not None
    extra_mm = plan.paper.extra_mm
    state.enter(Phase.SETTLE)
    return close_by(state.estimate, extra_mm, plan) if extra_mm else None


def predict_exponentially(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait for the cutoff, then predict the settled mean change and the force."""
    assert plan.paper is not None
    estimate = state.estimate
    if estimate.now_s - estimate.moved_s < plan.paper.cutoff_s or not estimate.touches:
        return None
    time_s = np.array([touch.time_s for touch in estimate.touches]) - estimate.moved_s
    percent = np.array([touch.relative_percent for touch in estimate.touches])
    found = (
        Exponential().predict(time_s, percent[None], horizon_s=HORIZON_S, level=plan.level).hold(0)
    )
    value = float(found.value)
    # The method has no interval: use the predicted change from the present reading.
    half_width = abs(value - estimate.now.relative_percent)
    settled = Measurement(
        value=value,
        low=value - half_width,
        high=value + half_width,
        unit="percent",
        level=plan.level,
        status=Status(str(found.status)),
    )
    force = _force_from_line(settled, plan)
    if force is not None:
        estimate.peak_force_n = max(estimate.peak_force_n, force.middle)
    state.result = replace(
        state.result,
        decision_time_s=round(estimate.now_s - state.first_contact_s, 6),
        settled_percent=settled,
        force_n=force,
    )
    state.enter(Phase.HOLD, event="answer")
    return None


def _force_from_line(settled: Measurement, plan: Plan) -> Measurement | None:
    """Convert a settled change to force with the line of Table 4."""
    assert plan.paper is not None
    line = plan.paper.line
    if line is None:
        return None
    law = line.force_n([settled.middle, settled.low, settled.high], level=plan.level)
    status = settled.status
    if status is Status.OK and not bool(law.in_range[0]):
        status = Status.SATURATED
    return Measurement(
        value=float(law.value[0]),
        low=float(np.min(law.low)),
        high=float(np.max(law.high)),
        unit="n",
        level=plan.level,
        status=status,
    )
