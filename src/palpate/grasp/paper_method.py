"""The paper's own method: steps to contact (Figure 13), then the exponential and the line.

Pure handlers for the controller, which cuts every step to what is safe and watches for slips, too
much force and time as in its own phases.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.errors import CalibrationError, InputError
from palpate.estimate.line_law import settled_line
from palpate.estimate.measurement import Measurement
from palpate.estimate.weights_check import line_held_out
from palpate.grasp.belief import Belief
from palpate.grasp.paper import Paper
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import HORIZON_S
from palpate.grasp.releasing import Move, blind, nothing_there
from palpate.grasp.rezero import rezeroed
from palpate.grasp.step_size import closed_by, read
from palpate.sensor.calibration import Calibration
from palpate.settling.exponential import Exponential
from palpate.settling.result import Status


def by_paper(plan: Plan, paper: Paper, *, calibration: Calibration) -> Plan:
    """Return a plan that follows the paper's method.

    Parameters
    ----------
    plan : Plan
        What the calibration gives, with all bounds.
    paper : Paper
        Settings; its line is fitted here.
    calibration : Calibration
        Its settled pairs give the line of Table 4.

    Raises
    ------
    InputError
        If steps in mm are asked of fingers driven by pressure.
    """
    pressure = plan.gripper.drive == "pressure"
    if pressure and (paper.step_mm, paper.extra_mm) != (Paper().step_mm, Paper().extra_mm):
        raise InputError("this gripper is driven by pressure: leave --step-mm and --extra-mm out")
    try:
        line = settled_line(calibration.force, horizon_s=HORIZON_S)
    except CalibrationError:
        line = None
    return replace(
        plan,
        paper=replace(paper, line=line),
        step=plan.step if pressure else paper.step_mm,
        epsilon_percent=paper.epsilon_percent,
    )


def with_line_law(recorded: Calibration) -> Calibration:
    """Return the calibration with the line of Table 4, and its error on placements left out.

    Raises `CalibrationError` if its pairs can't carry a line.
    """
    line = settled_line(recorded.force, horizon_s=HORIZON_S)
    errors = line_held_out(recorded.force, horizon_s=HORIZON_S)
    held_out = {"of": "settled force by the line", "error_percent": errors}
    return replace(recorded, force_law=line.as_dict(), held_out=held_out)


def close_until_mean(belief: Belief, plan: Plan) -> Move:
    """Take the rest values, then close step by step until the mean of all pixels has fallen."""
    if belief.rest_ohm is None:
        if belief.still_s < plan.rest_s or len(belief.rest_frames) < plan.rest_frames:
            return belief, None
        belief = rezeroed(belief, plan=plan)
        return belief, None if belief.rest_ohm is None else closed_by(belief, plan.step, plan)
    if belief.still_s < plan.dwell_s or not belief.touches:
        return belief, None
    before = belief.staircase[-1].closure if belief.staircase else 0.0
    belief = read(belief, plan)
    if belief.now.relative_percent <= plan.epsilon_percent:
        belief = replace(belief, contact_s=belief.moved_s)
        return with_size(belief, plan, before=before).enter(Phase.SQUEEZE, note="contact"), None
    if belief.closure >= plan.gripper.span - 2 * plan.smallest_step:
        return nothing_there(belief, plan)
    command = closed_by(belief, plan.step, plan)
    return blind(belief, plan) if command is None else (belief, command)


def with_size(belief: Belief, plan: Plan, *, before: float) -> Belief:
    """Put the width before contact into the result: the paper's size; `before`: its closure."""
    if plan.give is None:
        return belief
    zero_mm = plan.give.zero_mm
    width_mm = plan.gripper.target(before)
    size = Measurement(
        value=width_mm - zero_mm,
        low=plan.gripper.target(belief.closure) - zero_mm,
        high=width_mm - zero_mm,
        unit="mm",
        level=plan.level,
    )
    result = replace(belief.result, previous_width_mm=width_mm, size_mm=size)
    return replace(belief, result=result)


def close_by_extra(belief: Belief, plan: Plan) -> Move:
    """Close further by the fixed amount, as far as that is safe."""
    assert plan.paper is not None
    extra_mm = plan.paper.extra_mm
    return belief.enter(Phase.SETTLE), closed_by(belief, extra_mm, plan) if extra_mm else None


def settle_exponentially(belief: Belief, plan: Plan) -> Move:
    """Wait for the cutoff, then predict the settled mean, and from it the force by the line."""
    assert plan.paper is not None
    if belief.now_s - belief.moved_s < plan.paper.cutoff_s or not belief.touches:
        return belief, None
    time_s = np.array([touch.time_s for touch in belief.touches]) - belief.moved_s
    percent = np.array([touch.relative_percent for touch in belief.touches])
    found = (
        Exponential()
        .predict(time_s, percent[None], horizon_s=plan.horizon_s, level=plan.level)
        .hold(0)
    )
    value = float(found.value)
    # The method gives no interval: as far as it went beyond what was read, to either side.
    beyond = abs(value - belief.now.relative_percent)
    settled = Measurement(
        value=value,
        low=value - beyond,
        high=value + beyond,
        unit="percent",
        level=plan.level,
        status=Status(str(found.status)),
    )
    contact_s = belief.moved_s if belief.contact_s is None else belief.contact_s
    result = replace(
        belief.result,
        decision_time_s=round(belief.now_s - contact_s, 6),
        settled_percent=settled,
        force_n=_by_line(settled, plan),
    )
    return replace(belief, result=result).enter(Phase.HOLD, note="answer"), None


def _by_line(settled: Measurement, plan: Plan) -> Measurement | None:
    """Return the force that the line of Table 4 gives for a settled change."""
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
