"""The data of the page's plots, the page document and the headline."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.grasp.document import Bin, GraspDocument
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.gripper.interface import GripperLimits
from palpate.measurement import Measurement
from palpate.object.compliance import Compliance
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.sample import pixel_resistance_ohm
from palpate_station.dashboard.grasp_progress import GraspProgress
from palpate_station.dashboard.live import CURVE_S, POINTS_PER_S, Live, Point
from palpate_station.dashboard.messages import (
    Action,
    DeviceActivity,
    Frames,
    FrameSource,
    Grasped,
    LinkStatus,
    Update,
)
from palpate_station.dashboard.page_document import document
from palpate_station.dashboard.session import Session

LIMITS = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
REST = np.full((4, 2), 300, dtype=np.int32)
SOURCE = FrameSource(
    name="sim-rigid",
    layout=RIGID_LAYOUT,
    rest_ohm=pixel_resistance_ohm(REST, layout=RIGID_LAYOUT),
    gripper=LIMITS,
    origin="twin",
)


def frames(count: int, *, from_s: float = 0.0, rate_hz: float = 500.0, counts: int = 300) -> Frames:
    return Frames(
        time_s=from_s + np.arange(count) / rate_hz,
        counts=np.full((count, 4, 2), counts, dtype=np.int32),
        oversampling=1,
        reported=np.full(count, 74.0),
        moving=np.zeros(count, dtype=bool),
    )


@pytest.fixture
def live(session: Session) -> Live:
    return session.devices.live


def page_of(session: Session, *, generation: int = -1, after_s: float = 0.0) -> dict[str, Any]:
    return document(session, generation=generation, after_s=after_s)


def progress(time_s: float, half: float) -> GraspProgress:
    settled = Measurement(value=-40.0, low=-40.0 - half, high=-40.0 + half, unit="percent")
    return GraspProgress(
        time_s=time_s,
        phase="settle",
        rest_ohm=None,
        began_s=0.0,
        force_n=1.0,
        settled=settled,
        answer=GraspResult(outcome=Outcome.STOPPED),
        decided=False,
    )


HOLDING = replace(progress(9.0, 1.0), phase="hold", decided=True)


def test_live_curve_is_bounded_and_retains_a_finished_grasp_until_the_next(live: Live) -> None:
    for second in range(int(CURVE_S) + 60):
        live.add_frames(frames(500, from_s=float(second)))
        if second == 40:
            live.finish_grasp(())
    assert len(live.curve) == POINTS_PER_S * CURVE_S
    assert live.curve[-1].time_s == pytest.approx(CURVE_S + 59.98, abs=0.01)
    times = [point.time_s for point in live.points_after(-math.inf)]
    early_s = [time_s for time_s in times if time_s < 50.9]
    assert early_s == pytest.approx(list(np.arange(2545) / 50), abs=0.003)
    assert len(times) < 2600 + POINTS_PER_S * CURVE_S
    live.clear_curve()
    assert live.points_after(-math.inf) == []


def test_live_hand_is_open_only_according_to_its_report(live: Live) -> None:
    assert live.is_hand_open is None
    live.add_frames(frames(1))
    assert live.is_hand_open is True
    live.add_frames(replace(frames(1, from_s=1.0), reported=np.array([40.0])))
    assert live.is_hand_open is False
    live.add_frames(replace(frames(1, from_s=2.0), reported=np.array([math.nan])))
    assert live.is_hand_open is None


def test_document_contains_only_points_after_the_requested_time(
    session: Session, live: Live
) -> None:
    live.add_frames(frames(40, rate_hz=40.0))
    whole = page_of(session, after_s=0.5)
    rest = page_of(session, generation=live.generation, after_s=0.5)
    assert len(whole["curve"]) == 40
    assert [point[0] for point in rest["curve"]] == pytest.approx(np.arange(21, 40) / 40)
    assert whole["source"]["simulated"] is True
    assert [one["time_s"] for one in whole["past"]] == [point[0] for point in whole["curve"]]
    newest = whole["past"][-1] | {"touching": []}
    assert newest == {name: whole["pixels"].get(name, whole["hand"]) for name in newest}
    assert rest["past"] == []


def test_session_of_a_rig_without_a_gripper_refuses_a_grasp(session: Session) -> None:
    session.devices.apply_update(
        Update(notes=(replace(SOURCE, gripper=None),), link=LinkStatus(stale=False))
    )
    session.join("a")
    session.devices.activity = DeviceActivity.WATCHING
    assert session.refusal(Action.GRASP, viewer="a") == "this rig has no gripper"
    assert session.refusal(Action.RELEASE, viewer="a") == "this rig has no gripper"
    assert session.refusal(Action.EXAMINE, viewer="a") == ""
    page = page_of(session)
    assert (page["verdict"]["text"], page["operator"]["word"]) == ("watching", "Ready")
    assert page["hand"] is None


@pytest.mark.parametrize(
    ("stale", "counts", "text", "kind", "why"),
    [
        (False, 300, "ready", "idle", ""),
        (True, 300, "the sensor is silent", "bad", "check its cable and power"),
        (False, 0, "no pixel readings", "bad", "check the cable"),
    ],
)
def test_headline_of_a_silent_or_unreadable_sensor_is_bad(
    session: Session, live: Live, stale: bool, counts: int, text: str, kind: str, why: str
) -> None:
    session.devices.activity = DeviceActivity.WATCHING
    live.add_frames(frames(1, counts=counts))
    live.link = LinkStatus(frames=9, rate_hz=15.0, age_s=3.0 * stale, stale=stale)
    page = page_of(session)
    assert (page["verdict"]["text"], page["verdict"]["kind"]) == (text, kind)
    assert why in page["verdict"]["why"]
    if counts == 0:
        assert page["pixels"]["percent"] == page["pixels"]["ohm"] == [[None, None]] * 4


def test_document_link_is_stale_while_the_device_process_is_silent() -> None:
    silent_s = [0.1]
    session = Session(send=lambda message: None, silent_s=lambda: silent_s[0])
    session.devices.live.open_source(SOURCE)
    session.devices.live.link = LinkStatus(frames=9, rate_hz=15.0, age_s=0.03, stale=False)
    link = page_of(session)["link"]
    assert (link["stale"], link["hung_s"]) == (False, None)
    silent_s[0] = 3.0
    hung = page_of(session)["link"]
    assert (hung["stale"], hung["hung_s"], hung["age_s"]) == (True, 3.0, pytest.approx(3.03))


FORCE = Measurement(value=2.0, low=1.8, high=2.2, unit="n")
HELD = GraspResult(outcome=Outcome.HELD, force_n=FORCE, peak_force_n=2.0)
PASSED = "exceeded the damage limit"
NO_BIN = GraspDocument(result=HELD, is_sorted=True, no_bin="the store does not answer")


@pytest.mark.parametrize(
    ("kind", "why", "given"),
    [
        ("good", "", {}),
        ("good", "", {"target_n": None}),
        ("warn", "", {"target_n": 3.0}),
        ("good", "", {"truth": {"damaged": False}}),
        ("bad", "held and released", {"truth": {"damaged": True}}),
        ("warn", "", {"result": replace(HELD, faults=("the recorder failed",))}),
        ("bad", "", {"result": replace(HELD, outcome=Outcome.SLIPPED)}),
        ("warn", PASSED, {"damage_low_n": 1.5}),
        ("good", "", {"damage_low_n": 2.5}),
        ("warn", "no bin: the store does not answer", {"placed": NO_BIN}),
    ],
)
def test_headline_of_a_grasp_is_good_only_without_faults(
    session: Session, live: Live, kind: str, why: str, given: dict[str, Any]
) -> None:
    devices, session.target_force_n = session.devices, given.get("target_n", 2.0)
    devices.activity = DeviceActivity.WATCHING
    live.set_progress(replace(HOLDING, answer=HELD))
    document = GraspDocument(
        result=given.get("result", HELD),
        target_force_n=session.target_force_n,
        damage_low_n=given.get("damage_low_n", math.inf),
        truth=given.get("truth"),
    )
    devices.grasped, devices.placed = Grasped(document=document), given.get("placed")
    page = page_of(session)
    assert page["verdict"]["kind"] == kind
    assert why in (page["verdict"]["why"] or "")
    assert (PASSED in (page["verdict"]["why"] or "")) == (why == PASSED)
    aside = "Set this item aside: it has no bin"
    shown = (page["operator"]["next"] == aside, page["operator"]["word"] == "No bin")
    assert shown == (devices.placed == NO_BIN,) * 2


def test_headline_after_a_lost_sensor_is_idle_once_frames_arrive_and_the_hand_is_open(
    session: Session, live: Live
) -> None:
    devices = session.devices
    devices.activity = DeviceActivity.WATCHING
    lost = GraspDocument(result=GraspResult(outcome=Outcome.SENSOR_LOST))
    devices.grasped = Grasped(document=lost)
    shown = []
    for width_mm, stale in ((40.0, True), (40.0, False), (74.0, False)):
        live.add_frames(replace(frames(1), reported=np.array([width_mm])))
        live.link = LinkStatus(frames=9, rate_hz=15.0, age_s=3.0 * stale, stale=stale)
        page = page_of(session)
        shown.append((page["operator"]["word"], page["verdict"]["kind"]))
    assert shown == [("Sensor silent", "bad"), ("Sensor lost", "bad"), ("Sensor is back", "idle")]
    assert page["operator"]["next"] == "Put the item in again, then press Grasp"


def test_marks_of_the_chart_and_the_decision_time_count_from_the_same_contact(
    session: Session, live: Live
) -> None:
    moments = (Moment(time_s=4.3, name="contact"), Moment(time_s=5.5, name="answer"))
    result = replace(HELD, decision_time_s=1.5)
    live.set_progress(replace(HOLDING, answer=result, touched_s=4.0, moments=moments))
    page = page_of(session)
    zero_s = page["grasp"]["touched_s"]
    marks = {name: time_s - zero_s for time_s, name, _ in page["grasp"]["moments"]}
    assert marks == {"contact": 0.0, "answer": page["measured"]["decision_time_s"]}


def test_hand_of_the_page_has_the_deflection_that_is_not_the_objects(
    session: Session, live: Live
) -> None:
    """The object is as stiff as a spring of 2 N/mm, in a gripper with 0.2 mm/N."""
    compliance = Compliance(
        slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.1, residual_mm=0.0, largest_force_n=9.0
    )
    live.set_progress(replace(HOLDING, compliance=compliance))
    live.curve.append(Point(9.0, -40.0, Measurement(value=3.0, low=2.9, high=3.1, unit="n")))
    width_mm = 60.0 - 3.0 / 2.0 - 0.2 * 3.0 + 0.1
    hand = page_of(session)["hand"]
    assert 3.0 / (60.0 - width_mm - hand["own_mm"]) == pytest.approx(2.0)


@pytest.mark.parametrize("is_begun", [True, False])
def test_headline_of_a_stop_is_idle_once_the_hand_is_open(
    session: Session, live: Live, is_begun: bool
) -> None:
    devices = session.devices
    devices.activity, devices.stopped_early = DeviceActivity.WATCHING, not is_begun
    stopped = GraspDocument(result=GraspResult(outcome=Outcome.STOPPED))
    devices.grasped = Grasped(document=stopped) if is_begun else None
    live.add_frames(replace(frames(1), reported=np.array([40.0])))
    closed = page_of(session)
    assert (closed["operator"]["word"], closed["verdict"]["kind"]) == ("Stopped", "bad")
    # The item would fall.
    assert closed["operator"]["next"].startswith("Take the item") == is_begun
    live.add_frames(frames(1, from_s=1.0))
    opened = page_of(session)
    assert opened["verdict"]["kind"] == "idle"
    assert opened["operator"]["word"] == "Stopped, gripper open"
    assert opened["operator"]["next"] == "Put the next item in, then press Grasp"


def test_operator_view_shows_firmness_and_size_of_a_held_object_only(
    session: Session, live: Live
) -> None:
    result = replace(
        HELD,
        size_mm=Measurement(value=59.2, low=59.0, high=59.4, unit="mm"),
        firmness=Measurement(value=60.4, low=52.0, high=72.0, unit="index"),
    )
    # The outcome of a running grasp is not final.
    live.set_progress(replace(HOLDING, answer=replace(result, outcome=Outcome.STOPPED)))
    shown = [page_of(session)["verdict"]["measured"]]
    for outcome in (Outcome.HELD, Outcome.SLIPPED):
        document = GraspDocument(result=replace(result, outcome=outcome))
        session.devices.grasped = Grasped(document=document)
        shown.append(page_of(session)["verdict"]["measured"])
    assert shown == ["firmness 60 of 100, 59 mm"] * 2 + [""]


def test_operator_view_of_a_provisional_bin_asks_to_turn_the_item_while_it_is_held(
    session: Session, live: Live
) -> None:
    live.set_progress(HOLDING)
    session.devices.activity = DeviceActivity.GRASPING
    # The bin is chosen a moment after the answer.
    page = page_of(session)
    assert (page["operator"]["word"], page["operator"]["next"]) == ("Holding", "Wait")
    assert page["verdict"]["kind"] == "busy"
    session.devices.is_answered = True
    for again, step, word in (
        (False, "Take the item", "By hand"),
        (True, "Take hold of the item", "Turn the item"),
    ):
        given = Bin(name="by hand", again=again)
        session.devices.placed = GraspDocument(result=HELD, bin=given, is_sorted=True)
        page = page_of(session)
        assert page["operator"]["next"].startswith(step)
        # A glance must not take a provisional bin for a final one.
        assert (page["operator"]["word"], page["operator"]["is_bin"]) == (word, not again)
        assert ("provisional" in page["verdict"]["text"]) == again
        assert page["operator"]["measured"].startswith("so far by hand") == again
