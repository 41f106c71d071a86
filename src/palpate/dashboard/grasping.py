"""Grasping and opening the hand: the runner, with a view."""

from __future__ import annotations

from contextlib import suppress

from palpate.dashboard.messages import Grasped, GraspOrder, OpenHand
from palpate.dashboard.station import FRAME_TIMEOUT_S, Station
from palpate.errors import DeviceError
from palpate.estimate.damage_file import recorded_model
from palpate.grasp.belief import Belief, Observation
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.produce.ripeness.closing import ClosingWatch
from palpate.rig.recorded import open_grasp_recording

#: The object is held until its release is asked for, but not for longer than this: sheet, object
#: and servo suffer. Approach and squeeze have their own time.
HOLD_S, LONGEST_S = 60.0, 240.0
#: An opening hand is watched for so long.
_OPENING_S = 10.0


def grasp(order: GraspOrder, *, station: Station) -> Grasped:
    """Run one grasp; every frame of it is recorded."""
    rig, outlet = station.whole, station.outlet
    plan = plan_grasp(
        rig.calibration,
        gripper=rig.gripper,
        target_force_n=order.target_force_n,
        damage=recorded_model(order.damage),
        kind=order.kind,
        hold_s=HOLD_S,
        longest_s=LONGEST_S,
    )
    station.catch_up()
    order.recording.parent.mkdir(parents=True, exist_ok=True)
    with open_grasp_recording(
        order.recording,
        rig=rig,
        seed=station.seed,
        target_force_n=order.target_force_n,
        damage=order.damage,
        kind=order.kind,
    ) as writer:

        def recorder(observation: Observation) -> None:
            writer.add_observation(observation.frame, gripper=observation.gripper)

        def react(belief: Belief) -> None:
            # A hand that vents, or was opening already, is stopped only when it is open.
            if belief.phase is Phase.RELEASE and station.requests.stop.is_set():
                station.confirm_stop()

        closing = ClosingWatch(plan)
        outlet.think(plan)
        result = run_grasp(
            plan,
            array=station.array,
            gripper=rig.gripper,
            clock=rig.clock,
            subscribers=[recorder, outlet.observe],
            watchers=[outlet.believe, react, closing.see],
            requests=station.requests,
        )
        # Before the recording is closed: a slow disk must not delay the confirmation.
        if station.requests.stop.is_set():
            with suppress(DeviceError):
                station.stop_hand()
    truth = None if rig.truth is None else dict(rig.truth())
    return Grasped(
        result=result, truth=truth, recording=order.recording, closing=closing.measured()
    )


def open_hand(order: OpenHand, *, station: Station) -> None:
    """Open the hand and watch it arrive; a stop request stops it where it is."""
    gripper, clock, array = station.whole.gripper, station.rig.clock, station.watched()
    gripper.release()
    until_s = clock.now_s() + _OPENING_S
    try:
        array.read(timeout_s=FRAME_TIMEOUT_S)
        while gripper.state().moving and clock.now_s() < until_s:
            array.read(timeout_s=FRAME_TIMEOUT_S)
    finally:
        if station.requests.stop.is_set():
            station.stop_hand()
