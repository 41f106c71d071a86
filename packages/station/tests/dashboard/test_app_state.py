"""Application state: confirmed stops, the bin of a held object, and the list of recordings."""

from __future__ import annotations

import asyncio
import logging
import os
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from packages.station.tests.dashboard.test_live import HOLDING, SOURCE

from palpate.errors import InputError
from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate.measurement import Measurement
from palpate_station.dashboard import folder as folder_module
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.folder import History, RecordingList
from palpate_station.dashboard.lot import lot_text
from palpate_station.dashboard.messages import (
    DeviceActivity,
    Grasped,
    GraspOrder,
    LinkStatus,
    Measured,
    OrderEnded,
    OrderStarted,
    StopConfirmed,
    Trouble,
    Update,
)
from palpate_station.dashboard.page_document import document
from palpate_station.dashboard.settings import Settings
from palpate_station.line.machine import CommandRefusedError
from palpate_station.records import About, Item
from palpate_station.sorting.conditions import Within
from palpate_station.sorting.rules import Rule, RuleBook

RULES = RuleBook(
    rules=(
        Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=1),
        Rule(bin="large", conditions=(Within("size_mm", 60, 90),), line=2),
    ),
    default_bin="by hand",
    most_grasps=1,
)


def app_state_of(
    folder: Path, rules: RuleBook | None = None, *, store: str | None = None
) -> AppState:
    return AppState(
        Settings(
            rigs=("sim-rigid",),
            objects=(),
            folder=folder,
            store=store,
            object_name=None,
            seed=0,
            speed=1.0,
            rules=rules,
        )
    )


def confirmation(number: int) -> Update:
    return Update(notes=(StopConfirmed(number),), link=LinkStatus())


def test_app_state_stop_waits_for_the_confirmation_of_the_device_process(tmp_path: Path) -> None:
    async def command() -> list[bool]:
        app_state = app_state_of(tmp_path)
        unconfirmed = await app_state.stop(timeout_s=0.0)
        second = asyncio.create_task(app_state.stop(timeout_s=60.0))
        await asyncio.sleep(0)
        app_state.receive_update(confirmation(1))
        await asyncio.sleep(0)
        early = second.done()
        # The event loop of the pages is not involved, because it may be blocked.
        app_state.receive_update(confirmation(2))
        app_state.receive_update(confirmation(1))
        return [unconfirmed, early, await second]

    assert asyncio.run(command()) == [False, False, True]


def test_app_state_answers_with_rules_only_when_the_bin_is_known(tmp_path: Path) -> None:
    size = Measurement(value=40.0, low=39.5, high=40.5, unit="mm")
    held = replace(HOLDING, answer=GraspResult(outcome=Outcome.STOPPED, size_mm=size))
    start = OrderStarted(order=GraspOrder(target_force_n=None, recording=tmp_path / "new.mcap"))

    async def grasp() -> list[dict[str, object]]:
        app_state = app_state_of(tmp_path, RULES)
        app_state.loop = asyncio.get_running_loop()
        app_state.receive_update(Update(notes=(SOURCE, start), link=LinkStatus()))
        app_state.receive_update(Update(notes=(), link=LinkStatus(), progress=held))
        answer = GraspDocument(result=replace(held.answer, outcome=Outcome.HELD))
        answered = Measured(Grasped(document=answer))
        app_state.receive_update(Update(notes=(answered,), link=LinkStatus()))
        seen: list[dict[str, object]] = []
        async with asyncio.timeout(60.0):
            while not seen or not seen[-1]["answered"]:
                await asyncio.sleep(0)
                seen.append({key: app_state.state()[key] for key in ("answered", "bin")})
        return seen

    first, *_, last = asyncio.run(grasp())
    assert first == {"answered": False, "bin": None}
    assert last == {"answered": True, "bin": "small"}


def test_rules_decide_whether_a_grasp_without_a_name_is_refused(tmp_path: Path) -> None:
    for requires_item in (False, True):
        app_state = app_state_of(tmp_path, replace(RULES, requires_item=requires_item))
        app_state.session.join("a")
        devices = app_state.session.devices
        devices.rig_open, devices.live.link = True, LinkStatus(frames=9, stale=False)
        order = app_state.grasp_order(target_force_n=None)
        with pytest.raises(InputError, match="Scan the item") if requires_item else nullcontext():
            app_state.session.order("a", order)
        if requires_item:
            app_state.session.order("a", replace(order, item_id="A1"))


class Station:
    """The state of an application whose device process the test plays."""

    def __init__(self, folder: Path, *, most_grasps: int = 1) -> None:
        rules = replace(RULES, most_grasps=most_grasps)
        self.app = app_state_of(folder, rules, store=str(folder / "items.sqlite"))
        self.app.loop = asyncio.get_running_loop()
        self.update(SOURCE)
        self.app.session.join("a")
        self.app.session.devices.rig_open = True
        self.form = self.app.session.form
        self._recordings = count()

    def update(self, *notes: Any, **known: Any) -> None:
        self.app._apply_update(Update(notes=notes, link=LinkStatus(frames=9, stale=False), **known))

    def page(self) -> dict[str, Any]:
        return document(self.app.session, generation=-1, after_s=0.0)["operator"]

    async def grasp(self, item_id: str, size_mm: float, outcome: Outcome = Outcome.HELD) -> str:
        """Grasp an item and end with an outcome; return the word while the hand opens."""
        self.form.set_item(item_id)
        order = GraspOrder(
            target_force_n=None, recording=Path(f"{next(self._recordings)}.mcap"), item_id=item_id
        )
        self.form.take_item(order)
        self.app.session.send_order(order)
        self.update(OrderStarted(order=order))
        size = Measurement(value=size_mm, low=size_mm - 0.5, high=size_mm + 0.5, unit="mm")
        result = GraspResult(outcome=Outcome.HELD, size_mm=size, force_n=None)
        measured = Grasped(document=GraspDocument(result=result))
        self.update(Measured(measured), progress=replace(HOLDING, answer=result))
        await self.until(lambda: self.app.session.devices.is_answered)
        self.update(progress=replace(HOLDING, answer=result, phase="release"))
        word = str(self.page()["word"])
        ended = GraspDocument(result=replace(result, outcome=outcome))
        self.update(OrderEnded(order=order, found=Grasped(document=ended)))
        await self.until(lambda: self.app.session.devices.activity is DeviceActivity.WATCHING)
        return word

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(60.0):
            while not condition():
                await asyncio.sleep(0)

    def stored_bins(self) -> dict[str, str]:
        pages = self.app.item_store.pages(limit=9)
        found = ((page.item.item_id, page.latest_verdict(About.BIN)) for page in pages)
        return {name: "" if one is None else one.text for name, one in found}


def test_item_that_was_stopped_after_its_verdict_stays_the_next_one(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path)
        assert await station.grasp("Z1", 40.0, Outcome.STOPPED) == "Small"
        assert station.stored_bins() == {"Z1": ""}
        station.form.set_item("Z2")
        assert "Z1 is not measured" in station.app.session.name_fault
        assert await station.grasp("Z1", 40.0) == "Small"
        assert (station.page()["word"], station.stored_bins()) == ("Small", {"Z1": "small"})
        station.form.set_item("Z2")
        assert station.app.session.name_fault == ""

    asyncio.run(run())


def test_stopped_grasps_leave_the_second_look_to_the_item(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path, most_grasps=2)
        for outcome in (Outcome.STOPPED, Outcome.STOPPED, Outcome.HELD):
            # At the limit of the rule, so that one grasp is not certain.
            assert await station.grasp("N1", 45.0, outcome) == "Turn the item"
        assert await station.grasp("N1", 45.0) == "By hand"
        assert "; 2 grasps" in station.app.result()[1].bin.why

    asyncio.run(run())


def test_bin_that_a_person_gives_is_the_bin_on_the_screen_in_the_lot_and_after_a_new_grasp(
    tmp_path: Path,
) -> None:
    async def run() -> None:
        station = Station(tmp_path)
        app, item_store = station.app, station.app.item_store
        app.start_lot("Field 7")
        await station.grasp("A2", 40.0)
        assert app.history.lot.bins == {"small": 1}
        item_store.change(Item(item_id="A2"), labels={"bin": "by hand"}, by="maria")
        await app.read_given_bins()
        page = station.page()
        assert (page["word"], page["is_bin"]) == ("By hand", True)
        assert "measured: small" in page["detail"]
        assert app.history.lot.bins == {"by hand": 1}
        station.form.set_item("A2")
        assert "A2 was already sorted: by hand" in app.session.name_fault
        await station.grasp("A2", 40.0)
        page = station.page()
        assert (page["word"], station.stored_bins()) == ("By hand", {"A2": "by hand"})
        assert "bin given by maria; measured: small" in page["detail"]
        assert app.history.lot.bins == {"by hand": 1}
        bins = [one for one in item_store.page("A2").verdicts if one.about is About.BIN]
        assert [one.text for one in bins] == ["small", "by hand", "by hand"]

    asyncio.run(run())


def test_bin_that_a_person_gives_ends_an_unfinished_item(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path, most_grasps=2)
        await station.grasp("N1", 45.0)
        assert (station.form.item_id, station.app.history.lot.items) == ("N1", 0)
        station.app.item_store.change(Item(item_id="N1"), labels={"bin": "small"}, by="maria")
        await station.app.read_given_bins()
        assert (station.form.item_id, station.page()["word"]) == ("", "Small")
        assert station.app.history.lot.bins == {"small": 1}
        station.form.set_item("N2")
        assert station.app.session.name_fault == ""

    asyncio.run(run())


def test_lot_does_not_take_items_that_were_grasped_before_it(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path)
        app, words = station.app, station.app.session.words
        await station.grasp("A4", 40.0)
        assert not station.page()["is_past"]
        app.start_lot("Field 7")
        # The lot is shown before its first item, and the last item of the other lot has ended.
        assert lot_text(app.history.lot, words) == "Lot Field 7 · items 0"
        assert station.page()["is_past"]
        await station.grasp("A4", 40.0)
        await station.grasp("A5", 40.0)
        assert not station.page()["is_past"]
        assert app.history.lot.bins == {"small": 1}
        batches = {page.item.item_id: page.item.batch for page in app.item_store.pages(limit=9)}
        assert batches == {"A4": None, "A5": "Field 7"}

    asyncio.run(run())


def test_each_bin_has_its_own_colour_in_the_order_of_the_rules(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path)
        found = {}
        for name, size_mm in (("A1", 80.0), ("A2", 40.0), ("A3", 50.0)):
            await station.grasp(name, size_mm)
            page = station.page()
            found[page["word"]] = (page["color"], page["item"])
        # The default bin is amber.
        assert found == {"Large": (1, "A1"), "Small": (0, "A2"), "By hand": (None, "A3")}

    asyncio.run(run())


def test_grasp_that_was_stopped_before_the_hand_moved_is_in_the_history(tmp_path: Path) -> None:
    async def run() -> None:
        station = Station(tmp_path)
        order = GraspOrder(target_force_n=None, recording=Path("new.mcap"), item_id="A1")
        station.app.session.send_order(order)
        station.update(OrderStarted(order=order), OrderEnded(order=order, stopped=True))
        for history in (station.app.history, History(tmp_path)):
            assert history.running is None
            (found,) = history.recent_grasps
            assert (found.item_id, found.outcome) == ("A1", "stopped")

    asyncio.run(run())


def test_full_disk_refuses_a_grasp_and_failed_orders_are_logged_as_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def work() -> None:
        app_state = app_state_of(tmp_path)
        app_state.loop = asyncio.get_running_loop()
        devices = app_state.session.devices
        devices.rig_open, devices.live.link = True, LinkStatus(frames=9, stale=False)
        order = {"target_force_n": None, "item_id": "A1", "kind": "", "stops": None}
        await app_state.grasp("a", **order)
        # The disk has become full since the order.
        ended = OrderEnded(order=devices.order, trouble="No space left on device")
        app_state.receive_update(Update(notes=(ended,), link=LinkStatus(frames=9, stale=False)))
        app_state.receive_update(Update(notes=(Trouble("no frame"),), link=LinkStatus()))
        await asyncio.sleep(0)
        devices.live.link = LinkStatus(frames=9, stale=False)
        full = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
        monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
        with pytest.raises(CommandRefusedError, match="the disk is full"):
            await app_state.grasp("a", **order)

    asyncio.run(work())
    errors = [one.getMessage() for one in caplog.records if one.levelno == logging.ERROR]
    assert errors == ["grasp A1: No space left on device", "no frame"]


def names_in(folder: Path) -> list[str]:
    return [file.name for file, _ in RecordingList(folder).newest()]


def test_recording_list_is_sorted_newest_first_and_skips_missing_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("young.mcap", "gone.mcap", "middle.mcap", "old.mcap", "table.csv")
    for age_s, name in enumerate(names):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1e9 - age_s, 1e9 - age_s))
    (tmp_path / "dangling.mcap").symlink_to("nowhere.mcap")
    (tmp_path / "round.mcap").symlink_to("round.mcap")
    real_listdir = os.listdir

    def listdir(folder: Path) -> list[str]:
        """Delete a file during the scan."""
        found = real_listdir(folder)
        (folder / "gone.mcap").unlink()
        return found

    monkeypatch.setattr(folder_module.os, "listdir", listdir)
    assert names_in(tmp_path) == ["young.mcap", "middle.mcap", "old.mcap"]
    assert names_in(tmp_path / "not there yet") == []
