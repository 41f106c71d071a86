"""Telemetry: bounded queue of frames, complete notes, link status."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from packages.station.tests.dashboard.test_live import SOURCE

from palpate.sensor.array import Frame
from palpate_station.dashboard import telemetry as telemetry_module
from palpate_station.dashboard.messages import Trouble, Update
from palpate_station.dashboard.telemetry import Telemetry


def frame(sequence: int) -> Frame:
    counts = np.full((4, 2), sequence % 1000, dtype=np.int32)
    return Frame(time_s=sequence / 500.0, sequence=sequence, counts=counts)


@pytest.fixture
def telemetry() -> Telemetry:
    telemetry = Telemetry(lambda update: None, on_lost=lambda: None)
    telemetry.begin(SOURCE)
    return telemetry


def test_telemetry_with_a_stalled_page_keeps_only_the_last_1000_frames(
    telemetry: Telemetry,
) -> None:
    for sequence in range(30_000):
        telemetry.add_frame(frame(sequence), None)
    update = telemetry.update()
    assert len(update.frames.time_s) == 1000
    assert update.frames.time_s[-1] == pytest.approx(29_999 / 500)
    assert update.link.frames == 30_000
    assert update.link.lost == 0


def test_telemetry_counts_lost_frames_and_includes_them_in_the_rate(telemetry: Telemetry) -> None:
    for sequence in range(0, 2000, 2):
        telemetry.add_frame(frame(sequence), None)
    link = telemetry.update().link
    assert link.lost == 999
    assert link.rate_hz == pytest.approx(500.0)
    assert link.period_worst_s >= link.period_p99_s > 0


def test_telemetry_sends_notes_once_and_before_frames_of_a_new_source(telemetry: Telemetry) -> None:
    telemetry.add_frame(frame(1), None)
    telemetry.note(Trouble("cable"))
    telemetry.begin(SOURCE)
    update = telemetry.update()
    assert update.notes == (SOURCE, Trouble("cable"), SOURCE)
    assert update.frames is None
    assert telemetry.update().notes == ()


def test_telemetry_blocked_sender_does_not_block_the_loop() -> None:
    hangs, sent = threading.Event(), list[Update]()

    def send(update: Update) -> None:
        sent.append(update)
        hangs.wait(30)

    telemetry = Telemetry(send, on_lost=lambda: None)
    telemetry.begin(SOURCE)
    telemetry.start()
    for sequence in range(5000):
        telemetry.add_frame(frame(sequence), None)
    assert len(sent) <= 1
    hangs.set()
    telemetry.close()
    assert sent[-1].link.frames == 5000


def test_telemetry_close_does_not_wait_for_a_blocked_sender(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(telemetry_module, "_CLOSE_TIMEOUT_S", 0.01)
    stuck, sending = threading.Event(), threading.Event()

    def send(_: Update) -> None:
        sending.set()
        stuck.wait()

    hanging = Telemetry(send, on_lost=lambda: None)
    hanging.start()
    assert sending.wait(10)
    ended = threading.Thread(target=hanging.close)
    ended.start()
    ended.join(10)
    waited = ended.is_alive()
    stuck.set()
    assert not waited
