"""The rules of the page: who drives, what may be pressed when, what is shown after."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.dashboard.messages import (
    Began,
    Confirm,
    Ended,
    Examine,
    Frames,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
    Lost,
    OpenHand,
    OpenRig,
    Play,
    Pulse,
    Record,
    ReleaseNow,
    StopNow,
    Stopped,
    Update,
)
from palpate.dashboard.session import Action, Activity, Session
from palpate.errors import InputError
from palpate.grasp.result import GraspResult, Outcome
from palpate.gripper.interface import GripperLimits
from palpate.sensor.array import RIGID_LAYOUT

LIMITS = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
FRESH = Pulse(frames=10, rate_hz=15.0, age_s=0.02, stale=False)
GRASP = GraspOrder(target_force_n=2.0, recording=Path("new.mcap"))


def source(*, replayed: bool = False) -> FrameSource:
    return FrameSource(
        name="sim-rigid",
        layout=RIGID_LAYOUT,
        rest_ohm=np.full((4, 2), 9000.0),
        gripper=LIMITS,
        origin="twin",
        replayed=replayed,
    )


def frames(width_mm: float) -> Frames:
    return Frames(
        time_s=np.array([1.0]),
        counts=np.full((1, 4, 2), 300, dtype=np.int32),
        oversampling=1,
        reported=np.array([width_mm]),
        moving=np.array([False]),
    )


class Desk:
    """A session whose orders are kept, and whose devices say what the test lets them."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.kept: list[tuple[Grasped, str]] = []
        self.session = Session(
            send=self.sent.append,
            on_grasped=lambda grasped, order: self.kept.append((grasped, order.item_id)),
        )

    def tell(self, *notes: Any, width_mm: float = 74.0, pulse: Pulse = FRESH) -> None:
        self.session.take(Update(notes=notes, pulse=pulse, frames=frames(width_mm)))


@pytest.fixture
def desk() -> Desk:
    desk = Desk()
    desk.session.join("a")
    desk.session.join("b")
    desk.session.order("a", OpenRig(name="sim-rigid"))
    desk.tell(Began(order=OpenRig(name="sim-rigid")), source())
    desk.tell(Ended(order=OpenRig(name="sim-rigid")))
    desk.sent.clear()
    return desk


def test_only_the_driver_orders_and_another_must_take_over(desk: Desk) -> None:
    with pytest.raises(InputError, match="someone else drives: take over first"):
        desk.session.order("b", GRASP)
    desk.session.take_over("b")
    with pytest.raises(InputError, match="take over first"):
        desk.session.order("a", GRASP)
    desk.session.order("b", GRASP)
    assert desk.sent == [GRASP]


def test_a_driver_who_leaves_leaves_nobody_driving_until_someone_takes_over(desk: Desk) -> None:
    desk.session.leave("a")
    assert desk.session.driver is None
    with pytest.raises(InputError, match="nobody drives: take over first"):
        desk.session.order("b", GRASP)
    desk.session.take_over("b")
    desk.session.order("b", GRASP)


def test_stop_is_anyones_at_any_time(desk: Desk) -> None:
    desk.session.order("a", GRASP)
    assert [desk.session.stop(), desk.session.stop()] == [1, 2]
    assert desk.sent == [GRASP, StopNow(1), StopNow(2)]


def test_a_stop_is_confirmed_only_by_the_devices(desk: Desk) -> None:
    number = desk.session.stop()
    assert desk.session.stops_confirmed < number
    desk.tell(Stopped(number))
    assert desk.session.stops_confirmed == number
    desk.tell(Stopped(number - 1))
    assert desk.session.stops_confirmed == number


def test_a_second_press_does_not_order_twice(desk: Desk) -> None:
    desk.session.order("a", GRASP)
    with pytest.raises(InputError, match="grasping: wait, or press stop"):
        desk.session.order("a", GRASP)
    assert desk.sent == [GRASP]


def test_release_is_heard_by_the_running_grasp_and_is_an_order_otherwise(desk: Desk) -> None:
    desk.session.release("a")
    assert desk.sent == [OpenHand()]
    desk.tell(Ended(order=OpenHand()))
    desk.session.order("a", GRASP)
    desk.session.release("a")
    assert desk.sent[-1] == ReleaseNow()


def test_a_closed_hand_neither_grasps_nor_is_examined(desk: Desk) -> None:
    desk.tell(width_mm=40.0)
    for order in (GRASP, Examine()):
        with pytest.raises(InputError, match="the hand is not open: release first"):
            desk.session.order("a", order)


def test_a_stale_sensor_does_not_grasp_but_the_hand_still_opens(desk: Desk) -> None:
    desk.tell(pulse=Pulse(stale=True))
    with pytest.raises(InputError, match="no fresh frames"):
        desk.session.order("a", GRASP)
    desk.session.release("a")
    assert desk.sent == [OpenHand()]


def test_nothing_is_grasped_before_a_rig_is_open() -> None:
    desk = Desk()
    desk.session.join("a")
    with pytest.raises(InputError, match="no rig is open"):
        desk.session.order("a", GRASP)


def test_an_order_that_failed_leaves_the_rig_watched_and_says_why(desk: Desk) -> None:
    desk.session.order("a", GRASP)
    desk.tell(Ended(order=GRASP, trouble="no pairs read 0.42 s after a movement"))
    assert desk.session.activity is Activity.WATCHING
    assert desk.session.trouble == "no pairs read 0.42 s after a movement"


def test_a_rig_that_does_not_open_leaves_none(desk: Desk) -> None:
    order = OpenRig(name="lost.toml")
    desk.session.order("a", order)
    desk.tell(Began(order=order), Ended(order=order, trouble="no such port"))
    assert desk.session.activity is Activity.IDLE
    assert "no rig is open" in desk.session.refusal(Action.GRASP, viewer="a")
    assert not desk.session.refusal(Action.OPEN, viewer="a")


def test_a_grasp_is_kept_with_its_name_and_a_replay_is_not(desk: Desk) -> None:
    held = Grasped(result=GraspResult(outcome=Outcome.HELD))
    desk.tell(Began(order=GRASP), Ended(order=GRASP, found=held))
    assert (desk.session.grasped, desk.kept) == (held, [(held, "")])
    named = replace(GRASP, item_id="berry-7")
    desk.session.order("a", named)
    desk.tell(Began(order=named), Ended(order=named, found=held))
    assert desk.kept == [(held, ""), (held, "berry-7")]
    play = Play(file=Path("old.mcap"))
    desk.session.order("a", play)
    desk.tell(Began(order=play), source(replayed=True), held)
    assert desk.session.grasped == held
    desk.tell(Ended(order=play))
    assert desk.session.grasped is None
    assert len(desk.kept) == 2


def test_only_what_is_asked_can_be_confirmed(desk: Desk) -> None:
    with pytest.raises(InputError, match="nothing is asked"):
        desk.session.confirm("a")
    desk.tell(Guide(text="Lay 2 N on the pad", asks=True))
    with pytest.raises(InputError, match="take over"):
        desk.session.confirm("b")
    desk.session.confirm("a")
    assert desk.sent == [Confirm()]


def test_recording_goes_on_beside_watching(desk: Desk) -> None:
    desk.session.order("a", Record(Path("watched.mcap")))
    assert desk.session.activity is Activity.WATCHING


def test_a_new_grasp_begins_a_new_curve_and_forgets_the_last_verdict(desk: Desk) -> None:
    generation = desk.session.live.generation
    desk.session.grasped = Grasped(result=GraspResult(outcome=Outcome.HELD))
    desk.tell(Began(order=GRASP))
    assert desk.session.live.generation > generation
    assert desk.session.grasped is None


def test_devices_that_are_silent_get_no_orders_that_they_would_carry_out_later() -> None:
    silent_s = [0.5]
    session = Session(send=print, silent_s=lambda: silent_s[0])
    session.join("a")
    assert not session.refusal(Action.OPEN, viewer="a")
    silent_s[0] = 1.5
    assert "the devices are silent" in session.refusal(Action.OPEN, viewer="a")


def test_devices_that_are_gone_refuse_everything(desk: Desk) -> None:
    desk.session.take(Lost("the process with the devices has ended"))
    for action in Action:
        assert "gone" in desk.session.refusal(action, viewer="a")
    assert desk.session.trouble == "the process with the devices has ended"
    assert desk.session.live.pulse.stale
