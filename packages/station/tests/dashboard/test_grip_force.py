"""Forces on the page, from the calibration's laws and the gain of the contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from packages.station.tests.dashboard.test_live import SOURCE, frames, page_of, progress
from tests.factories import make_sheet_law

from palpate.force.of_calibration import follow_force
from palpate.sensor.array import RIGID_LAYOUT
from palpate_station.dashboard.live import Live
from palpate_station.dashboard.messages import Frames
from palpate_station.dashboard.session import Session

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
