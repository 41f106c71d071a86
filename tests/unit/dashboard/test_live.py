"""The data of the page's plots, the page document and the headline."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.factories import make_sheet_law

from palpate.dashboard.grasp_progress import Bounds, GraspProgress
from palpate.dashboard.live import CURVE_S, POINTS_PER_S, Live
from palpate.dashboard.messages import (
    Action,
    DeviceActivity,
    DevicesLost,
    Frames,
    FrameSource,
    Grasped,
    LinkStatus,
    Update,
)
from palpate.dashboard.page_document import document
from palpate.dashboard.session import Session
from palpate.grasp.result import GraspResult, Outcome
from palpate.gripper.interface import GripperLimits
from palpate.measurement import Measurement
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.health import FrameColumns, check_health
from palpate.sensor.sample import pixel_resistance_ohm

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
def live() -> Live:
    live = Live()
    live.open_source(SOURCE)
    return live


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


def test_live_change_is_relative_to_the_rest_values(live: Live) -> None:
    live.add_frames(frames(1, counts=450))
    # With the divider's resistor of 4700 ohm below, R is proportional to 1024 / counts - 1.
    assert live.percent[0, 0] == pytest.approx(100 * ((1024 / 450 - 1) / (1024 / 300 - 1) - 1))
    assert live.finger_percent(live.percent) == pytest.approx([live.percent[0, 0]] * 2)


def test_live_finger_forces_average_to_the_grip_force() -> None:
    live = Live()
    live.open_source(replace(SOURCE, law=make_sheet_law(8)))
    pressed = frames(5)
    pressed.reported[:] = 40.0
    # A pixel with excess x has x + 0.096 N; a divider has counts / (1024 - counts).
    rest = 300 / 724
    for finger, excess in ((0, 0.6), (1, 0.2)):
        conductance = rest * (1 + excess)
        rows = np.array(RIGID_LAYOUT.finger_of_row) == finger
        pressed.counts[:, rows] = round(1024 * conductance / (1 + conductance))
    live.add_frames(pressed)
    first, second = live.finger_forces_n(live.force, live.ohm)
    assert first / second == pytest.approx(0.696 / 0.296, rel=0.03)
    assert (first + second) / 2 == pytest.approx(live.force.middle)
    live.add_frames(frames(5, from_s=1.0))
    assert live.finger_forces_n(live.force, live.ohm) == [], "an open hand has no force"


def test_live_hand_is_open_only_according_to_its_report(live: Live) -> None:
    assert live.is_hand_open is None
    live.add_frames(frames(1))
    assert live.is_hand_open is True
    live.add_frames(replace(frames(1, from_s=1.0), reported=np.array([40.0])))
    assert live.is_hand_open is False
    live.add_frames(replace(frames(1, from_s=2.0), reported=np.array([math.nan])))
    assert live.is_hand_open is None


def test_live_without_rest_values_uses_the_first_frames() -> None:
    live = Live()
    live.open_source(replace(SOURCE, rest_ohm=None))
    live.add_frames(frames(15))
    live.add_frames(frames(1, from_s=1.0, counts=450))
    assert live.percent[0, 0] < -40


def test_document_contains_only_points_after_the_requested_time() -> None:
    session = Session(send=lambda message: None)
    session.devices.live.open_source(SOURCE)
    session.devices.live.add_frames(frames(40, rate_hz=40.0))
    generation = session.devices.live.generation
    whole = document(session, generation=-1, after_s=0.5)
    rest = document(session, generation=generation, after_s=0.5)
    assert len(whole["curve"]) == 40
    assert [point[0] for point in rest["curve"]] == pytest.approx(np.arange(21, 40) / 40)
    assert whole["source"]["simulated"] is True
    assert [one["time_s"] for one in whole["past"]] == [point[0] for point in whole["curve"]]
    newest = whole["past"][-1] | {"touching": []}
    assert newest == {name: whole["pixels"].get(name, whole["hand"]) for name in newest}
    assert rest["past"] == []


def test_document_past_hand_is_opening_only_after_the_release() -> None:
    session = Session(send=lambda message: None)
    live = session.devices.live
    live.open_source(SOURCE)
    closing = frames(10, rate_hz=10.0)
    live.add_frames(replace(closing, moving=np.ones(10, dtype=bool)))
    live.set_progress(replace(progress(0.95, 1.0), phase="release"))
    opening = frames(10, from_s=1.0, rate_hz=10.0)
    live.add_frames(replace(opening, moving=np.ones(10, dtype=bool)))
    past = document(session, generation=-1, after_s=0.0)["past"]
    assert [one["hand"]["opening"] for one in past] == [False] * 10 + [True] * 10


def test_document_open_pixel_is_null() -> None:
    session = Session(send=lambda message: None)
    session.devices.live.open_source(SOURCE)
    session.devices.live.add_frames(frames(1, counts=0))
    pixels = document(session, generation=-1, after_s=0.0)["pixels"]
    assert pixels["percent"][0] == [None, None]
    assert pixels["ohm"][0] == [None, None]


def test_document_findings_are_assigned_to_their_pixels() -> None:
    counts = np.rint(np.random.default_rng(1).normal(300, 0.6, (100, 4, 2))).astype(np.int32)
    counts[:, 2, 1] = 0
    counts[:, 3] = 0
    columns = FrameColumns(time_s=np.arange(100) / 15, sequence=np.arange(100), counts=counts)
    session = Session(send=lambda message: None)
    session.devices.live.open_source(SOURCE)
    session.devices.live.add_frames(frames(1))
    session.devices.health = check_health(columns, layout=RIGID_LAYOUT)
    findings = document(session, generation=-1, after_s=0.0)["pixels"]["findings"]
    assert {(one["row"], one["col"]) for one in findings} == {(2, 1), (3, 0), (3, 1)}
    assert {one["severity"] for one in findings} == {"fault"}
    assert "reads open" in findings[0]["text"]


def test_session_of_a_rig_without_a_gripper_refuses_a_grasp() -> None:
    session = Session(send=lambda message: None)
    session.devices.apply_update(
        Update(notes=(replace(SOURCE, gripper=None),), link=LinkStatus(stale=False))
    )
    session.join("a")
    session.devices.activity = DeviceActivity.WATCHING
    assert session.refusal(Action.GRASP, viewer="a") == "this rig has no gripper"
    assert session.refusal(Action.RELEASE, viewer="a") == "this rig has no gripper"
    assert session.refusal(Action.EXAMINE, viewer="a") == ""
    doc = document(session, generation=-1, after_s=0.0)
    assert (doc["verdict"]["text"], doc["operator"]["word"]) == ("watching", "Ready")
    assert doc["hand"] is None


def sensor_headline(*, stale: bool = False, counts: int = 300) -> dict:
    """Return the headline for a sensor that has sent a frame."""
    session = Session(send=lambda message: None)
    session.devices.activity = DeviceActivity.WATCHING
    session.devices.live.open_source(SOURCE)
    session.devices.live.add_frames(frames(1, counts=counts))
    session.devices.live.link = LinkStatus(frames=9, rate_hz=15.0, age_s=3.0 * stale, stale=stale)
    return document(session, generation=-1, after_s=0.0)["verdict"]


def test_headline_of_a_silent_or_unreadable_sensor_is_bad() -> None:
    assert (sensor_headline()["text"], sensor_headline()["kind"]) == ("ready", "idle")
    silent = sensor_headline(stale=True)
    assert (silent["text"], silent["kind"]) == ("the sensor is silent", "bad")
    assert "check its cable and power" in silent["why"]
    unread = sensor_headline(counts=0)
    assert (unread["text"], unread["kind"]) == ("no pixel readings", "bad")


def test_document_link_is_stale_while_the_device_process_is_silent() -> None:
    silent_s = [0.1]
    session = Session(send=lambda message: None, silent_s=lambda: silent_s[0])
    session.devices.live.open_source(SOURCE)
    session.devices.live.link = LinkStatus(frames=9, rate_hz=15.0, age_s=0.03, stale=False)
    link = document(session, generation=-1, after_s=0.0)["link"]
    assert (link["stale"], link["hung_s"]) == (False, None)
    silent_s[0] = 3.0
    hung = document(session, generation=-1, after_s=0.0)["link"]
    assert (hung["stale"], hung["hung_s"], hung["age_s"]) == (True, 3.0, pytest.approx(3.03))


def test_headline_after_the_end_of_the_device_process_is_bad() -> None:
    session = Session(send=lambda message: None)
    session.devices.grasped = Grasped(result=GraspResult(outcome=Outcome.HELD))
    session.devices.apply_update(DevicesLost("the device process has ended"))
    card = document(session, generation=-1, after_s=0.0)["verdict"]
    assert (card["text"], card["kind"]) == ("the device process has ended", "bad")


FORCE = Measurement(value=2.0, low=1.8, high=2.2, unit="n")


@pytest.mark.parametrize(
    ("target_n", "ended", "kind"),
    [
        (2.0, {}, "good"),
        (None, {}, "good"),
        (2.0, {"truth": {"damaged": True}}, "bad"),
        (2.0, {"truth": {"damaged": False}}, "good"),
        (3.0, {}, "warn"),
        (2.0, {"faults": ("the recorder failed",)}, "warn"),
        (2.0, {"outcome": Outcome.SLIPPED}, "bad"),
    ],
)
def test_headline_of_a_grasp_is_good_only_without_faults(
    target_n: float | None, ended: dict[str, Any], kind: str
) -> None:
    result = GraspResult(
        outcome=ended.get("outcome", Outcome.HELD), force_n=FORCE, faults=ended.get("faults", ())
    )
    session = Session(send=lambda message: None)
    session.target_force_n = target_n
    session.devices.grasped = Grasped(result=result, truth=ended.get("truth"))
    assert document(session, generation=-1, after_s=0.0)["verdict"]["kind"] == kind


@pytest.mark.parametrize("is_begun", [True, False])
def test_headline_of_a_stop_is_idle_once_the_hand_is_open(is_begun: bool) -> None:
    session = Session(send=lambda message: None)
    devices = session.devices
    devices.activity, devices.stopped_early = DeviceActivity.WATCHING, not is_begun
    devices.grasped = Grasped(result=GraspResult(outcome=Outcome.STOPPED)) if is_begun else None
    devices.live.open_source(SOURCE)
    devices.live.add_frames(replace(frames(1), reported=np.array([40.0])))
    closed = document(session, generation=-1, after_s=0.0)
    assert (closed["verdict"]["text"], closed["verdict"]["kind"]) == ("stopped on request", "bad")
    devices.live.add_frames(frames(1, from_s=1.0))
    opened = document(session, generation=-1, after_s=0.0)
    assert (opened["verdict"]["text"], opened["verdict"]["kind"]) == ("stopped, hand open", "idle")
    assert opened["operator"]["word"] == "Stopped, hand open"
    assert opened["operator"]["next"] == "Put the next item in, then press Grasp"


@pytest.mark.parametrize(("low_n", "kind"), [(1.5, "warn"), (2.5, "good"), (None, "good")])
def test_headline_of_a_force_above_the_damage_limit_is_a_warning(
    low_n: float | None, kind: str
) -> None:
    session = Session(send=lambda message: None)
    result = GraspResult(outcome=Outcome.HELD, force_n=FORCE, peak_force_n=2.0)
    session.devices.live.progress = GraspProgress(
        time_s=1.0,
        phase="hold",
        rest_ohm=None,
        began_s=0.0,
        force_n=2.0,
        settled=None,
        answer=result,
        decided=True,
        bounds=Bounds(damage_low_n=low_n),
    )
    session.devices.grasped = Grasped(result=result)
    card = document(session, generation=-1, after_s=0.0)["verdict"]
    assert card["kind"] == kind
    assert ("exceeded the damage limit" in (card["why"] or "")) == (kind == "warn")


def test_operator_view_shows_the_target_of_the_running_or_next_grasp() -> None:
    session = Session(send=lambda message: None)
    session.target_force_n, session.devices.activity = 3.0, DeviceActivity.GRASPING
    shown = document(session, generation=-1, after_s=0.0)["operator"]
    assert shown["target"] == "3 N"
    session.devices.activity = DeviceActivity.WATCHING
    shown = document(session, generation=-1, after_s=0.0)["operator"]
    assert shown["target"] == "gentle squeeze"


def test_headline_of_a_replay_uses_the_recorded_target() -> None:
    """The targets of the last order and of the form are ignored."""
    session = Session(send=lambda message: None)
    session.target_force_n, session.devices.activity = 2.0, DeviceActivity.REPLAYING
    session.form.target_force_n = 2.0
    reached = replace(
        progress(9.0, 1.0),
        phase="hold",
        answer=GraspResult(
            outcome=Outcome.HELD, force_n=replace(FORCE, value=3.0, low=2.8, high=3.2)
        ),
        decided=True,
        bounds=Bounds(target_n=3.0),
    )
    session.devices.live.set_progress(reached)
    shown = document(session, generation=-1, after_s=0.0)
    assert (shown["verdict"]["on_target"], shown["verdict"]["target_force_n"]) == (True, 3.0)
    assert shown["verdict"]["kind"] == "good"
    assert shown["operator"]["target"] == "3 N"


def test_operator_view_shows_firmness_and_size_of_a_held_object_only() -> None:
    session = Session(send=lambda message: None)
    result = GraspResult(
        outcome=Outcome.HELD,
        force_n=FORCE,
        size_mm=Measurement(value=59.2, low=59.0, high=59.4, unit="mm"),
        firmness=Measurement(value=60.4, low=52.0, high=72.0, unit="index"),
    )
    held = replace(progress(9.0, 1.0), phase="hold", decided=True)
    # The outcome of a running grasp is not final.
    session.devices.live.set_progress(
        replace(held, answer=replace(result, outcome=Outcome.STOPPED))
    )
    shown = [document(session, generation=-1, after_s=0.0)["verdict"]["measured"]]
    for outcome in (Outcome.HELD, Outcome.SLIPPED):
        session.devices.grasped = Grasped(result=replace(result, outcome=outcome))
        shown.append(document(session, generation=-1, after_s=0.0)["verdict"]["measured"])
    assert shown == ["firmness 60 of 100, 59 mm"] * 2 + [""]


def test_operator_view_of_a_provisional_bin_asks_to_turn_the_item_while_it_is_held() -> None:
    session = Session(send=lambda message: None)
    held = replace(progress(9.0, 1.0), phase="hold", decided=True)
    session.devices.live.set_progress(held)
    session.devices.activity = DeviceActivity.GRASPING
    for again, step in ((False, "Take the item"), (True, "Press Release, turn the item")):
        given = {
            "name": "by hand",
            "rule": None,
            "again": again,
            "why": "by hand (default): 1 grasp",
        }
        session.devices.placement = {"bin": given}
        assert document(session, generation=-1, after_s=0.0)["operator"]["next"].startswith(step)


def test_operator_view_of_an_item_without_a_bin_asks_to_set_it_aside() -> None:
    session = Session(send=lambda message: None)
    session.devices.grasped = Grasped(result=GraspResult(outcome=Outcome.HELD, force_n=FORCE))
    session.devices.placement = {"bin": None, "why": "store items.sqlite: disk full"}
    session.devices.activity = DeviceActivity.WATCHING
    shown = document(session, generation=-1, after_s=0.0)
    assert shown["verdict"]["why"] == "no bin: store items.sqlite: disk full"
    assert shown["operator"]["next"] == "Set this item aside: it has no bin"
