"""How a grasp ends by opening the hand, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

from palpate.grasp.belief import Belief
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.gripper.interface import GripperCommand

#: A handler's answer: what it believes now, and what it wants of the gripper (None: nothing).
Move: TypeAlias = tuple[Belief, GripperCommand | None]


def release(belief: Belief, plan: Plan, outcome: Outcome) -> Move:
    """Open the hand: the grasp is over."""
    belief = replace(belief, result=replace(belief.result, outcome=outcome))
    belief = replace(belief, sent=0.0, still_since_s=None, touches=())
    command = GripperCommand(target=plan.gripper.target(0.0), rate=plan.gripper.fastest)
    return belief.enter(Phase.RELEASE, note=outcome.value), command


def nothing_there(belief: Belief, plan: Plan) -> Move:
    """Open: for good, or to wait and try again."""
    if belief.tries + 1 >= plan.tries:
        return release(belief, plan, Outcome.NOTHING_THERE)
    belief, command = release(belief, plan, Outcome.NOTHING_THERE)
    return replace(belief, tries=belief.tries + 1, phase=Phase.WAIT, fingers=()), command


def blind(belief: Belief, plan: Plan) -> Move:
    """Open: the calibration can't exclude that the little that is felt is too much already."""
    fault = (
        f"by this calibration a faint touch could be {belief.force_high_n:.1f} N, and "
        f"{plan.safety.force_ceiling_n:g} N is the most allowed; calibrate the force again"
    )
    return release(belief.with_fault(fault), plan, Outcome.FORCE_LIMIT)


def stuck(belief: Belief, plan: Plan) -> Move:
    """Open: what the sheet reads does not follow the fingers."""
    fault = (
        "the sheet reads as much after the fingers went back as while they touched; see what "
        "`palpate doctor` reports"
    )
    return release(belief.with_fault(fault), plan, Outcome.SENSOR_LOST)
