"""The device process with a simulated rig: orders, requests, stops and recordings."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.closings import write_damage_file

from palpate.calibration import Calibration
from palpate.errors import DeviceError
from palpate.grasp.damage_limit import load_limit
from palpate.grasp.result import Outcome
from palpate.recording import load_recording
from palpate.rig.bench import GuidedBench
from palpate.twin.devices import TwinGripper
from palpate_station.dashboard.device_process import DeviceProcess
from palpate_station.dashboard.messages import (
    CalibrateForce,
    CalibrateRest,
    Confirm,
    Frames,
    FrameSource,
    Grasped,
    GraspOrder,
    Note,
    OpenHand,
    OpenRig,
    Order,
    OrderEnded,
    OrderStarted,
    Pause,
    Play,
    Record,
    RecordedSegment,
    RecordingChanged,
    ReleaseNow,
    ReplayPosition,
    Seek,
    Shutdown,
    StopConfirmed,
    StopNow,
    Timeline,
    Trouble,
    Update,
)

#: Speed of the simulation; higher than required, so that real time does not slow down the tests.
FAST = 500.0
RIG = OpenRig(name="sim-rigid", object_name="strawberry", seed=3, speed=FAST, rate_hz=15.0)


class Page:
    """The page's end of the pipe, which stores all received updates."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.updates: list[Update] = []

    def send(self, message: Any) -> None:
        self.connection.send(message)

    def until(self, wanted: Callable[[Update], bool]) -> Update:
        while True:
            assert self.connection.poll(60), "no further update of the devices"
            update = self.connection.recv()
            self.updates.append(update)
            if wanted(update):
                return update

    def until_note(self, wanted: Note | Callable[[Note], bool]) -> Any:
        """Return the next note that equals another or fulfils a condition."""

        def fits(note: Note) -> bool:
            return (
                wanted(note) if callable(wanted) else type(note) is type(wanted) and note == wanted
            )

        update = self.until(lambda update: any(map(fits, update.notes)))
        return next(filter(fits, update.notes))

    def until_frames(self, wanted: Callable[[Frames], bool] = lambda frames: True) -> Frames:
        frames = self.until(lambda update: update.frames is not None and wanted(update.frames))
        return frames.frames

    def until_held(self) -> None:
        self.until(lambda update: update.progress is not None and update.progress.phase == "hold")

    @property
    def notes(self) -> list[Note]:
        return [note for update in self.updates for note in update.notes]

    def ended(self, order: Order) -> OrderEnded:
        return self.until_note(lambda note: isinstance(note, OrderEnded) and note.order == order)

    def done(self, order: Order) -> OrderEnded:
        self.send(order)
        return self.ended(order)

    def held_and_released(self, order: GraspOrder) -> OrderEnded:
        self.send(order)
        self.until_held()
        self.send(ReleaseNow())
        return self.ended(order)


@contextmanager
def run_device_process() -> Iterator[Page]:
    ours, theirs = Pipe()
    devices = DeviceProcess(theirs)
    thread = threading.Thread(target=devices.run)
    thread.start()
    page = Page(ours)
    yield page
    page.send(Shutdown())
    # The page's end is closed first, so that a pending write of the telemetry fails as with a lost
    # page. Closing the other end under its thread would not cause this failure.
    ours.close()
    thread.join(30)
    assert not thread.is_alive()


@pytest.fixture
def page() -> Iterator[Page]:
    with run_device_process() as page:
        yield page


@pytest.fixture(scope="module")
def opened() -> Iterator[Page]:
    """One open rig for all tests; every test leaves its hand open."""
    with run_device_process() as page:
        assert not page.done(RIG).trouble
        yield page


@pytest.fixture(scope="module")
def held(opened: Page, tmp_path_factory: pytest.TempPathFactory) -> OrderEnded:
    """A grasp that was held for some frames, released and recorded."""
    recording = tmp_path_factory.mktemp("held") / "grasp.mcap"
    opened.send(order := GraspOrder(target_force_n=None, recording=recording))
    opened.until_held()
    for _ in range(2):
        opened.until_frames()
    opened.send(ReleaseNow())
    return opened.ended(order)


@pytest.mark.slow
def test_grasp_order_holds_until_release_and_records_every_frame(
    opened: Page, held: OrderEnded
) -> None:
    order, ended = held.order, held
    assert isinstance(ended.found, Grasped)
    result = ended.found.document.result
    assert (result.outcome, ended.trouble) == (Outcome.HELD, "")
    assert ended.found.document.truth is not None
    recorded = load_recording(order.recording)
    assert len(recorded.time_s) == result.frames
    assert np.all(np.diff(recorded.sequence) == 1)
    assert opened.updates[-1].link.lost == 0
    decided = [u.progress.decided for u in opened.updates if u.progress is not None]
    assert decided == sorted(decided)


@pytest.mark.slow
def test_grasp_order_with_a_damage_file_limits_the_force_and_records_the_file(
    opened: Page, tmp_path: Path
) -> None:
    free = GraspOrder(target_force_n=8.0, recording=tmp_path / "free.mcap")
    learned = write_damage_file(tmp_path)
    limit = load_limit(learned, kind="kiwi")
    order = replace(free, recording=tmp_path / "limited.mcap", limit=limit)
    # Without the limit the strawberry is crushed, which ends the grasp.
    ended = opened.done(free), opened.held_and_released(order)
    free_n, limited_n = (one.found.document.result.peak_force_n for one in ended)
    assert 0 < limited_n < 0.7 * free_n
    info = load_recording(order.recording).info
    assert (info.damage, info.kind) == (learned.read_text(), "kiwi")
    assert load_recording(free.recording).info.damage is None


def stop_while_closing(page: Page, file: Path, *, number: int = 0) -> GraspOrder:
    order = GraspOrder(target_force_n=None, recording=file)
    page.send(order)
    page.until_frames(lambda frames: frames.reported[-1] < 60.0)
    page.updates.clear()
    page.send(StopNow(number))
    return order


@pytest.mark.slow
def test_stop_during_a_grasp_halts_the_hand_in_its_position_and_is_confirmed_once(
    opened: Page, tmp_path: Path
) -> None:
    ended = opened.ended(stop_while_closing(opened, tmp_path / "stopped.mcap", number=41))
    assert ended.found.document.result.outcome is Outcome.STOPPED
    assert ended.stopped_after_s <= 0.1
    opened.send(StopNow(42))
    opened.until_note(StopConfirmed(42))
    assert confirmations(opened) == [41, 42]
    # The twin's fingers do not move afterwards.
    at_mm = opened.until_frames()
    later = opened.until_frames(lambda frames: frames.time_s[-1] > at_mm.time_s[-1] + 5.0)
    assert np.ptp(later.reported) == 0.0
    assert later.reported[-1] == at_mm.reported[-1] < 74.0
    assert not opened.done(OpenHand()).trouble


def confirmations(page: Page) -> list[int]:
    return [note.number for note in page.notes if isinstance(note, StopConfirmed)]


@pytest.mark.slow
def test_release_directly_after_a_stop_opens_the_hand(opened: Page, tmp_path: Path) -> None:
    """The release arrives while the recording of the stopped grasp is still being written."""
    order = stop_while_closing(opened, tmp_path / "stopped.mcap")
    opened.send(ReleaseNow())
    assert not opened.ended(OpenHand()).trouble
    (ended,) = [one for one in opened.notes if isinstance(one, OrderEnded) and one.order == order]
    assert ended.found.document.result.outcome is Outcome.STOPPED
    # A release directly after the end of a grasp is executed too.
    opened.send(ReleaseNow())
    assert not opened.ended(OpenHand()).trouble


@pytest.mark.slow
def test_stop_cancels_the_running_and_all_queued_orders(opened: Page, tmp_path: Path) -> None:
    first = GraspOrder(target_force_n=None, recording=tmp_path / "first.mcap")
    second = replace(first, recording=tmp_path / "second.mcap")
    opened.send(first)
    opened.until_note(OrderStarted(order=first))
    opened.send(second)
    opened.send(StopNow())
    dropped = opened.ended(second)
    assert (dropped.trouble, dropped.stopped) == ("stopped before it started", True)
    assert not opened.done(OpenHand()).trouble
    # The order after the stop has ended, so a dropped order would have started by now.
    assert OrderStarted(order=second) not in opened.notes
    assert not second.recording.exists()


@pytest.mark.slow
def test_failure_during_a_stop_is_reported_as_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_received = threading.Event()

    def broken(name: str, seed: int) -> GuidedBench:
        assert stop_received.wait(60)
        raise DeviceError("the load cell does not answer")

    monkeypatch.setattr("palpate_station.dashboard.jobs.open_twin_bench", broken)
    first = CalibrateForce(file=tmp_path / "calibration.json")
    with run_device_process() as page:
        assert not page.done(RIG).trouble
        page.send(first)
        page.until_note(OrderStarted(order=first))
        page.send(OpenHand())
        page.send(StopNow())
        assert page.ended(OpenHand()).stopped
        stop_received.set()
        ended = page.ended(first)
    assert (ended.trouble, ended.stopped) == ("the load cell does not answer", False)


def test_stop_without_an_open_rig_is_confirmed_immediately(page: Page) -> None:
    page.send(StopNow(7))
    page.until_note(StopConfirmed(7))


def test_stop_of_an_unreachable_hand_is_not_confirmed(
    opened: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: object) -> None:
        raise DeviceError("the servo does not answer")

    with monkeypatch.context() as patched:
        patched.setattr(TwinGripper, "stop", broken)
        opened.updates.clear()
        opened.send(StopNow(90))
        opened.until_note(Trouble("the servo does not answer"))
        opened.until_frames()
    assert confirmations(opened) == []
    opened.send(StopNow(91))
    opened.until_note(StopConfirmed(91))


@pytest.mark.slow
def test_calibrate_rest_saves_the_file_and_sends_the_new_source(
    opened: Page, tmp_path: Path
) -> None:
    ended = opened.done(CalibrateRest(file=tmp_path / "pad" / "calibration.json"))
    made = Calibration.load(ended.found.file)
    assert np.allclose(made.rest_ohm, ended.found.rest_ohm)
    assert np.abs(ended.found.change_percent).max() < 20
    assert {update.link.lost for update in opened.updates} == {0}
    assert made.force.force_n, "the force pairs must be preserved"
    since = notes_since(opened, ended.order)
    renewed = [isinstance(note, FrameSource) for note in since[: since.index(ended)]]
    assert any(renewed), "the link must be restarted before the end"


@pytest.mark.slow
def test_calibrate_force_uses_the_simulated_load_cell(opened: Page, tmp_path: Path) -> None:
    ended = opened.done(CalibrateForce(file=tmp_path / "calibration.json"))
    made = Calibration.load(ended.found.file)
    assert len(made.force.force_n) >= 8
    assert made.held_out["error_percent"] == dict(ended.found.held_out)
    assert {update.link.lost for update in opened.updates} == {0}, (
        "frames between reads are not losses"
    )
    # The new calibration can be used for a grasp immediately.
    order = GraspOrder(target_force_n=None, recording=tmp_path / "after.mcap")
    assert opened.held_and_released(order).trouble == ""


@pytest.mark.slow
def test_record_between_grasps_has_no_gap(opened: Page, tmp_path: Path) -> None:
    file = tmp_path / "watched.mcap"
    opened.send(Record(file))
    opened.until_note(RecordingChanged(file))
    for _ in range(5):
        opened.until_frames()
    opened.send(Record(None))
    opened.until_note(RecordingChanged(None))
    recorded = load_recording(file)
    assert len(recorded.sequence) > 10
    assert recorded.info.gripper is None, "without a grasp, a replay makes no decisions"
    assert np.all(np.diff(recorded.sequence) == 1)


def notes_since(page: Page, order: Order) -> list[Note]:
    """Return the notes since the start of an order."""
    return page.notes[page.notes.index(OrderStarted(order=order)) :]


def played_to(page: Page, wanted: Callable[[ReplayPosition], bool]) -> ReplayPosition:
    """Return the first replay position that fulfils a condition."""
    return page.until_note(lambda note: isinstance(note, ReplayPosition) and wanted(note))


@pytest.mark.slow
def test_replay_sends_the_whole_timeline_and_supports_pause_and_seek(
    opened: Page, held: OrderEnded
) -> None:
    order, play = held.order, Play(file=held.order.recording)
    opened.send(play)
    opened.until_note(OrderStarted(order=play))
    # The same update may have the first frames.
    del opened.updates[:-1]
    # Paused during its computation, the replay starts paused.
    opened.send(Pause(True))
    played_to(opened, lambda playing: playing.paused)
    notes = opened.notes
    (timeline,) = (note for note in notes if isinstance(note, Timeline))
    places = [note for note in notes if isinstance(note, ReplayPosition)]
    assert [(place.time_s, place.paused) for place in places] == [(timeline.start_s, True)]
    opened.send(Pause(False))
    played_to(opened, lambda playing: not playing.paused)
    recorded = load_recording(order.recording)
    assert (timeline.start_s, timeline.end_s) == (recorded.time_s[0], recorded.time_s[-1])
    assert [phase for _, phase in timeline.phases][-3:-1] == ["hold", "release"]
    past = [note.frames.time_s for note in notes if isinstance(note, RecordedSegment)]
    assert np.array_equal(np.concatenate(past), recorded.time_s), "frames must not be thinned"
    starts_s = {phase: time_s for time_s, phase in timeline.phases}
    within_s = (starts_s["hold"] + starts_s["release"]) / 2
    opened.send(Pause(True))
    opened.send(Seek(within_s))
    place = played_to(opened, lambda playing: playing.time_s == within_s)
    assert place.paused
    shown = next(update for update in reversed(opened.updates) if update.frames is not None)
    assert shown.progress.phase == "hold"
    assert starts_s["hold"] < shown.frames.time_s[-1] <= within_s
    opened.send(Seek(timeline.end_s + 99.0))
    assert played_to(opened, lambda playing: playing.time_s == timeline.end_s).grasped is not None
    opened.send(Seek(starts_s["hold"]))
    assert played_to(opened, lambda playing: playing.time_s == starts_s["hold"]).grasped is None
    opened.send(Confirm())


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (OpenRig(name="nowhere.toml"), "nowhere.toml: no such file"),
        (OpenRig(name="sim-rigid", object_name="moon"), "no simulated object 'moon'"),
        (Play(file=Path("nothing.mcap")), "nothing.mcap: can't be opened"),
        (OpenHand(), "no rig is open"),
    ],
)
def test_order_that_cannot_be_executed_ends_with_the_reason(
    page: Page, order: Order, reason: str
) -> None:
    assert reason in page.done(order).trouble
