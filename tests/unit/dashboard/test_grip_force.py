"""Forces on the page, from the calibration's laws and the gain of the contact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.factories import make_sheet_law
from tests.unit.dashboard.test_live import SOURCE, frames, page_of, progress

from palpate.calibrate.laws import follow_force
from palpate.dashboard.grasp_progress import Bounds, force_law
from palpate.dashboard.live import Live
from palpate.dashboard.messages import Frames
from palpate.dashboard.session import Session
from palpate.estimate.gain import Gain
from palpate.grasp.result import Moment
from palpate.measurement import Measurement
from palpate.sensor.array import RIGID_LAYOUT

LAW = make_sheet_law(8)
PRESSED = 450


def pressed(count: int, *, from_s: float = 0.0, rate_hz: float = 500.0) -> Frames:
    """Return frames of a hand that holds an object."""
    made = frames(count, from_s=from_s, rate_hz=rate_hz, counts=PRESSED)
    return replace(made, reported=np.full(count, 40.0))


@pytest.fixture
def live(session: Session) -> Live:
    session.devices.live.open_source(replace(SOURCE, law=LAW))
    return session.devices.live


def pressed_n() -> float:
    """Return the law's force of eight pixels: 1 N for each unit of excess conductance."""
    rest, pressed = (1024 / counts - 1 for counts in (300, PRESSED))
    return follow_force(LAW).step(0.0, np.full((4, 2), rest / pressed - 1)).value


def test_live_curve_has_a_force_at_every_point_until_the_hand_is_open(live: Live) -> None:
    live.add_frames(pressed(40, rate_hz=40.0))
    assert len(live.curve) == 40
    for point in live.curve:
        assert point.force.value == pytest.approx(pressed_n(), rel=1e-6)
        assert point.force.low < point.force.value < point.force.high
    assert live.force is live.curve[-1].force
    # A released sheet still has a reading, but an open hand has no contact.
    live.add_frames(frames(40, from_s=1.1, rate_hz=10.0, counts=PRESSED))
    assert live.force is None
    assert [point.force is None for point in live.curve] == [False] * 40 + [True] * 40


def test_live_force_is_none_while_opening_and_returns_after_a_halt(live: Live) -> None:
    live.add_frames(pressed(1))
    live.set_progress(replace(progress(0.1, 5.0), phase="release"))
    live.add_frames(replace(pressed(1, from_s=0.1), moving=np.array([True])))
    assert live.force is None
    live.add_frames(pressed(1, from_s=0.2))
    assert live.force is not None


def test_live_finger_forces_average_to_the_grip_force(live: Live) -> None:
    held = pressed(5)
    # A pixel with excess x has x + 0.096 N; a divider has counts / (1024 - counts).
    for finger, excess in ((0, 0.6), (1, 0.2)):
        conductance = 300 / 724 * (1 + excess)
        rows = np.array(RIGID_LAYOUT.finger_of_row) == finger
        held.counts[:, rows] = round(1024 * conductance / (1 + conductance))
    live.add_frames(held)
    first, second = live.finger_forces_n(live.force, live.ohm)
    assert first / second == pytest.approx(0.696 / 0.296, rel=0.03)
    assert (first + second) / 2 == pytest.approx(live.force.middle)
    live.add_frames(frames(5, from_s=1.0))
    assert live.finger_forces_n(live.force, live.ohm) == [], "an open hand has no force"


@pytest.mark.parametrize(
    ("until_s", "opens_s", "is_known"),
    [(19.9, 99.0, False), (21.0, 99.0, True), (21.0, 15.0, False)],
)
def test_document_settled_value_requires_a_still_hand_until_the_horizon(
    session: Session, live: Live, until_s: float, opens_s: float, is_known: bool
) -> None:
    answered = replace(progress(4.0, 5.0), phase="hold", decided=True, settles_s=20.0, data_s=3.9)
    live.set_progress(answered)
    for time_s in np.arange(0.0, until_s, 0.1):
        hand = frames if time_s >= opens_s else pressed
        live.add_frames(hand(1, from_s=float(time_s)))
    measured = page_of(session)["measured"]
    assert measured["data_s"] == 3.9
    assert (measured["settled"] is not None) == is_known
    if is_known:
        force, percent = (measured["settled"][name] for name in ("force_n", "settled_percent"))
        assert force["value"] == pytest.approx(pressed_n(), rel=1e-6)
        assert percent["value"] == pytest.approx(float(np.nanmean(live.percent)), rel=1e-6)


def test_live_force_without_a_calibration_is_none(live: Live) -> None:
    live.open_source(SOURCE)
    live.add_frames(frames(2, counts=PRESSED))
    assert live.force is None
    assert force_law(None) is None


def test_live_force_uses_the_gain_of_the_contact(live: Live) -> None:
    gain = Gain(log_mean=math.log(1.5), log_sd=0.05, law_sd=0.1)
    live.add_frames(pressed(1))
    wide = live.force
    live.set_progress(replace(progress(0.0, 5.0), gain=gain))
    live.add_frames(pressed(1, from_s=0.1))
    assert live.force.value == pytest.approx(1.5 * wide.value, rel=0.05)
    assert live.force.high / live.force.low < wide.high / wide.low
    live.clear_curve()
    live.add_frames(pressed(1, from_s=0.2))
    assert live.force.value == pytest.approx(wide.value), "the gain applies to one contact only"


def test_page_document_of_a_grasp_contains_forces_contacts_and_bounds(
    session: Session, live: Live
) -> None:
    settled_n = Measurement(value=3.0, low=2.5, high=3.5, unit="n")
    bounds = Bounds(target_n=3.0, damage_low_n=5.5, ceiling_n=15.0)
    moments = (
        Moment(time_s=4.0, name="contact"),
        Moment(time_s=4.5, name="finger_contact", finger=1),
        Moment(time_s=4.6, name="finger_contact", finger=0),
        Moment(time_s=5.0, name="finger_removal", finger=0),
    )
    shown = replace(progress(6.0, 5.0), settled_n=settled_n, touched_s=3.8)
    live.set_progress(replace(shown, moments=moments, bounds=bounds))
    live.add_frames(pressed(1))
    doc, force = page_of(session), live.force
    assert doc["curve"][0][2:] == pytest.approx([force.low, force.value, force.high], abs=1e-3)
    assert doc["band"][0][4:] == [2.5, 3.0, 3.5]
    assert doc["grasp"]["touched_s"] == 3.8
    assert doc["grasp"]["fingers"] == [1], "a removed finger is not in contact"
    assert doc["grasp"]["bounds"] == {"target_n": 3.0, "damage_low_n": 5.5, "ceiling_n": 15.0}
    assert doc["measured"]["force_now"]["value"] == pytest.approx(pressed_n(), rel=1e-6)
    assert doc["measured"]["holds"] is True
    live.add_frames(frames(1, from_s=0.1))
    opened = page_of(session)
    assert (opened["grasp"]["fingers"], opened["measured"]["holds"]) == ([], False)
