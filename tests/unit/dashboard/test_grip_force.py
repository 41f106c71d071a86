"""Forces on the page, from the calibration's laws and the gain of the contact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.factories import make_sheet_law
from tests.unit.dashboard.test_live import SOURCE, frames, progress

from palpate.calibrate.laws import follow_force
from palpate.dashboard.grasp_progress import Bounds, force_law
from palpate.dashboard.live import Live
from palpate.dashboard.messages import Frames
from palpate.dashboard.page_document import document
from palpate.dashboard.session import Session
from palpate.estimate.gain import Gain
from palpate.grasp.result import Moment
from palpate.gripper.interface import GripperLimits
from palpate.measurement import Measurement

LAW = make_sheet_law(8)
PRESSED = 450


def pressed(count: int, *, from_s: float = 0.0, rate_hz: float = 500.0) -> Frames:
    """Return frames of a hand that holds an object."""
    made = frames(count, from_s=from_s, rate_hz=rate_hz, counts=PRESSED)
    return replace(made, reported=np.full(count, 40.0))


@pytest.fixture
def live() -> Live:
    live = Live()
    live.open_source(replace(SOURCE, law=LAW))
    return live


def pressed_n() -> float:
    """Return the law's force of eight pixels: 1 N for each unit of excess conductance."""
    rest, pressed = (1024 / counts - 1 for counts in (300, PRESSED))
    return follow_force(LAW).step(0.0, np.full((4, 2), rest / pressed - 1)).value


def test_live_curve_has_a_force_at_every_point(live: Live) -> None:
    live.add_frames(pressed(40, rate_hz=40.0))
    assert len(live.curve) == 40
    for point in live.curve:
        assert point.force.value == pytest.approx(pressed_n(), rel=1e-6)
        assert point.force.low < point.force.value < point.force.high
    assert live.force is live.curve[-1].force


def test_live_force_of_an_open_hand_is_none(live: Live) -> None:
    """A released sheet still has a reading, but an open hand has no contact."""
    live.add_frames(pressed(1))
    live.add_frames(frames(40, from_s=0.1, rate_hz=10.0, counts=PRESSED))
    assert live.force is None
    assert [point.force is None for point in live.curve] == [False] + [True] * 40


def test_live_force_is_none_while_opening_and_returns_after_a_halt(live: Live) -> None:
    live.add_frames(pressed(1))
    live.set_progress(replace(progress(0.1, 5.0), phase="release"))
    live.add_frames(replace(pressed(1, from_s=0.1), moving=np.array([True])))
    assert live.force is None
    live.add_frames(pressed(1, from_s=0.2))
    assert live.force is not None


@pytest.mark.parametrize(
    ("until_s", "opens_s", "is_known"),
    [(19.9, 99.0, False), (21.0, 99.0, True), (21.0, 15.0, False)],
)
def test_document_settled_value_requires_a_still_hand_until_the_horizon(
    live: Live, until_s: float, opens_s: float, is_known: bool
) -> None:
    answered = replace(progress(4.0, 5.0), phase="hold", decided=True, settles_s=20.0, data_s=3.9)
    session = Session(send=lambda message: None)
    session.devices.live = live
    live.set_progress(answered)
    for time_s in np.arange(0.0, until_s, 0.1):
        hand = frames if time_s >= opens_s else pressed
        live.add_frames(hand(1, from_s=float(time_s)))
    measured = document(session, generation=-1, after_s=0.0)["measured"]
    assert measured["data_s"] == 3.9
    assert (measured["settled"] is not None) == is_known
    if is_known:
        force, percent = (measured["settled"][name] for name in ("force_n", "settled_percent"))
        assert force["value"] == pytest.approx(pressed_n(), rel=1e-6)
        assert percent["value"] == pytest.approx(float(np.nanmean(live.percent)), rel=1e-6)


def test_live_force_without_a_calibration_is_none() -> None:
    live = Live()
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


def test_page_document_of_a_grasp_contains_forces_contacts_and_bounds(live: Live) -> None:
    session = Session(send=lambda message: None)
    session.devices.live = live
    settled_n = Measurement(value=3.0, low=2.5, high=3.5, unit="n")
    moments = (
        Moment(time_s=4.0, name="contact"),
        Moment(time_s=4.5, name="finger_contact", finger=1),
        Moment(time_s=4.6, name="finger_contact", finger=0),
        Moment(time_s=5.0, name="finger_removal", finger=0),
    )
    live.set_progress(
        replace(
            progress(6.0, 5.0),
            settled_n=settled_n,
            touched_s=3.8,
            moments=moments,
            bounds=Bounds(target_n=3.0, damage_low_n=5.5, ceiling_n=15.0),
        )
    )
    live.add_frames(pressed(1))
    doc = document(session, generation=-1, after_s=0.0)
    assert doc["curve"][0][2:] == pytest.approx(
        [live.force.low, live.force.value, live.force.high] if live.force else [], abs=1e-3
    )
    assert doc["band"][0][4:] == [2.5, 3.0, 3.5]
    assert doc["grasp"]["touched_s"] == 3.8
    assert doc["grasp"]["fingers"] == [1], "a removed finger is not in contact"
    assert doc["grasp"]["bounds"] == {"target_n": 3.0, "damage_low_n": 5.5, "ceiling_n": 15.0}
    assert doc["measured"]["force_now"]["value"] == pytest.approx(pressed_n(), rel=1e-6)
    assert doc["measured"]["holds"] is True


def test_document_of_an_open_hand_has_no_fingers_in_contact(live: Live) -> None:
    session = Session(send=lambda message: None)
    session.devices.live = live
    assert isinstance(SOURCE.gripper, GripperLimits)
    live.set_progress(
        replace(progress(1.0, 5.0), moments=(Moment(time_s=0.5, name="finger_contact", finger=0),))
    )
    live.add_frames(frames(1))
    doc = document(session, generation=-1, after_s=0.0)
    assert doc["grasp"]["fingers"] == []
    assert doc["measured"]["holds"] is False
