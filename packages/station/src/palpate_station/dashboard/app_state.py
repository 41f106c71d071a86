"""Application state shared by all pages and clients: session, devices, recordings, items."""

from __future__ import annotations

import asyncio
import logging
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from palpate.errors import InputError, PalpateError
from palpate.grasp.damage_limit import choose_limit
from palpate.grasp.document import Bin, GraspDocument
from palpate.grasp.planning import check_target_force
from palpate.rig.file import find_calibration_file
from palpate_station.dashboard.audit import LOG, record_event, record_refusal
from palpate_station.dashboard.device_client import DeviceClient
from palpate_station.dashboard.folder import (
    Entry,
    History,
    Interruption,
    RecordingList,
    delete_recording,
    make_entry,
    make_recording_path,
    make_stopped_entry,
    rename_recording,
)
from palpate_station.dashboard.grasp_form import Unfinished, check_batch, check_item
from palpate_station.dashboard.headline import (
    REPEATED_OUTCOMES,
    interruption_text,
    outcome_kind,
    store_note,
    why_default,
)
from palpate_station.dashboard.item_store import ItemStore, StoreFault
from palpate_station.dashboard.messages import (
    DeviceActivity,
    DevicesLost,
    Grasped,
    GraspOrder,
    OpenRig,
    Order,
    OrderEnded,
    Request,
    StopConfirmed,
    Trouble,
    Update,
)
from palpate_station.dashboard.page_document import state_document
from palpate_station.dashboard.panel_html import count_of
from palpate_station.dashboard.session import Session, describe_order
from palpate_station.dashboard.settings import Settings
from palpate_station.dashboard.transport import run_on
from palpate_station.dashboard.words import Words
from palpate_station.line.machine import CommandRefusedError
from palpate_station.line.results import NO_ITEM
from palpate_station.records import About, Item
from palpate_station.sorting.placement import Placement

_Answer = TypeVar("_Answer")

_POLL_S = 0.01
#: No grasp starts with less free space, bytes: a recording of the longest hold takes about 2.5 MB.
_MIN_FREE_BYTES = 10_000_000
#: Maximum time that a stop waits for its confirmation, seconds.
STOP_TIMEOUT_S = 2.0
#: Maximum time that a result waits for the store and its bin, seconds. It is longer than the 5 s
#: timeout of an unreachable shared store, after which the local store is used.
_STORE_TIMEOUT_S = 8.0
#: Period of reading the bins that people have given, seconds.
_GIVEN_PERIOD_S = 5.0


class AppState:
    """Connects the session to the device process; implements `line.machine.Machine`.

    Commands may be called from any event loop. All commands except `stop` run on the session's
    loop.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.item_store = ItemStore(settings.store, rules=settings.rules, station=settings.station)
        rules = settings.rules
        default_bin = None if rules is None else rules.default_bin
        self.history = History(settings.folder, default_bin=default_bin)
        self.recordings = RecordingList(settings.folder)
        #: Number of finished grasps, and the document of the last one.
        self._results = 0
        self._last_document: GraspDocument | None = None
        #: Called with each grasp document.
        self.on_result: list[Callable[[GraspDocument], None]] = []
        self.session = Session(
            send=self._send,
            on_measured=self._place_measured,
            on_grasped=self._finish_grasp,
            silent_s=lambda: self.silent_s,
            on_event=record_event,
            on_refused=record_refusal,
            words=Words() if settings.words is None else Words.read(settings.words),
            requires_item=settings.requires_item or (rules is not None and rules.requires_item),
            bins=() if rules is None else rules.bins,
            disk_refusal=self._disk_refusal,
        )
        self.session.form.find_sorted = self.history.find_sorted
        #: The session's event loop; None before `open`.
        self.loop: asyncio.AbstractEventLoop | None = None
        self._process: DeviceClient | None = None
        self._last_message_s: float | None = None
        #: Number of the newest confirmed stop.
        self._stop_confirmed = 0
        #: Callbacks that wake the stops waiting for a confirmation.
        self._stop_waiters = set[Callable[[], object]]()
        self._is_process_lost = self._is_closing = False
        #: The decision on the held object; None before its answer.
        self._placing: asyncio.Future[Placement] | None = None
        #: Reference that keeps the running task from garbage collection.
        self._task: asyncio.Future[None] | None = None

    async def open(self) -> None:
        """Start the device process, wait until it accepts stops, and open the first rig."""
        self.loop = asyncio.get_running_loop()
        await self._report_interrupted_before()
        self.item_store.watch_shared()
        settings = self.settings
        self._process = DeviceClient(self.receive_update)
        first = OpenRig(
            name=settings.rigs[0],
            object_name=settings.object_name,
            seed=settings.seed,
            speed=settings.speed,
            rate_hz=settings.rate_hz,
        )
        while self._last_message_s is None:  # set by the first update, or by the process's end
            await asyncio.sleep(_POLL_S)
        self.session.send_order(first)

    def close(self) -> None:
        """Stop the running job and end the process."""
        self._is_closing = True
        if self._process is not None:
            self._process.close()

    async def _report_interrupted_before(self) -> None:
        """Report the grasp that the end of the previous run has cut off, unless it was stored."""
        found = self.history.running
        if found is None:
            return
        recording = str((self.settings.folder / found.recording).resolve())
        has_grasp = partial(self.item_store.has_grasp, found.item_id, recording=recording)
        if await asyncio.get_running_loop().run_in_executor(None, has_grasp):
            self._cancel_grasp()
        else:
            self._report_interrupted(found)

    def _report_interrupted(self, found: Interruption) -> None:
        """Show on every screen and note in the audit that nothing of a grasp was stored."""
        devices, words = self.session.devices, self.session.words
        devices.interrupted = found
        devices.add_alarm(interruption_text(found, words))
        self.session.form.await_item(found.item_id, why=Unfinished.NOT_MEASURED)
        item = found.item_id or "no item"
        what = f"grasp of {item} interrupted, not stored (recording {found.recording})"
        record_event("palpate serve", what, level=logging.WARNING)

    def _disk_refusal(self) -> str:
        """Return why no grasp can be recorded; empty if it can."""
        free = shutil.disk_usage(self.settings.existing_folder).free
        return "" if free >= _MIN_FREE_BYTES else self.session.words("refusal.full")

    def _cancel_grasp(self, stopped: GraspOrder | None = None) -> None:
        """Note that a grasp ended without a result; `stopped`: its order, if a stop ended it."""
        source = self.session.devices.live.source
        try:
            if stopped is None or source is None:
                self.history.cancel_grasp()
            else:
                is_simulated = source.origin != "hardware"
                self.history.add(make_stopped_entry(stopped, is_simulated=is_simulated))
        except OSError as error:
            self._report_history("grasp", error)

    def state(self) -> Mapping[str, Any]:
        """Return the state document."""
        found = state_document(self.session) | {"station": self.settings.station}
        held, conversion = found["held"], self.settings.reference
        if isinstance(held, dict):
            measured = {} if conversion is None else held[conversion.measurement] or {}
            held["reference"] = conversion and conversion.convert(measured.get("value"))
        return found

    def result(self) -> tuple[int, GraspDocument | None]:
        """Return the number of finished grasps and the document of the last grasp."""
        return self._results, self._last_document

    async def grasp(
        self,
        driver: str,
        *,
        target_force_n: float | None,
        item_id: str,
        kind: str,
        stops: int | None,
        batch: str = "",
    ) -> str:
        """Start a grasp; return the name of its recording.

        Raises `CommandRefusedError` if it can't start now, `InputError` for an invalid value.
        """

        def order_grasp() -> str:
            """Order the grasp, unless the client's number of stops is another one."""
            order = self.grasp_order(
                target_force_n=target_force_n, item_id=item_id, kind=kind, batch=batch
            )
            with self.session.stop_lock:
                # A larger number is from before a restart.
                if stops is not None and stops != self.session.stops:
                    raise CommandRefusedError(
                        f"refused: a stop or a restart has occurred since you last read the state "
                        f"(stops {stops}, now {self.session.stops}); read it again, then resend "
                        "the command"
                    )
                self._run_for_driver(driver, partial(self.session.order, driver, order))
            return order.recording.name

        return await self._on_session_loop(order_grasp)

    async def release(self, driver: str) -> None:
        """Release the object, or open the hand.

        Raises `CommandRefusedError` if the release is refused now.
        """
        command = partial(self.session.release, driver)
        await self._on_session_loop(partial(self._run_for_driver, driver, command))

    async def take_over(self, driver: str) -> None:
        """Make this client the driver."""

        def take() -> None:
            self._join(driver)
            self.session.take_over(driver)

        await self._on_session_loop(take)

    async def leave(self, driver: str) -> None:
        """Leave the session, so that another client can drive."""
        await self._on_session_loop(partial(self.session.leave, driver))

    def renew(self, driver: str) -> None:
        """Extend the lease of a client; may be called from any thread."""
        self.session.renew(driver)

    def _join(self, driver: str) -> None:
        """Join the session as a client that drives from its first accepted command on."""
        self.session.join(driver, name=driver, leased=True)

    def _run_for_driver(self, driver: str, command: Callable[[], None]) -> None:
        """Join the session as this driver, and run a command."""
        self._join(driver)
        try:
            command()
        except InputError as error:
            raise CommandRefusedError(str(error)) from error

    async def _on_session_loop(self, command: Callable[[], _Answer]) -> _Answer:
        """Run a command on the session's loop; may be called from any loop."""

        async def work() -> _Answer:
            return command()

        if self.loop is None:
            raise CommandRefusedError("the devices are not open yet: try again in a moment")
        return await run_on(self.loop, work())

    async def stop(self, by: str = "a client", *, timeout_s: float = STOP_TIMEOUT_S) -> bool:
        """Stop the running job; return whether the device process confirmed it in time.

        `by`: name of the client, for the log.
        May be called from any event loop; it waits only for the device process.
        """
        updated = asyncio.Event()
        wake = partial(asyncio.get_running_loop().call_soon_threadsafe, updated.set)
        self._stop_waiters.add(wake)
        try:
            number = self.session.stop()
            async with asyncio.timeout(timeout_s):
                while self._stop_confirmed < number and not self._is_process_lost:
                    await updated.wait()
                    updated.clear()
        except TimeoutError:
            pass
        finally:
            self._stop_waiters.discard(wake)
        is_confirmed = self._stop_confirmed >= number
        what = "stop" if is_confirmed else "stop without a confirmation"
        record_event(by, what, level=logging.WARNING if is_confirmed else logging.ERROR)
        return is_confirmed

    def grasp_order(
        self,
        *,
        target_force_n: float | None,
        item_id: str = "",
        kind: str = "",
        batch: str = "",
    ) -> GraspOrder:
        """Return a grasp order with a new recording name.

        Raises
        ------
        InputError
            If the force is out of range, the item name or batch is invalid, or the kind is unknown.
        """
        check_target_force(target_force_n, name="the target force")
        if item_id:
            item_id = check_item(item_id)
        if batch:
            if not item_id:
                raise InputError(f"batch {batch!r}: a batch requires an item")
            batch = check_batch(batch)
        settings = self.settings
        limit = choose_limit(
            settings.damage,
            path=settings.damage_path,
            kind=kind or None,
            names={"damage": "a damage file (`palpate serve --damage FILE`)"},
        )
        return GraspOrder(
            target_force_n=target_force_n,
            recording=make_recording_path(self.settings.folder, "grasp"),
            item_id=item_id,
            batch=batch,
            limit=limit,
        )

    def rename(self, name: str, stem: str) -> None:
        """Rename a recording.

        Raises
        ------
        InputError
            If the recording is in use, or in the cases of `rename_recording`.
        """
        self._check_idle(name)
        renamed = rename_recording(self.settings.folder, name, stem)
        try:
            self.history.rename(name, renamed.name)
        except OSError as error:
            self.session.devices.trouble = (
                f"the recording was renamed, but the history still has the old name: {error}"
            )

    def delete(self, name: str) -> None:
        """Delete a recording.

        Raises
        ------
        InputError
            If the recording is in use, or in the cases of `delete_recording`.
        """
        self._check_idle(name)
        delete_recording(self.settings.folder, name)

    def _check_idle(self, name: str) -> None:
        if name in self.session.devices.files_in_use:
            raise InputError(f"{name} is in use: wait until its grasp, recording or replay ends")

    async def give_bin(self, item_id: str, name: str, *, by: str) -> None:
        """Store the bin that a person gives to an item, and show it.

        Raises `PalpateError` if the store can't be used.
        """
        labels = {str(About.BIN): name}
        change = partial(self.item_store.change, Item(item_id=item_id), labels=labels, by=by)
        await asyncio.get_running_loop().run_in_executor(None, change)
        record_event(by, f"gives {item_id} the bin {name}")
        await self.read_given_bins()

    async def watch_given_bins(self) -> None:
        """Take over the bins that people give, on this station or any other, until cancelled."""
        while True:
            await self.read_given_bins()
            await asyncio.sleep(_GIVEN_PERIOD_S)

    async def read_given_bins(self) -> None:
        """Show and count the bins that people have given instead of those of the grasps."""
        read = self.item_store.given_bins
        try:
            given = await asyncio.get_running_loop().run_in_executor(None, read)
        except PalpateError:
            return
        self.history.set_given_bins(given)
        devices, placed = self.session.devices, self.session.devices.placed
        name, _ = given.get(devices.item_id, ("", ""))
        if name and placed is not None and placed.bin is not None and placed.bin.name != name:
            self.session.form.end_item(devices.item_id)
            words, measured = self.session.words, placed.bin.name
            devices.why_default = words("why.corrected", measured=measured)
            bin_ = Bin(name=name, rule=None, probability=None, again=False, why=placed.bin.why)
            devices.placed = replace(placed, bin=bin_)

    def start_lot(self, name: str) -> None:
        """Count the items of another batch from now on."""
        self.session.devices.is_past = True
        try:
            self.history.start_lot(name)
        except OSError as error:
            self._report_history(name or "lot", error)

    def calibration_file(self) -> Path:
        """Return the rig's calibration file: named in the rig file, or in the folder."""
        rig = self.session.rig
        if rig is not None and rig.name.endswith(".toml"):
            named = find_calibration_file(Path(rig.name))
            if named is not None:
                return named
        name = "rig" if rig is None else f"{Path(rig.name).stem}-{rig.seed}"
        return self.settings.folder / f"calibration-{name}.json"

    @property
    def silent_s(self) -> float:
        """Time since the last message of the device process, seconds; 0 before the first."""
        return 0.0 if self._last_message_s is None else time.monotonic() - self._last_message_s

    def idle_texts(self) -> list[str]:
        """Return the texts of an idle page: last grasp, today's counts, calibration age."""
        source = self.session.devices.live.source
        texts = self.history.idle_texts()
        if source is not None and source.calibrated_at:
            texts.append(f"calibrated {age_text(source.calibrated_at)}")
        return texts

    def _place_measured(self, grasped: Grasped, order: GraspOrder) -> None:
        """Find the bin of the held object, and then report that it is measured."""
        if self._is_placed(order):
            self._placing = asyncio.ensure_future(self._place(grasped, order))
        else:
            self.session.devices.is_answered = True

    def _is_placed(self, order: GraspOrder) -> bool:
        """Return whether the grasp has a record or a bin."""
        has_source = self.session.devices.live.source is not None
        return has_source and (order.item_id != "" or self.settings.rules is not None)

    async def _place(self, grasped: Grasped, order: GraspOrder) -> Placement:
        """Decide on the bin once, and show it."""
        devices = self.session.devices
        source = devices.live.source
        assert source is not None
        place = partial(self.item_store.place, grasped, item_id=order.item_id, source=source)
        placement = await asyncio.get_running_loop().run_in_executor(None, place)
        if devices.order == order:
            devices.placed = placement.complete(grasped.document)
            devices.evidence, devices.is_answered = placement.evidence, True
            devices.why_default = why_default(placement, self.session.words)
            why = Unfinished.PROVISIONAL if devices.placed.needs_regrasp else None
            self.session.form.return_item(order, why=why)
        return placement

    def _finish_grasp(self, grasped: Grasped, order: GraspOrder) -> None:
        """Store a finished grasp and publish its result."""
        placing, self._placing = self._placing, None
        entry = make_entry(
            grasped,
            kind=outcome_kind(grasped.document),
            item_id=order.item_id,
            curve=list(self.session.devices.live.curve),
        )
        document = replace(
            grasped.document,
            item_id=order.item_id,
            recording=order.recording.name,
            ended_at=entry.ended_at,
            station=self.settings.station or "",
        )
        if (conversion := self.settings.reference) is not None:
            measured = getattr(document.result, conversion.measurement)
            value = None if measured is None else measured.value
            document = replace(document, reference=conversion.convert(value))
        if not self._is_placed(order):
            why = "the devices have no source" if order.item_id else NO_ITEM
            entry = replace(entry, stored=False if order.item_id else None)
            self._publish(entry, replace(document, stored=False, not_stored=why), order=order)
            return
        # The activity stays "grasping" until the result is published, because clients read the
        # result and the item at the end of the activity.
        self.session.devices.activity, self.session.devices.order = DeviceActivity.GRASPING, order
        # Without an answer nothing was placed so far.
        placing = placing or asyncio.ensure_future(self._place(grasped, order))
        self._task = asyncio.ensure_future(
            self._store_and_publish(placing, entry, document, order=order)
        )

    async def _store_and_publish(
        self,
        placing: asyncio.Future[Placement],
        entry: Entry,
        document: GraspDocument,
        *,
        order: GraspOrder,
    ) -> None:
        """Store a grasp with its bin, and then publish its result."""
        devices, source = self.session.devices, self.session.devices.live.source
        assert source is not None
        placement: Placement | None = None
        batch = order.batch or self.history.lot.name
        try:
            async with asyncio.timeout(_STORE_TIMEOUT_S):
                placement = await placing
                # Only an order that names a batch moves an item there from another one.
                if placement.batch is not None:
                    batch = order.batch or placement.batch
                add = partial(
                    self.item_store.add,
                    document,
                    placement=placement,
                    calibration=source.calibration,
                    batch=batch,
                )
                document = await asyncio.get_running_loop().run_in_executor(None, add)
        except TimeoutError:
            if placement is not None:
                document = placement.complete(document)
            elif self.settings.rules is not None:
                document = replace(document, is_sorted=True, no_bin=StoreFault.AWAY)
            why = StoreFault.AWAY if document.item_id else NO_ITEM
            document = replace(document, stored=False, not_stored=why)
        devices.placed = document
        is_stored = document.stored if document.item_id else None
        entry = replace(entry, batch=batch, stored=is_stored)
        self._publish(entry, document, order=order)
        if devices.activity is DeviceActivity.GRASPING:
            devices.mark_idle()

    def _publish(self, entry: Entry, document: GraspDocument, *, order: GraspOrder) -> None:
        """Add a grasp to the history, and publish its document."""
        devices, chosen, item = self.session.devices, document.bin, document.item
        again = document.needs_regrasp
        why = Unfinished.PROVISIONAL if again else None
        if document.result.outcome in REPEATED_OUTCOMES:
            why = Unfinished.NOT_MEASURED
        if document.item_id and document.not_stored:
            why = Unfinished.NOT_STORED
        self.session.form.return_item(order, why=why)
        devices.not_stored = document.not_stored
        entry = replace(
            entry,
            bin=None if chosen is None else chosen.name,
            again=None if chosen is None else again,
            probability=None if chosen is None else chosen.probability,
            why=document.no_bin or None if chosen is None else chosen.why,
            stage=None if item is None else item.stage,
            bruised=None if item is None else item.bruised,
        )
        words = self.session.words
        if document.not_stored and entry.item_id:
            note = store_note(devices, words)
            devices.add_alarm(words("alarm.item", item=entry.item_id, text=note))
        try:
            self.history.add(entry)
        except OSError as error:
            self._report_history(entry.recording, error)
        stored = document.not_stored and f", not stored: {document.not_stored}"
        text = f"{document.recording} of {document.item_id or 'no item'}: {document.result.outcome}"
        LOG.log(logging.WARNING if stored else logging.INFO, "%s%s", text, stored)
        self._results += 1
        self._last_document = document
        for listener in self.on_result:
            listener(document)

    def _report_history(self, what: str, error: OSError) -> None:
        """Report that the history could not be written."""
        LOG.error("%s: %s", what, error)
        self.session.devices.add_alarm(self.session.words("badge.history"))

    def _send(self, message: Order | Request) -> None:
        if isinstance(message, GraspOrder):
            try:
                self.history.begin_grasp(message.recording.name, item_id=message.item_id)
            except OSError as error:
                self._report_history(message.recording.name, error)
        if self._process is not None:
            self._process.send(message)

    def receive_update(self, update: Update | DevicesLost) -> None:
        """Process an update of the device process, on the receiving thread."""
        self._last_message_s = time.monotonic()
        if isinstance(update, Update):
            stops = [note.number for note in update.notes if isinstance(note, StopConfirmed)]
            self._stop_confirmed = max([self._stop_confirmed, *stops])
        self._is_process_lost = isinstance(update, DevicesLost)
        if self._is_process_lost and not self._is_closing:
            LOG.error("the device process has ended; restart palpate serve")
        for wake in tuple(self._stop_waiters):
            wake()
        loop = self.loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._apply_update, update)

    def _apply_update(self, update: Update | DevicesLost) -> None:
        devices = self.session.devices
        is_cut = isinstance(update, DevicesLost) and devices.grasped is None
        devices.apply_update(update)
        if is_cut and not self._is_closing and self.history.running is not None:
            self._report_interrupted(self.history.running)
        for note in update.notes if isinstance(update, Update) else ():
            match note:
                case Trouble(text=text) if text:
                    LOG.error("%s", text)
                case OrderEnded(stopped=False, trouble=text) if text:
                    LOG.error("%s: %s", describe_order(note.order), text)
            match note:
                case OrderEnded(order=GraspOrder() as order, found=None, stopped=stopped):
                    self._cancel_grasp(order if stopped else None)
                    self.session.form.return_item(order, why=Unfinished.NOT_MEASURED)


def age_text(made_at: str) -> str:
    """Return the age of an ISO 8601 time, such as ``3 days ago`` or ``today``."""
    days = (datetime.now(UTC) - datetime.fromisoformat(made_at).astimezone(UTC)).days
    return "today" if days < 1 else f"{count_of(days, 'day')} ago"
