"""The session: control, permitted orders, and the state of the devices."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packages.station.tests.dashboard.test_live import HOLDING, frames
from packages.station.tests.dashboard.test_live import SOURCE as UNCALIBRATED

from palpate.errors import InputError
from palpate.force.force_law import ForceLaw
from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate_station.dashboard.folder import Interruption
from palpate_station.dashboard.grasp_form import GraspForm, Unfinished
from palpate_station.dashboard.messages import (
    Action,
    Confirm,
    DeviceActivity,
    DevicesLost,
    Examine,
    Grasped,
    GraspOrder,
    Guide,
    LinkStatus,
    OpenHand,
    OpenRig,
    Order,
    OrderEnded,
    OrderStarted,
    Play,
    ReleaseNow,
    ReplayPosition,
    SetSpeed,
    StopNow,
    Update,
)
from palpate_station.dashboard.page_document import document
from palpate_station.dashboard.session import Session
from palpate_station.dashboard.users import Role
from palpate_station.dashboard.words import Words

SOURCE = replace(UNCALIBRATED, law=ForceLaw())
FRESH = LinkStatus(frames=10, rate_hz=15.0, age_s=0.02, stale=False)
GRASP = GraspOrder(target_force_n=2.0, recording=Path("new.mcap"))
HELD = Grasped(document=GraspDocument(result=GraspResult(outcome=Outcome.HELD)))


class Rehearsal:
    """A session that stores its orders and receives the notes of the test."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.grasps: list[tuple[Grasped, str]] = []
        self.silent_s = 0.5
        self.session = Session(
            send=self.sent.append,
            on_grasped=lambda grasped, order: self.grasps.append((grasped, order.item_id)),
            silent_s=lambda: self.silent_s,
        )

    def receive(self, *notes: Any, width_mm: float = 74.0, link: LinkStatus = FRESH) -> None:
        shown = replace(frames(1), reported=np.array([width_mm]))
        self.session.devices.apply_update(Update(notes=notes, link=link, frames=shown))

    def page(self) -> dict[str, Any]:
        return document(self.session, generation=-1, after_s=0.0)


@pytest.fixture
def rehearsal() -> Rehearsal:
    rehearsal = Rehearsal()
    rehearsal.session.join("a")
    rehearsal.session.join("b")
    rehearsal.session.order("a", OpenRig(name="sim-rigid"))
    rehearsal.receive(OrderStarted(order=OpenRig(name="sim-rigid")), SOURCE)
    rehearsal.receive(OrderEnded(order=OpenRig(name="sim-rigid")))
    rehearsal.sent.clear()
    return rehearsal


def test_session_accepts_orders_of_the_driver_only(rehearsal: Rehearsal) -> None:
    with pytest.raises(InputError, match="a page drives; take over first"):
        rehearsal.session.order("b", GRASP)
    rehearsal.session.take_over("b")
    with pytest.raises(InputError, match="take over first"):
        rehearsal.session.order("a", GRASP)
    rehearsal.session.leave("b")
    rehearsal.session.order("a", GRASP)
    assert (rehearsal.sent, rehearsal.session.driver) == ([GRASP], "a")


def test_who_acts_while_nobody_drives_becomes_the_driver_unless_refused() -> None:
    session = Rehearsal().session
    session.join("watcher", role=Role.VIEW)
    session.join("gateway", leased=True)
    session.join("page")
    assert session.driver is None, "an open page alone keeps nobody from driving"
    for viewer in ("gateway", "watcher"):
        # There is no rig yet.
        with pytest.raises(InputError):
            session.order(viewer, GRASP)
        assert session.driver is None
    assert not session.claim("watcher")
    assert session.claim("gateway")


def test_person_who_reopens_the_page_that_drove_keeps_control() -> None:
    session = Rehearsal().session
    session.join("old", tab="1", name="maria")
    session.claim("old")
    # A second page of the same person takes nothing from the first.
    assert not session.join("other", tab="2", name="maria")
    session.mark_away("old")
    assert not session.join("peter", tab="3", name="peter")
    assert session.join("new", tab="4", name="maria")
    session.leave("old")
    assert session.driver == "new"


def test_roles_limit_the_actions_of_a_driver(rehearsal: Rehearsal) -> None:
    session = rehearsal.session
    session.leave("a")
    session.leave("b")
    assert not session.join("screen", name="screen", role=Role.VIEW)
    session.take_over("screen")
    assert session.driver is None
    with pytest.raises(InputError, match="screen may only watch"):
        session.order("screen", GRASP)
    session.join("m", name="maria", role=Role.OPERATE)
    session.order("m", GRASP)
    rehearsal.receive(OrderEnded(order=GRASP))
    with pytest.raises(InputError, match="maria may not open a rig: it needs the role configure"):
        session.order("m", OpenRig(name="sim-rigid"))


def test_page_says_in_one_line_what_is_guarded_and_why_the_rig_is_not_ready(
    rehearsal: Rehearsal,
) -> None:
    limits = "force limit 15 N, checked 15 times/s"
    assert rehearsal.page()["guard"] == f"Ready · {limits}"
    rehearsal.session.form.kind = "kiwi"
    assert "force limit 15 N and that of kiwi, checked" in rehearsal.page()["guard"]
    rehearsal.session.form.kind = ""
    rehearsal.receive(width_mm=40.0)
    why = "the gripper is not open: release first"
    assert rehearsal.page()["guard"] == f"Not ready: {why} · {limits}"
    rehearsal.receive(link=LinkStatus(frames=9, age_s=2.0, stale=True))
    assert rehearsal.page()["guard"] == "Not ready: no fresh frames: check the link"
    rehearsal.receive(UNCALIBRATED)
    with pytest.raises(InputError, match="has no calibration"):
        rehearsal.session.order("a", GRASP)
    assert rehearsal.page()["guard"] == (
        "Not ready: the sensor has no calibration of rest and force: calibrate first"
    )
    rehearsal.receive(replace(UNCALIBRATED, gripper=None))
    assert rehearsal.page()["guard"] == "No gripper: no force is limited"


def test_session_stop_is_sent_for_any_viewer_during_any_activity(rehearsal: Rehearsal) -> None:
    rehearsal.session.order("a", GRASP)
    assert [rehearsal.session.stop(), rehearsal.session.stop()] == [1, 2]
    assert rehearsal.sent == [GRASP, StopNow(1), StopNow(2)]


RIG, PLAY = OpenRig(name="sim-rigid"), Play(file=Path("old.mcap"))


@pytest.mark.parametrize(
    ("why", "orders"),
    [
        *(
            (
                "^the speed must be from 0.1 to 20$",
                (SetSpeed(bad), replace(PLAY, speed=bad), replace(RIG, speed=bad)),
            )
            for bad in (0, -1.0, 1e300, math.nan, None, "fast", [])
        ),
        *(
            ("^the seed must be an integer", (replace(RIG, seed=bad),))
            for bad in (-1, 2**32, 0.5, math.nan, "7")
        ),
    ],
)
def test_session_refuses_a_speed_or_seed_out_of_range(
    rehearsal: Rehearsal, why: str, orders: tuple[Any, ...]
) -> None:
    session = rehearsal.session
    for order in orders:
        press = session.request if isinstance(order, SetSpeed) else session.order
        with pytest.raises(InputError, match=why):
            press("a", order)
    assert rehearsal.sent == []
    assert session.devices.activity is DeviceActivity.WATCHING
    assert session.rig == RIG


@pytest.mark.parametrize(
    ("received", "order", "why"),
    [
        ({"width_mm": 40.0}, GRASP, "the gripper is not open: release first"),
        ({"width_mm": 40.0}, Examine(), "the gripper is not open: release first"),
        ({"link": LinkStatus(stale=True)}, GRASP, "no fresh frames"),
        ({"link": LinkStatus(stale=True)}, OpenHand(), ""),
        ({"link": LinkStatus(frames=9, age_s=1.2, stale=True)}, Examine(), "no fresh frames"),
        ({"link": LinkStatus(frames=9, age_s=0.3, stale=True)}, Examine(), ""),
    ],
)
def test_session_refuses_orders_that_a_closed_hand_or_a_stale_link_forbids(
    rehearsal: Rehearsal, received: dict[str, Any], order: Order, why: str
) -> None:
    rehearsal.receive(**received)
    if why:
        with pytest.raises(InputError, match=why):
            rehearsal.session.order("a", order)
    else:
        rehearsal.session.order("a", order)
    assert rehearsal.sent == ([] if why else [order])


def test_session_refuses_every_order_of_silent_or_ended_devices(rehearsal: Rehearsal) -> None:
    session = rehearsal.session
    assert not session.refusal(Action.OPEN, viewer="a")
    rehearsal.silent_s = 1.5
    assert "the devices do not respond" in session.refusal(Action.OPEN, viewer="a")
    session.devices.grasped = HELD
    session.devices.apply_update(DevicesLost("the device process has ended"))
    for action in Action:
        assert "device process has ended" in session.refusal(action, viewer="a")
    card = rehearsal.page()["verdict"]
    assert (card["text"], card["kind"]) == ("the device process has ended", "bad")
    assert session.devices.live.link.stale


def test_countdown_and_readiness_are_not_shown_of_silent_devices(rehearsal: Rehearsal) -> None:
    assert rehearsal.page()["ready"]
    devices = rehearsal.session.devices
    devices.live.set_progress(HOLDING)
    devices.activity, devices.is_answered = DeviceActivity.GRASPING, True
    assert rehearsal.page()["operator"]["opens"]
    rehearsal.silent_s = 1.5
    page = rehearsal.page()
    assert (page["operator"]["opens"], page["ready"]) == ("", False)


def test_session_release_is_a_request_during_a_grasp_and_otherwise_an_order(
    rehearsal: Rehearsal,
) -> None:
    rehearsal.session.release("a")
    assert rehearsal.sent == [OpenHand()]
    rehearsal.receive(OrderEnded(order=OpenHand()))
    rehearsal.session.order("a", GRASP)
    rehearsal.session.release("a")
    assert rehearsal.sent[-1] == ReleaseNow()


def test_session_reports_finished_grasps_with_their_item_but_no_replays(
    rehearsal: Rehearsal,
) -> None:
    devices, named = rehearsal.session.devices, replace(GRASP, item_id="berry-7")
    for order in (GRASP, named):
        rehearsal.session.order("a", order)
        generation = devices.live.generation
        rehearsal.receive(OrderStarted(order=order))
        assert devices.live.generation > generation, "the curve restarts"
        assert devices.grasped is None
        rehearsal.receive(OrderEnded(order=order, found=HELD))
        assert devices.grasped == HELD
    assert rehearsal.grasps == [(HELD, ""), (HELD, "berry-7")]
    rehearsal.session.order("a", PLAY)
    at_end = ReplayPosition(time_s=9.0, paused=True, speed=1.0, grasped=HELD)
    rehearsal.receive(OrderStarted(order=PLAY), replace(SOURCE, replayed=True), at_end)
    assert devices.grasped == HELD
    rehearsal.receive(OrderEnded(order=PLAY))
    assert devices.grasped is None
    assert len(rehearsal.grasps) == 2


def test_session_confirm_is_refused_without_a_step_to_confirm(rehearsal: Rehearsal) -> None:
    with pytest.raises(InputError, match="no step to confirm"):
        rehearsal.session.request("a", Confirm())
    rehearsal.receive(Guide(text="Place 2 N on the pad", needs_confirmation=True))
    with pytest.raises(InputError, match="take over"):
        rehearsal.session.request("b", Confirm())
    rehearsal.session.request("a", Confirm())
    assert rehearsal.sent == [Confirm()]


@pytest.mark.parametrize("began", [False, True])
def test_session_grasp_stopped_before_its_start_replaces_the_last_result(
    rehearsal: Rehearsal, *, began: bool
) -> None:
    rehearsal.session.devices.grasped = HELD
    rehearsal.session.order("a", GRASP)
    if began:
        rehearsal.receive(OrderStarted(order=GRASP))
    rehearsal.receive(OrderEnded(order=GRASP, trouble="stopped before it started", stopped=True))
    page = rehearsal.page()
    assert (page["verdict"]["text"], page["verdict"]["kind"]) == ("stopped, gripper open", "idle")
    assert page["operator"]["word"] == "Stopped, gripper open"
    assert page["operator"]["next"] == "Put the next item in, then press Grasp"
    assert not page["trouble"]
    assert not rehearsal.session.refusal(Action.GRASP, viewer="a")
    rehearsal.receive(OrderStarted(order=GRASP), OrderEnded(order=GRASP, trouble="no such file"))
    page = rehearsal.page()
    assert (page["operator"]["word"], page["trouble"]) == ("Ready", "no such file")


def make_order(item_id: str = "W1") -> GraspOrder:
    return replace(GRASP, item_id=item_id)


@pytest.mark.parametrize(
    ("ordered", "scanned", "names"),
    [
        # The name returns until the bin is final.
        ("W1", "", ("W1", "W1", "")),
        # A name scanned since the grasp is retained.
        ("W1", "W2", ("W2", "W2", "W2")),
        # Nothing returns from the grasp of another client.
        ("X9", "", ("", "", "")),
    ],
)
def test_name_of_an_item_returns_after_a_grasp_until_its_bin_is_final(
    ordered: str, scanned: str, names: tuple[str, ...]
) -> None:
    form = GraspForm(item_id="W1")
    form.take_item(make_order())
    assert form.item_id == ""
    form.set_item(scanned)
    for why, name in zip((*[Unfinished.PROVISIONAL] * 2, None), names, strict=True):
        form.return_item(make_order(ordered), why=why)
        assert form.item_id == name


WORDS = Words()


def scan(form: GraspForm, text: str) -> str:
    """Scan a text letter by letter; return why it is not taken."""
    for end in range(1, len(text) + 1):
        form.set_item(text[:end])
    return form.end_scan(WORDS)


@pytest.mark.parametrize("why", list(Unfinished))
@pytest.mark.parametrize("ahead", [False, True])
def test_no_grasp_takes_another_name_than_an_unfinished_item_s_before_its_second_scan(
    rehearsal: Rehearsal, why: Unfinished, *, ahead: bool
) -> None:
    session = rehearsal.session
    form = session.form = GraspForm(item_id="W1")
    form.take_item(make_order("W1"))
    if ahead:
        # Before the answer nothing forbids the next name.
        assert not scan(form, "W2")
    form.return_item(make_order("W1"), why=why)
    assert (form.item_id, form.is_returned) == (("W2", False) if ahead else ("W1", True))
    for _ in range(2):
        refused = scan(form, "W2")
        assert "W1 is not" in refused
        # The name stays in the field, and a doubled Enter is no second scan.
        assert (form.item_id, form.end_scan(WORDS)) == ("W2", refused)
        page = rehearsal.page()
        assert (session.name_fault, page["operator"]["next"]) == (refused, refused)
        # The scan of the unfinished item ends the doubt.
        assert not scan(form, "W1")
        assert session.name_fault == ""
        form.return_item(make_order("W1"), why=why)
    assert "W1 is not" in scan(form, "W2")
    assert not scan(form, "W2")
    assert (form.item_id, session.name_fault) == ("W2", "")
    # The release repeats what the user has overruled.
    form.return_item(make_order("W1"), why=why)
    assert (form.item_id, session.name_fault) == ("W2", "")


def test_second_scan_before_the_grasp_asks_which_item_is_in_the_gripper(
    rehearsal: Rehearsal,
) -> None:
    session, form = rehearsal.session, rehearsal.session.form
    for name in ("B1", "B2"):
        assert not scan(form, "B1")
        asked = scan(form, "B2")
        assert "B1 was scanned before B2" in asked
        assert session.name_fault == asked
        assert not scan(form, name)
        assert session.name_fault == ""
        form.set_item("")


def test_item_of_an_interrupted_grasp_is_expected_before_another(rehearsal: Rehearsal) -> None:
    session = rehearsal.session
    session.devices.interrupted = Interruption(
        item_id="K1", recording="k.mcap", began_at="2026-05-01T10:00:00+00:00"
    )
    session.form.await_item("K1", why=Unfinished.NOT_MEASURED)
    assert rehearsal.page()["operator"]["next"] == "Scan K1 again, put it in, then press Grasp"
    assert "K1 is not measured" in scan(session.form, "K2")
    assert not scan(session.form, "K1")
    assert rehearsal.page()["operator"]["next"] == "Put the item in again, then press Grasp"
    # Another client finishes it.
    session.form.return_item(make_order("K1"), why=None)
    assert not scan(session.form, "K2")


@pytest.mark.parametrize(
    ("scanned", "step"),
    [
        ("4012345000016", "This is the product's barcode"),
        ("(01)04012345000016(10)L7", "This is the product's barcode"),
        ("https://example.com/q?id=7", "This is the address of a web page"),
        ("4012345000017", "Scan the label again"),
    ],
)
def test_label_that_names_no_item_is_refused_with_what_to_do_instead(
    rehearsal: Rehearsal, scanned: str, step: str
) -> None:
    scan(rehearsal.session.form, scanned)
    assert rehearsal.page()["operator"]["next"].startswith(step)


def test_clear_ends_an_unfinished_item() -> None:
    form = GraspForm(item_id="W1")
    form.take_item(make_order("W1"))
    form.return_item(make_order("W1"), why=Unfinished.PROVISIONAL)
    form.set_item("")
    assert not scan(form, "W2")


def test_sorted_item_is_measured_again_only_after_a_second_scan() -> None:
    bins = {"W1": ("large, firm", "13:30"), "W2": ("small", "13:31")}
    form = GraspForm(find_sorted=bins.get)
    asked = scan(form, "W1")
    assert "W1 was already sorted: large, firm (13:30)" in asked
    assert form.end_scan(WORDS) == asked
    # Another name in between is a question of its own.
    assert scan(form, "W2")
    assert scan(form, "W1") == asked
    assert not scan(form, "W1")
    form.take_item(make_order("W1"))
    assert scan(form, "W1") == asked
    form.set_item("")
    form.repeat_item()
    assert not form.end_scan(WORDS)


def test_order_beyond_a_role_is_reported_with_its_viewer() -> None:
    refused: list[tuple[str, str]] = []
    session = Session(send=print, on_refused=lambda who, what: refused.append((who, what)))
    for name, role in (("maria", Role.OPERATE), ("screen", Role.VIEW)):
        session.join(name, name=name, role=role)
        with pytest.raises(InputError):
            session.order(name, OpenRig(name="sim-rigid"))
    assert refused == [
        ("maria", "open a rig, role operate"),
        ("screen", "open a rig, role view"),
    ]
