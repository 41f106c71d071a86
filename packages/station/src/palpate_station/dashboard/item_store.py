"""Read and write the items of the store for the page.

The store is opened for each query and each grasp, because it may be unreachable and is shared with
other programs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from functools import partial
from typing import TypeVar

from palpate.errors import InputError, PalpateError, StoreAwayError, StoreError, StoreMissingError
from palpate.grasp.document import GraspDocument, ItemFacts
from palpate_station.bruise.model import BRUISED, SOUND
from palpate_station.dashboard.audit import LOG
from palpate_station.dashboard.messages import FrameSource, Grasped
from palpate_station.dashboard.panel_html import draw_panel_svg
from palpate_station.grasp_record import make_grasp_record
from palpate_station.identify.identifier import Identifier
from palpate_station.identify.kinds import NO_KINDS, learn_kinds
from palpate_station.line.results import NO_ITEM
from palpate_station.records import About, Grasp, Item, Source, Verdict, check_printable
from palpate_station.ripeness.history import (
    firmness_history,
    judge_ripeness,
    last_drive,
    learn_rule,
)
from palpate_station.ripeness.stages import RIPE, STAGES
from palpate_station.sorting.conditions import OneOf
from palpate_station.sorting.placement import Placement
from palpate_station.sorting.rules import RuleBook, decide
from palpate_station.sorting.run import Sorted, bin_verdict, combine_evidence
from palpate_station.store import Store
from palpate_station.store.engine import StoreDiskError, store_url
from palpate_station.store.item_history import (
    AWAY_NOTE,
    ItemHistory,
    is_provisional,
    item_facts,
    read_item_histories,
    read_item_history,
)
from palpate_station.store.labels import add_label
from palpate_station.store.outbox import SHARED
from palpate_station.store.sender import Sender

_Read = TypeVar("_Read")
#: Caption and axis label of the measurements over time on an item's page.
_FIGURES = {
    "firmness": ("Firmness over time", "firmness (of 100)"),
    "settled_percent": ("Settled change over time", "settled change (%)"),
}


class StoreFault(StrEnum):
    """A fault of the store in few words for every screen; the log has the details."""

    AWAY = "the store does not answer"
    DISK = "the disk of the store is full or has failed"
    UNUSABLE = "the store can't be used"


class ItemStore:
    """Reads and writes a store of items.

    Parameters
    ----------
    where : str or None
        Path or URL for `palpate_station.store.Store.open`.
    rules : RuleBook or None
        Sorting rules that assign each item to a bin.
    station : str or None
        Name of this station, stored with each grasp.
    """

    def __init__(
        self, where: str | None, *, rules: RuleBook | None = None, station: str | None = None
    ) -> None:
        self._where, self._rules, self._station = where, rules, station
        self._sender: Sender | None = None
        #: Reason why the last record was not stored or read; empty after a success.
        self.trouble = ""

    def place(self, grasped: Grasped, *, item_id: str, source: FrameSource) -> Placement:
        """Return the record and the bin of a measured item, from all grasps of the item.

        Nothing is stored: the grasp has not ended yet.
        """
        grasp = make_grasp_record(
            grasped.document.result,
            # A record requires a name, but a grasp without a name is never stored.
            item_id=item_id or "-",
            observations=grasped.observations,
            layout=source.layout,
            rig=source.name,
            drive="width" if source.gripper is None else source.gripper.drive,
            origin=source.origin,
            calibration=source.calibration,
            recording=grasped.recording,
            station=self._station,
            closing=grasped.closing,
        )
        found = Placement(grasp=grasp, is_sorted=self._rules is not None)
        rules = self._rules
        try:
            stored = self._read(
                lambda store: _StoredItem.read(store, item_id, rules=rules)
            ) or _StoredItem(class_fault=NO_KINDS)
            if item_id:
                facts = item_facts(item_id, kind=stored.kind, verdicts=stored.verdicts)
                found = replace(
                    found,
                    item=facts,
                    away=stored.away,
                    batch=stored.batch,
                    sorted_as=stored.final_bin,
                    given=stored.given_bin,
                )
            if rules is None:
                return found
            grasps = (*stored.grasps, grasp)
            evidence = combine_evidence(
                grasps,
                identifier=stored.identifier,
                kind=stored.kind,
                verdicts=stored.verdicts,
                class_fault=stored.class_fault,
            )
        except PalpateError as error:
            unread = ItemFacts(id=item_id) if item_id else None
            return replace(found, item=unread, no_bin=self._report(error))
        done = Sorted(
            item_id=item_id,
            decision=decide(rules, evidence),
            identity=evidence.identity,
            size_mm=evidence.size_mm,
            grasps=grasps,
            grasping_s=0.0,
        )
        return replace(found, done=done)

    def add(
        self, document: GraspDocument, *, placement: Placement, calibration: str, batch: str = ""
    ) -> GraspDocument:
        """Store a finished grasp and its bin; return its document.

        `batch`: the item's batch; empty to leave it unchanged.

        The local store is written, and then sent to a shared store. A grasp without a name is not
        stored.
        """
        completed = replace(placement.complete(document), stored=False, not_stored=NO_ITEM)
        if not document.item_id:
            return completed
        result = document.result
        grasp = replace(
            placement.grasp,
            outcome=result.outcome,
            decision_time_s=result.decision_time_s,
            peak_force_n=result.peak_force_n,
        )
        try:
            with Store.open(self._where) as store:
                store.add_grasp(grasp, calibration=calibration)
                if batch:
                    store.add_item(Item(item_id=document.item_id, batch=batch))
                if completed.bin is not None and placement.done is not None:
                    given = bin_verdict(placement.done, given_at=datetime.now(UTC))
                    # As on the screens and in the published result.
                    details = {**given.details, "provisional": completed.bin.again}
                    shown = replace(
                        given,
                        text=completed.bin.name,
                        probability=completed.bin.probability,
                        explanation=completed.bin.why,
                        details=details,
                    )
                    store.add_verdict(shown)
        except (PalpateError, OSError) as error:
            return replace(completed, not_stored=self._report(error))
        self.trouble = ""
        self._send()
        return replace(completed, stored=True, not_stored="", grasp_id=grasp.grasp_id)

    def watch_shared(self) -> None:
        """Send waiting records to a shared store, and check from now on whether it answers."""
        self._send()

    def _send(self) -> None:
        """Wake the sender, if there is a shared store."""
        if store_url(self._where).get_backend_name() == "sqlite":
            return
        if self._sender is None:
            self._sender = Sender(self._where, on_error=LOG.warning, on_return=LOG.info)
        self._sender.wake()

    @property
    def shared_fault(self) -> StoreFault | None:
        """Fault of the shared store; None without one, or without a shared store."""
        fault = None if self._sender is None else self._sender.fault
        return None if fault is None else _store_fault(fault)

    @property
    def shared_silence_s(self) -> float | None:
        """Time since the last answer of the shared store, seconds; None without a shared store."""
        return None if self._sender is None else time.monotonic() - self._sender.answered_s

    def waiting(self, receiver: str = SHARED) -> int | None:
        """Return the number of records that wait for a receiver; None if it can't be read."""
        try:
            return self._read(lambda store: store.waiting(receiver)) or 0
        except PalpateError:
            return None

    def _report(self, error: Exception) -> StoreFault:
        """Log a fault of the store; return its words for the screens."""
        LOG.error("%s", error)
        fault = _store_fault(error)
        self.trouble = str(fault)
        return fault

    def pages(self, *, limit: int) -> tuple[ItemHistory, ...]:
        """Return the histories of the newest items, newest first; empty without a store.

        Raises
        ------
        PalpateError
            If the store can't be used or does not answer.
        """
        return self._read(lambda store: read_item_histories(store, store.items(limit=limit))) or ()

    def change(self, item: Item, *, labels: Mapping[str, str], by: str) -> ItemHistory:
        """Add an item or update its fields, add labels by a person, and return its history.

        Raises
        ------
        PalpateError
            If a label is invalid, or the store can't be used.
        """
        # Before anything is written.
        for about, text in labels.items():
            check_printable(text, what=about)
            known = self._label_words(About(about))
            if known and text not in known:
                raise InputError(f"{about} {text[:40]!r}: must be one of {', '.join(known)}")
        with self._open() as store:
            store.add_item(item)
            for about, text in labels.items():
                add_label(store, item.item_id, about=About(about), text=text, by=by)
            self._send()
            return read_item_history(store, item.item_id)

    def _label_words(self, about: About) -> tuple[str, ...]:
        """Return the words for a label; empty if it may be any text."""
        rules = () if self._rules is None else self._rules.rules
        if about is About.RIPENESS:
            named = (one for rule in rules for one in rule.conditions if one.key == about)
            own = [name for one in named if isinstance(one, OneOf) for name in sorted(one.names)]
            return tuple(dict.fromkeys([*STAGES, *own]))
        if about is About.BRUISE:
            return BRUISED, SOUND
        return self._rules.bins if about is About.BIN and self._rules is not None else ()

    def page(self, item_id: str) -> ItemHistory:
        """Return the history of an item.

        Raises
        ------
        PalpateError
            If the item does not exist or the store can't be used.
        """
        found = self._read(lambda store: read_item_history(store, item_id))
        if found is None:
            raise InputError(f"no item {item_id!r}: the store is empty")
        return found

    def figures_html(self, page: ItemHistory) -> str:
        """Return the figures of an item as HTML: measurements over time, and ripening.

        Raises
        ------
        PalpateError
            If the store can't be used or does not answer, or matplotlib is not installed.
        """
        from palpate_station.plots.item_history import history_figure

        drawn = {
            caption: draw_panel_svg(partial(history_figure, page, name, label=unit), label=caption)
            for name, (caption, unit) in _FIGURES.items()
            if any(
                name in grasp.measurements and grasp.measurements[name].value is not None
                for grasp in page.grasps
            )
        }
        drawn["Ripening"] = self._read(lambda store: _ripening(store, page)) or ""
        return "".join(f"<h3>{caption}</h3>{svg}" for caption, svg in drawn.items() if svg)

    def has_grasp(self, item_id: str, *, recording: str) -> bool:
        """Return whether the store has the grasp of a recording; False if it can't be read."""

        def find(store: Store) -> bool:
            return any(one.recording == recording for one in store.grasps_of(item_id))

        try:
            return bool(self._read(find))
        except PalpateError:
            return False

    def check_usable(self) -> None:
        """Raise `PalpateError` if the store can't be used; it may be missing."""
        self._read(lambda store: None)

    def given_bins(self) -> dict[str, tuple[str, str]]:
        """Return the last bin that a person gave to each item, and when.

        Raises
        ------
        PalpateError
            If the store can't be used or does not answer.
        """
        found = self._read(lambda store: store.verdicts(About.BIN, source=Source.PERSON)) or ()
        return {one.item_id: (one.text, one.given_at.isoformat()) for one in found}

    def learnt_kinds(self) -> tuple[str, ...]:
        """Return the kinds that can be identified; empty without labelled items.

        Raises
        ------
        PalpateError
            If the store can't be used.
        """
        try:
            found = self._read(learn_kinds)
        except InputError:
            return ()
        return () if found is None else found.kinds

    def known_stages(self) -> tuple[str, ...]:
        """Return the built-in stages of ripeness, and those that items were labelled with."""
        verdicts = (
            self._read(lambda store: store.verdicts(About.RIPENESS, source=Source.PERSON)) or ()
        )
        return (*STAGES, *(one.text for one in verdicts))

    def _read(self, read: Callable[[Store], _Read]) -> _Read | None:
        """Read from the store; None without a store."""
        try:
            with self._open(create=False) as store:
                return read(store)
        except StoreMissingError:
            return None

    @contextmanager
    def _open(self, *, create: bool = True) -> Iterator[Store]:
        """Open the store; refusals don't have its address, because clients get them."""
        with Store.open(self._where, create=create) as store:
            store.away = self._away
            try:
                yield store
            except InputError as error:
                text = str(error)
                for name in (store.name, store.local_name):
                    text = text.removeprefix(f"{name}: ")
                raise InputError(text) from error

    @property
    def _away(self) -> StoreAwayError | None:
        """Error of a shared store that does not answer; each item would wait for its timeout."""
        return None if self._sender is None else self._sender.away


@dataclass(frozen=True, slots=True, kw_only=True)
class _StoredItem:
    """The stored record of an item; empty for a new or unnamed one."""

    kind: str | None = None
    grasps: tuple[Grasp, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    #: Classifier of kinds, if the rules require an unknown kind.
    identifier: Identifier | None = None
    #: Why there is no classifier, although the rules require one.
    class_fault: str = ""
    #: The item's batch, empty without one; None if it has no grasps.
    batch: str | None = None
    #: Reason why grasps of other stations may be missing; empty if the shared store answered.
    away: str = ""

    @property
    def final_bin(self) -> str:
        """The bin from the item's grasps, unless it is provisional; empty without one."""
        last = self._last_bin(Source.PALPATE)
        return "" if last is None or is_provisional(last) else last.text

    @property
    def given_bin(self) -> Verdict | None:
        """The bin that a person has given; None without one."""
        return self._last_bin(Source.PERSON)

    def _last_bin(self, source: Source) -> Verdict | None:
        bins = [one for one in self.verdicts if one.about is About.BIN and one.source is source]
        return max(bins, key=lambda one: one.given_at, default=None)

    @classmethod
    def read(cls, store: Store, item_id: str, *, rules: RuleBook | None) -> _StoredItem:
        """Read an item from the store."""
        items = store.find_items([item_id]) if item_id else ()
        kind = items[0].kind if items else None
        identifier, class_fault = None, ""
        if kind is None and rules is not None and rules.has_condition("class"):
            try:
                identifier = learn_kinds(store, without=item_id)
            except InputError:
                # An item of a line always gets a bin, also before the first labels.
                class_fault = NO_KINDS
        grasps = store.grasps_of(item_id) if items else ()
        return cls(
            kind=kind,
            grasps=grasps,
            batch=(items[0].batch or "") if grasps else None,
            verdicts=store.verdicts_of(item_id) if items else (),
            identifier=identifier,
            class_fault=class_fault,
            away="" if store.away is None else AWAY_NOTE,
        )


def error_text(error: PalpateError) -> str:
    """Return an error for the screens, which never show the address or the error of a database."""
    return str(_store_fault(error) if isinstance(error, StoreError) else error)


def _store_fault(error: Exception) -> StoreFault:
    if isinstance(error, StoreDiskError | OSError):
        return StoreFault.DISK
    return StoreFault.AWAY if isinstance(error, StoreAwayError) else StoreFault.UNUSABLE


def _ripening(store: Store, page: ItemHistory) -> str:
    """Draw an item's ripening with the curves of labelled items of the same kind."""
    item_id, kind, grasps = page.item.item_id, page.item.kind, page.grasps
    if kind is None:
        return ""
    try:
        drive = last_drive(grasps, item_id=item_id)
        rule = learn_rule(store, kind=kind, drive=drive, stages=STAGES)
        history = firmness_history(grasps, item_id=item_id, drive=drive)
        ripeness = judge_ripeness(history, rule=rule, ripe=RIPE)
    except InputError:  # no labelled item of this kind, or no firmness measurement of this item
        return ""
    from palpate_station.plots.ripeness import item_figure

    return draw_panel_svg(
        partial(item_figure, history, ripeness, rule=rule),
        label=f"Ripening of {item_id} with its forecast",
    )
