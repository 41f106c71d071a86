"""Jobs of the devices' process: grasp, and open the hand."""

from __future__ import annotations

from contextlib import suppress

from palpate.dashboard.job_context import JobContext
from palpate.dashboard.messages import Grasped
from palpate.dashboard.orders import GraspOrder, OpenHand
from palpate.errors import DeviceError
from palpate.estimate.damage_file import recorded_model
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.produce.ripeness.closing import ClosingWatch
from palpate.rig.recorded import open_grasp_recording
from palpate.sensor.array import FRAME_TIMEOUT_S

#: The object is held until its release is asked for, but not for longer than this: sheet, object
#: and servo suffer. Approach and squeeze have their own time.
HOLD_S, LONGEST_S = 60.0, 240.0
#: An opening hand is watched for at most this time.
_OPENING_S = 10.0


def grasp(order: GraspOrder, *, context: JobContext) -> Grasped:
    """Run one grasp; every frame of it is recorded."""
    rig, telemetry = context.whole, context.telemetry
    plan = plan_grasp(
        rig.calibration,
        gripper=rig.gripper,
        target_force_n=order.target_force_n,
        damage=recorded_model(order.damage),
        kind=order.kind,
        hold_s=HOLD_S,
        longest_s=LONGEST_S,
    )
    context.catch_up()
    order.recording.parent.mkdir(parents=True, exist_ok=True)
    with open_grasp_recording(
        order.recording,
        rig=rig,
        seed=context.seed,
        target_force_n=order.target_force_n,
        damage=order.damage,
        kind=order.kind,
    ) as writer:

        def recorder(observation: Observation) -> None:
            """Write each frame with the gripper's state next to it."""
            writer.add_observation(observation.frame, gripper=observation.gripper)

        def react(grasp_state: GraspState) -> None:
            # A hand that vents, or was opening already, is stopped only when it is open.
            """Confirm a stop as soon as the hand opens."""
            if grasp_state.phase is Phase.RELEASE and context.requests.stop.is_set():
                context.confirm_stop()

        closing = ClosingWatch(plan)
        telemetry.set_plan(plan)
        result = run_grasp(
            plan,
            array=context.array,
            gripper=rig.gripper,
            clock=rig.clock,
            subscribers=[recorder, telemetry.observe],
            watchers=[telemetry.take_belief, react, closing.see],
            requests=context.requests,
        )
        # Before the recording is closed: a slow disk must not delay the confirmation.
        if context.requests.stop.is_set():
            with suppress(DeviceError):
                context.stop_hand()
    truth = None if rig.truth is None else dict(rig.truth())
    return Grasped(
        result=result, truth=truth, recording=order.recording, closing=closing.measured()
    )


def open_hand(order: OpenHand, *, context: JobContext) -> None:
    """Open the hand and watch it arrive; a stop request stops it where it is."""
    gripper, clock, array = context.whole.gripper, context.rig.clock, context.watched()
    gripper.release()
    until_s = clock.now_s() + _OPENING_S
    try:
        array.read(timeout_s=FRAME_TIMEOUT_S)
        while gripper.state().moving and clock.now_s() < until_s:
            array.read(timeout_s=FRAME_TIMEOUT_S)
    finally:
        if context.requests.stop.is_set():
            context.stop_hand()
