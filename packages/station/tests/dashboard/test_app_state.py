"""Application state: confirmed stops, the bin of a held object, and the list of recordings."""

from __future__ import annotations

import asyncio
import logging
import os
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest
from packages.station.tests.dashboard.test_live import HOLDING, SOURCE

from palpate.errors import InputError
from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate.measurement import Measurement
from palpate_station.dashboard import folder as folder_module
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.folder import RecordingList
from palpate_station.dashboard.messages import (
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
from palpate_station.dashboard.settings import Settings
from palpate_station.line.machine import CommandRefusedError
from palpate_station.sorting.conditions import Within
from palpate_station.sorting.rules import Rule, RuleBook

RULES = RuleBook(
    rules=(Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=1),),
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
