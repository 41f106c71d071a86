"""The way out of the loop: bounded, newest first, notes never dropped."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from palpate.dashboard import outlet as outlet_module
from palpate.dashboard.messages import FrameSource, Trouble, Update
from palpate.dashboard.outlet import Outlet
from palpate.sensor.array import RIGID_LAYOUT, Frame

SOURCE = FrameSource(
    name="rig", layout=RIGID_LAYOUT, rest_ohm=None, gripper=None, origin="hardware"
)


def frame(sequence: int) -> Frame:
    counts = np.full((4, 2), sequence % 1000, dtype=np.int32)
    return Frame(time_s=sequence / 500.0, sequence=sequence, counts=counts)


@pytest.fixture
def outlet() -> Outlet:
    outlet = Outlet(lambda update: None, on_lost=lambda: None)
    outlet.begin(SOURCE)
    return outlet


def test_a_page_that_takes_nothing_costs_nothing(outlet: Outlet) -> None:
    for sequence in range(30_000):
        outlet.see(frame(sequence), None)
    update = outlet.update()
    assert update.frames is not None
    assert len(update.frames.time_s) == 1000
    assert update.frames.time_s[-1] == pytest.approx(29_999 / 500)
    assert (update.pulse.frames, update.pulse.undrawn) == (30_000, 29_000)
    assert update.pulse.lost == 0


def test_lost_frames_are_counted_and_the_rate_includes_them(outlet: Outlet) -> None:
    for sequence in range(0, 2000, 2):
        outlet.see(frame(sequence), None)
    pulse = outlet.update().pulse
    assert pulse.lost == 999
    assert pulse.rate_hz == pytest.approx(500.0)
    assert pulse.period_worst_s >= pulse.period_p99_s > 0


def test_notes_come_once_and_before_the_frames_of_a_new_source(outlet: Outlet) -> None:
    outlet.see(frame(1), None)
    outlet.note(Trouble("cable"))
    outlet.begin(SOURCE)
    update = outlet.update()
    assert update.notes == (SOURCE, Trouble("cable"), SOURCE)
    assert update.frames is None
    assert outlet.update().notes == ()


def test_a_sender_that_hangs_does_not_hold_up_the_loop() -> None:
    hangs, sent = threading.Event(), list[Update]()

    def send(update: Update) -> None:
        sent.append(update)
        hangs.wait(30)

    outlet = Outlet(send, on_lost=lambda: None)
    outlet.begin(SOURCE)
    outlet.start()
    for sequence in range(5000):
        outlet.see(frame(sequence), None)
    assert len(sent) <= 1
    hangs.set()
    outlet.close()
    assert sent[-1].pulse.frames == 5000


def test_a_page_that_is_gone_is_told_once() -> None:
    gone = threading.Event()

    def send(update: Update) -> None:
        raise BrokenPipeError

    outlet = Outlet(send, on_lost=gone.set)
    outlet.start()
    assert gone.wait(30)
    outlet.close()


def test_ending_does_not_wait_for_a_page_that_reads_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outlet_module, "_FAREWELL_S", 0.01)
    stuck, sending = threading.Event(), threading.Event()

    def send(_: Update) -> None:
        sending.set()
        stuck.wait()

    hanging = Outlet(send, on_lost=lambda: None)
    hanging.start()
    assert sending.wait(10)
    ended = threading.Thread(target=hanging.close)
    ended.start()
    ended.join(10)
    waited = ended.is_alive()
    stuck.set()
    assert not waited
