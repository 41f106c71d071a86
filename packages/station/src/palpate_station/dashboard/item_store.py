"""Read and write the items of the store for the page.

The store is opened for each query and each grasp, because it may be unreachable and is shared with
other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

from palpate.errors import InputError, PalpateError, StoreError
from palpate.grasp.document import Bin, GraspDocument, ItemFacts
from palpate.grasp.estimator import Observation
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.recording import RecordingReader
from palpate.recording.replay import observations
from palpate_station.dashboard.messages import FrameSource
from palpate_station.dashboard.panel_html import draw_panel_svg
from palpate_station.line.results import NO_ITEM

if TYPE_CHECKING:
    from palpate_station.identify.identifier import Identifier
    from palpate_station.records import Grasp, Item, Verdict
    from palpate_station.sorting.rules import RuleBook
    from palpate_station.store import Store
    from palpate_station.store.item_history import ItemHistory
    from palpate_station.store.sender import Sender

_Read = TypeVar("_Read")
#: Caption and axis label of the measurements over time on an item's page.
_FIGURES = {
    "firmness": ("Firmness over time", "firmness (of 100)"),
    "settled_percent": ("Settled change over time", "settled change (%)"),
}


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
        #: Reason why the last record was not stored; empty after a success.
        self.trouble = ""

    def sort_grasp(
        self,
        document: GraspDocument,
        *,
        source: FrameSource,
        recording: Path | None = None,
        closing: Mapping[str, Measurement] = MappingProxyType({}),
    ) -> GraspDocument:
        """Return the document with its item and bin, based on all grasps of the item.

        A grasp of a named item with a recording is first written to the local store, which is then
        sent to a shared store. `closing` contains the measurements of the closing motion by their
        names in the store.
        """
        if self._rules is None and not document.item_id:
            return replace(document, stored=False, not_stored=NO_ITEM)
        from palpate_station.grasp_record import make_grasp_record
        from palpate_station.store import Store
        from palpate_station.store.sender import Sender

        try:
            grasp = make_grasp_record(
                document.result,
                # A record requires a name, but a grasp without a name is never stored.
                item_id=document.item_id or "-",
                observations=() if recording is None else _read_observations(recording),
                layout=source.layout,
                rig=source.name,
                drive="width" if source.gripper is None else source.gripper.drive,
                origin=source.origin,
                calibration=source.calibration,
                recording=recording,
                station=self._station,
                closing=closing,
            )
            if recording is not None:
                with Store.open(self._where) as store:
                    store.add_grasp(grasp, calibration=source.calibration)
                self.trouble = ""
        except (PalpateError, OSError) as error:
            self.trouble = str(error)
            return self.place_without_store(document, why=self.trouble)
        placed = self._choose_bin(grasp, document, is_stored=recording is not None)
        if recording is None:
            return placed
        if self._sender is None:
            self._sender = Sender(self._where)
        self._sender.wake()
        return replace(placed, stored=True, not_stored="")

    def _choose_bin(
        self, grasp: Grasp, document: GraspDocument, *, is_stored: bool
    ) -> GraspDocument:
        """Apply the rules to the item; store the decision if the grasp is stored."""
        from palpate_station.sorting.rules import decide
        from palpate_station.sorting.run import Sorted, bin_verdict, combine_evidence
        from palpate_station.store import Store

        rules, item_id = self._rules, document.item_id
        why = "" if item_id else NO_ITEM
        placed = replace(document, is_sorted=rules is not None, stored=False, not_stored=why)
        try:
            stored = (
                self._read(lambda store: _StoredItem.read(store, item_id, rules=rules))
                or _StoredItem()
            )
            if item_id:
                placed = replace(placed, item=stored.facts(item_id))
            if rules is None:
                return placed
            grasps = stored.grasps if is_stored else (*stored.grasps, grasp)
            evidence = combine_evidence(
                grasps, identifier=stored.identifier, kind=stored.kind, verdicts=stored.verdicts
            )
            decision = decide(rules, evidence)
            if grasp.outcome is not Outcome.HELD:
                return placed
            if is_stored:
                done = Sorted(
                    item_id=item_id,
                    decision=decision,
                    identity=evidence.identity,
                    size_mm=evidence.size_mm,
                    grasps=grasps,
                    grasping_s=0.0,
                )
                with Store.open(self._where) as store:
                    store.add_verdict(bin_verdict(done, given_at=datetime.now(UTC)))
        except PalpateError as error:
            return self.place_without_store(document, why=str(error))
        chosen = Bin(
            name=decision.bin,
            rule=None if decision.rule is None else decision.rule.line,
            probability=decision.probability,
            # Grasps without a name are not combined, so another one would not help.
            again=decision.needs_regrasp and item_id != "",
            why=f"{decision.why} ({stored.away})" if stored.away else decision.why,
        )
        return replace(placed, bin=chosen)

    def place_without_store(self, document: GraspDocument, *, why: str) -> GraspDocument:
        """Return the document without a bin if the store can't be used, with the reason."""
        item_id = document.item_id
        return replace(
            document,
            item=ItemFacts(id=item_id) if item_id else None,
            is_sorted=self._rules is not None,
            no_bin=why,
            stored=False,
            not_stored=(self.trouble or why) if item_id else NO_ITEM,
        )

    def pages(self, *, limit: int) -> tuple[ItemHistory, ...]:
        """Return the histories of the newest items, newest first; empty without a store.

        Raises
        ------
        PalpateError
            If the store can't be used or does not answer.
        """
        from palpate_station.store.item_history import read_item_histories

        return self._read(lambda store: read_item_histories(store, store.items(limit=limit))) or ()

    def change(self, item: Item, *, labels: Mapping[str, str], by: str) -> ItemHistory:
        """Add an item or update its fields, add labels by a person, and return its history.

        Raises
        ------
        PalpateError
            If a label is invalid, or the store can't be used.
        """
        from palpate_station.records import About
        from palpate_station.store import Store
        from palpate_station.store.item_history import read_item_history
        from palpate_station.store.labels import add_label

        with Store.open(self._where) as store:
            store.add_item(item)
            for about, text in labels.items():
                add_label(store, item.item_id, about=About(about), text=text, by=by)
            store.try_send()
            return read_item_history(store, item.item_id)

    def page(self, item_id: str) -> ItemHistory:
        """Return the history of an item.

        Raises
        ------
        PalpateError
            If the item does not exist or the store can't be used.
        """
        from palpate_station.store.item_history import read_item_history

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

    def check_usable(self) -> None:
        """Raise `PalpateError` if the store can't be used; it may be missing."""
        self._read(lambda store: None)

    def _read(self, read: Callable[[Store], _Read]) -> _Read | None:
        """Read from the store; None without a store."""
        from palpate_station.store import Store

        try:
            store = Store.open(self._where, create=False)
        except StoreError as error:
            if "no such file" in str(error):
                return None
            raise
        with store:
            return read(store)


@dataclass(frozen=True, slots=True, kw_only=True)
class _StoredItem:
    """The stored record of an item; empty for a new or unnamed one."""

    kind: str | None = None
    grasps: tuple[Grasp, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    #: Classifier of kinds, if the rules require an unknown kind.
    identifier: Identifier | None = None
    #: Reason why grasps of other stations may be missing; empty if the shared store answered.
    away: str = ""

    @classmethod
    def read(cls, store: Store, item_id: str, *, rules: RuleBook | None) -> _StoredItem:
        """Read an item from the store."""
        from palpate_station.identify.kinds import learn_kinds

        items = store.find_items([item_id]) if item_id else ()
        kind = items[0].kind if items else None
        is_guessed = kind is None and rules is not None and rules.has_condition("class")
        return cls(
            kind=kind,
            grasps=store.grasps_of(item_id) if items else (),
            verdicts=store.verdicts_of(item_id) if items else (),
            identifier=learn_kinds(store, without=item_id) if is_guessed else None,
            away="" if store.away is None else str(store.away),
        )

    def facts(self, item_id: str) -> ItemFacts:
        """Return `item` of the grasp document."""
        from palpate_station.store.item_history import item_facts

        return item_facts(item_id, kind=self.kind, verdicts=self.verdicts)


def _read_observations(recording: Path) -> list[Observation]:
    with RecordingReader(recording) as reader:
        return [
            Observation(frame=frame, gripper=state)
            for frame, state in observations(reader)
            if state is not None
        ]


def _ripening(store: Store, page: ItemHistory) -> str:
    """Draw an item's ripening with the curves of labelled items of the same kind."""
    from palpate_station.ripeness.history import (
        firmness_history,
        judge_ripeness,
        last_drive,
        learn_rule,
    )
    from palpate_station.ripeness.stages import RIPE, STAGES

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
