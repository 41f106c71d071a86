"""The session: control, permitted orders, and the state of the devices."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.dashboard.messages import (
    Action,
    CalibrateForce,
    CalibrationRenewed,
    Confirm,
    DeviceActivity,
    DevicesLost,
    Examine,
    Frames,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
    LinkStatus,
    OpenHand,
    OpenRig,
    OrderEnded,
    OrderStarted,
    Play,
    ReleaseNow,
    ReplayPosition,
    Seek,
    SetSpeed,
    StopNow,
    Update,
)
from palpate.dashboard.page_document import document
from palpate.dashboard.session import GraspForm, Session
from palpate.errors import InputError
from palpate.grasp.result import GraspResult, Outcome
from palpate.gripper.interface import GripperLimits
from palpate.sensor.array import RIGID_LAYOUT

LIMITS = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
FRESH = LinkStatus(frames=10, rate_hz=15.0, age_s=0.02, stale=False)
GRASP = GraspOrder(target_force_n=2.0, recording=Path("new.mcap"))


CALIBRATED = CalibrationRenewed(
    file=Path("pad.json"), rest_ohm=np.ones((4, 2)), change_percent=np.zeros((4, 2))
)


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


class Rehearsal:
    """A session that stores its orders and receives the notes of the test."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.grasps: list[tuple[Grasped, str]] = []
        self.session = Session(
            send=self.sent.append,
            on_grasped=lambda grasped, order: self.grasps.append((grasped, order.item_id)),
        )

    def receive(self, *notes: Any, width_mm: float = 74.0, link: LinkStatus = FRESH) -> None:
        self.session.devices.apply_update(Update(notes=notes, link=link, frames=frames(width_mm)))


@pytest.fixture
def rehearsal() -> Rehearsal:
    rehearsal = Rehearsal()
    rehearsal.session.join("a")
    rehearsal.session.join("b")
    rehearsal.session.order("a", OpenRig(name="sim-rigid"))
    rehearsal.receive(OrderStarted(order=OpenRig(name="sim-rigid")), source())
    rehearsal.receive(OrderEnded(order=OpenRig(name="sim-rigid")))
    rehearsal.sent.clear()
    return rehearsal


def test_session_accepts_orders_of_the_driver_only(rehearsal: Rehearsal) -> None:
    with pytest.raises(InputError, match="another user is the driver; take over first"):
        rehearsal.session.order("b", GRASP)
    rehearsal.session.take_over("b")
    with pytest.raises(InputError, match="take over first"):
        rehearsal.session.order("a", GRASP)
    rehearsal.session.leave("b")
    with pytest.raises(InputError, match="there is no driver; take over first"):
        rehearsal.session.order("a", GRASP)
    rehearsal.session.take_over("a")
    rehearsal.session.order("a", GRASP)
    assert rehearsal.sent == [GRASP]


def test_session_counts_a_reloaded_page_as_one_viewer(rehearsal: Rehearsal) -> None:
    session = rehearsal.session
    session.join("before", tab="1")
    session.join("after", tab="1")
    assert session.viewers & {"before", "after"} == {"after"}
    session.leave("before")
    assert "after" in session.viewers


def test_session_stop_is_sent_for_any_viewer_during_any_activity(rehearsal: Rehearsal) -> None:
    rehearsal.session.order("a", GRASP)
    assert [rehearsal.session.stop(), rehearsal.session.stop()] == [1, 2]
    assert rehearsal.sent == [GRASP, StopNow(1), StopNow(2)]


def test_session_refuses_a_second_order_before_the_first_is_reported(rehearsal: Rehearsal) -> None:
    rehearsal.session.order("a", GRASP)
    with pytest.raises(InputError, match="grasping: wait, or press stop"):
        rehearsal.session.order("a", GRASP)
    assert rehearsal.sent == [GRASP]


@pytest.mark.parametrize("speed", [0, -1.0, 1e300, math.nan, None, "fast", []])
def test_session_refuses_a_speed_out_of_range(rehearsal: Rehearsal, speed: Any) -> None:
    session = rehearsal.session
    for press in (
        lambda: session.request("a", SetSpeed(speed)),
        lambda: session.order("a", Play(file=Path("old.mcap"), speed=speed)),
        lambda: session.order("a", OpenRig(name="sim-rigid", speed=speed)),
    ):
        with pytest.raises(InputError, match=r"^the speed must be from 0.1 to 20$"):
            press()
    assert rehearsal.sent == []
    assert session.devices.activity is DeviceActivity.WATCHING
    assert session.rig == OpenRig(name="sim-rigid")


@pytest.mark.parametrize("seed", [-1, 2**32, 0.5, math.nan, "7"])
def test_session_refuses_a_seed_out_of_range(rehearsal: Rehearsal, seed: Any) -> None:
    with pytest.raises(InputError, match=r"^the seed must be an integer"):
        rehearsal.session.order("a", OpenRig(name="sim-rigid", seed=seed))
    assert rehearsal.sent == []


@pytest.mark.parametrize("time_s", [math.nan, math.inf, "late"])
def test_session_refuses_a_seek_to_a_non_finite_time(rehearsal: Rehearsal, time_s: Any) -> None:
    rehearsal.session.order("a", Play(file=Path("old.mcap")))
    rehearsal.sent.clear()
    with pytest.raises(InputError, match="this time is not"):
        rehearsal.session.request("a", Seek(time_s))
    assert rehearsal.sent == []
    rehearsal.session.request("a", Seek(1e9))
    assert rehearsal.sent == [Seek(1e9)]


def test_session_release_is_a_request_during_a_grasp_and_otherwise_an_order(
    rehearsal: Rehearsal,
) -> None:
    rehearsal.session.release("a")
    assert rehearsal.sent == [OpenHand()]
    rehearsal.receive(OrderEnded(order=OpenHand()))
    rehearsal.session.order("a", GRASP)
    rehearsal.session.release("a")
    assert rehearsal.sent[-1] == ReleaseNow()


def test_session_with_a_closed_hand_refuses_grasp_and_examination(rehearsal: Rehearsal) -> None:
    rehearsal.receive(width_mm=40.0)
    for order in (GRASP, Examine()):
        with pytest.raises(InputError, match="the hand is not open: release first"):
            rehearsal.session.order("a", order)


def test_session_with_a_stale_link_refuses_a_grasp_and_allows_release(rehearsal: Rehearsal) -> None:
    rehearsal.receive(link=LinkStatus(stale=True))
    with pytest.raises(InputError, match="no fresh frames"):
        rehearsal.session.order("a", GRASP)
    rehearsal.session.release("a")
    assert rehearsal.sent == [OpenHand()]


def test_session_with_a_briefly_stale_link_allows_orders(rehearsal: Rehearsal) -> None:
    rehearsal.receive(link=LinkStatus(frames=9, age_s=1.2, stale=True))
    with pytest.raises(InputError, match="no fresh frames"):
        rehearsal.session.order("a", Examine())
    rehearsal.receive(link=LinkStatus(frames=9, age_s=0.3, stale=True))
    rehearsal.session.order("a", Examine())
    assert rehearsal.sent == [Examine()]


def test_session_after_a_failed_order_watches_the_rig_and_shows_the_reason(
    rehearsal: Rehearsal,
) -> None:
    rehearsal.session.order("a", GRASP)
    rehearsal.receive(OrderEnded(order=GRASP, trouble="no pairs read 0.42 s after a movement"))
    assert rehearsal.session.devices.activity is DeviceActivity.WATCHING
    assert rehearsal.session.devices.trouble == "no pairs read 0.42 s after a movement"


def test_session_after_a_rig_fails_to_open_has_no_open_rig(rehearsal: Rehearsal) -> None:
    order = OpenRig(name="lost.toml")
    rehearsal.session.order("a", order)
    rehearsal.receive(OrderStarted(order=order), OrderEnded(order=order, trouble="no such port"))
    assert rehearsal.session.devices.activity is DeviceActivity.IDLE
    assert "no rig is open" in rehearsal.session.refusal(Action.GRASP, viewer="a")
    assert not rehearsal.session.refusal(Action.OPEN, viewer="a")


def test_session_reports_finished_grasps_with_their_item_but_no_replays(
    rehearsal: Rehearsal,
) -> None:
    held = Grasped(result=GraspResult(outcome=Outcome.HELD))
    rehearsal.receive(OrderStarted(order=GRASP), OrderEnded(order=GRASP, found=held))
    assert (rehearsal.session.devices.grasped, rehearsal.grasps) == (held, [(held, "")])
    named = replace(GRASP, item_id="berry-7")
    rehearsal.session.order("a", named)
    rehearsal.receive(OrderStarted(order=named), OrderEnded(order=named, found=held))
    assert rehearsal.grasps == [(held, ""), (held, "berry-7")]
    play = Play(file=Path("old.mcap"))
    rehearsal.session.order("a", play)
    at_end = ReplayPosition(time_s=9.0, paused=True, speed=1.0, grasped=held)
    rehearsal.receive(OrderStarted(order=play), source(replayed=True), at_end)
    assert rehearsal.session.devices.grasped == held
    rehearsal.receive(OrderEnded(order=play))
    assert rehearsal.session.devices.grasped is None
    assert len(rehearsal.grasps) == 2


def test_session_confirm_is_refused_without_a_step_to_confirm(rehearsal: Rehearsal) -> None:
    with pytest.raises(InputError, match="no step to confirm"):
        rehearsal.session.request("a", Confirm())
    rehearsal.receive(Guide(text="Place 2 N on the pad", needs_confirmation=True))
    with pytest.raises(InputError, match="take over"):
        rehearsal.session.request("b", Confirm())
    rehearsal.session.request("a", Confirm())
    assert rehearsal.sent == [Confirm()]


def test_session_start_of_a_grasp_clears_curve_and_result(rehearsal: Rehearsal) -> None:
    generation = rehearsal.session.devices.live.generation
    rehearsal.session.devices.grasped = Grasped(result=GraspResult(outcome=Outcome.HELD))
    rehearsal.receive(OrderStarted(order=GRASP))
    assert rehearsal.session.devices.live.generation > generation
    assert rehearsal.session.devices.grasped is None


@pytest.mark.parametrize("began", [False, True])
def test_session_grasp_stopped_before_its_start_replaces_the_last_result(
    rehearsal: Rehearsal, *, began: bool
) -> None:
    devices = rehearsal.session.devices
    devices.grasped = Grasped(result=GraspResult(outcome=Outcome.HELD))
    rehearsal.session.order("a", GRASP)
    if began:
        rehearsal.receive(OrderStarted(order=GRASP))
    rehearsal.receive(OrderEnded(order=GRASP, trouble="stopped before it started", stopped=True))
    page = document(rehearsal.session, generation=-1, after_s=0.0)
    assert (page["verdict"]["text"], page["verdict"]["kind"]) == ("stopped, hand open", "idle")
    assert page["operator"]["word"] == "Stopped, hand open"
    assert page["operator"]["next"] == "Put the next item in, then press Grasp"
    assert not page["trouble"]
    assert not rehearsal.session.refusal(Action.GRASP, viewer="a")
    rehearsal.receive(OrderStarted(order=GRASP), OrderEnded(order=GRASP, trouble="no such file"))
    page = document(rehearsal.session, generation=-1, after_s=0.0)
    assert (page["operator"]["word"], page["trouble"]) == ("Ready", "no such file")


def test_session_refuses_orders_while_the_device_process_is_silent() -> None:
    silent_s = [0.5]
    session = Session(send=print, silent_s=lambda: silent_s[0])
    session.join("a")
    assert not session.refusal(Action.OPEN, viewer="a")
    silent_s[0] = 1.5
    assert "the devices do not respond" in session.refusal(Action.OPEN, viewer="a")


def test_session_refuses_every_action_after_the_end_of_the_device_process(
    rehearsal: Rehearsal,
) -> None:
    rehearsal.session.devices.apply_update(DevicesLost("the device process has ended"))
    for action in Action:
        assert "device process has ended" in rehearsal.session.refusal(action, viewer="a")
    assert rehearsal.session.devices.trouble == "the device process has ended"
    assert rehearsal.session.devices.live.link.stale


def test_session_keeps_a_calibration_failure_with_its_step_until_the_next_order(
    rehearsal: Rehearsal,
) -> None:
    order = CalibrateForce(file=Path("pad.json"), loads_n=(1.0, 2.0))
    rehearsal.receive(
        OrderStarted(order=order), Guide(text="Place 2 N on the pad", needs_confirmation=True)
    )
    rehearsal.receive(OrderEnded(order=order, trouble="stopped on request", stopped=True))
    failure = rehearsal.session.devices.calibration_failure
    assert (failure.stopped, failure.step) == (True, "Place 2 N on the pad")
    assert rehearsal.session.devices.trouble == ""
    rehearsal.receive(OrderStarted(order=order))
    assert rehearsal.session.devices.calibration_failure is None
    rehearsal.receive(OrderEnded(order=order, trouble="no frame in 2 s"))
    failure = rehearsal.session.devices.calibration_failure
    assert (failure.stopped, failure.step, failure.reason) == (False, "", "no frame in 2 s")
    rehearsal.receive(OrderStarted(order=order))
    rehearsal.receive(OrderEnded(order=order, found=CALIBRATED))
    assert rehearsal.session.devices.calibration_failure is None
    assert rehearsal.session.devices.calibrated is CALIBRATED


def make_order(item_id: str = "W1") -> GraspOrder:
    return GraspOrder(target_force_n=None, recording=Path("grasp.mcap"), item_id=item_id)


def test_name_returns_until_the_bin_is_final() -> None:
    form, order = GraspForm(item_id="W1"), make_order()
    form.take_item(order)
    assert form.item_id == ""
    for again, name in ((True, "W1"), (True, "W1"), (False, "")):
        form.return_item(order, again=again)
        assert form.item_id == name


def test_name_scanned_during_a_grasp_is_retained() -> None:
    for again in (True, False):
        form, order = GraspForm(item_id="W1"), make_order()
        form.take_item(order)
        form.return_item(order, again=True)
        form.set_item("W2")
        form.return_item(order, again=again)
        assert form.item_id == "W2"


def test_name_of_another_clients_grasp_is_not_returned() -> None:
    form = GraspForm(item_id="W1")
    form.take_item(make_order())
    form.return_item(make_order("X9"), again=True)
    assert form.item_id == ""
