"""The settings of the next grasp, and the item that it is for."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from palpate.errors import InputError
from palpate_station.dashboard.messages import GraspOrder
from palpate_station.dashboard.words import Words
from palpate_station.line.gs1 import LabelError, read_label
from palpate_station.records import Item, check_printable

#: Letters of a long name that a small screen shows: its end is the serial number.
_TAIL_LETTERS = 12


def short_name(item_id: str, *, letters: int = _TAIL_LETTERS) -> str:
    """Return the end of a long name.

    >>> short_name("A17"), short_name("(01)04012345000016(21)A17")
    ('A17', '…00016(21)A17')
    """
    return f"…{item_id[-letters:]}" if len(item_id) > letters + 1 else item_id


def check_item(text: str) -> str:
    """Return the item identifier of a typed or scanned text; spaces after it are padding.

    Raises `InputError` if the label is damaged, or the text can't be a name.
    """
    item_id = Item(item_id=read_label(text.rstrip(" "))).item_id
    if re.match(r"(?i)https?://", item_id):
        raise LabelError(
            f"{item_id[:60]!r}: the address of a web page is no name of an item; "
            "use the item's label",
            step="next.label_address",
        )
    return item_id


def check_batch(text: str) -> str:
    """Return the name of a batch; spaces after it are padding.

    Raises `InputError` if the text can't be a name.
    """
    batch = text.rstrip(" ")
    check_printable(batch, what="batch")
    return batch


class Unfinished(StrEnum):
    """Why an item must be grasped again before the next one; the key of its text."""

    PROVISIONAL = "item.unfinished"
    NOT_STORED = "item.not_stored"
    NOT_MEASURED = "item.not_measured"


@dataclass(slots=True)
class GraspForm:
    """Settings of the next grasp, shared by all pages."""

    #: Target grip force; None for a gentle squeeze.
    target_force_n: float | None = None
    #: Name of the item; empty if the grasp is not stored. Each grasp takes the name, so that the
    #: next object is not stored under the same name, and returns it if the same item is to be
    #: grasped again.
    item_id: str = ""
    #: Name of the last grasped item.
    last_item_id: str = ""
    #: Kind of produce, for its damage limit; empty if unknown.
    kind: str = ""
    #: The last grasp ordered with these settings.
    ordered: GraspOrder | None = None
    #: Whether the name is that of the last grasp, returned by it.
    is_returned: bool = False
    #: Whether a grasp without a name was refused, so that the last verdict is not its.
    is_refused: bool = False
    #: The item that is not finished, and why; empty without one.
    pending: str = ""
    why: Unfinished | None = None
    #: Returns bin and time of an item that was already sorted; empty for other items.
    find_sorted: Callable[[str], tuple[str, str] | None] = lambda name: None
    #: Name of a sorted item that the user wants to measure again.
    _confirmed: str = ""
    #: Name that was taken at the end of a scan, and not grasped yet.
    _scanned: str = ""
    #: Name that was last refused at the end of a scan, and whether a name was entered since then.
    _asked: str = ""
    _is_entered: bool = False
    #: Whether a grasp has the name of the last item, and its reason to return it that the user has
    #: overruled.
    _is_taken: bool = False
    _given_up: Unfinished | None = None

    @property
    def label_fault(self) -> InputError | None:
        """Why the name can't be the name of an item; None if it can, or without a name."""
        try:
            if self.item_id:
                check_item(self.item_id)
        except InputError as error:
            return error
        return None

    def set_item(self, text: str) -> None:
        """Set the name that a user has typed or scanned."""
        if text != self.item_id:
            is_same = not self._is_taken and _name_of(text) == self.pending
            self.item_id, self.is_returned, self.is_refused = text, is_same and text != "", False
            self._is_entered = True
        if not text:
            self._give_up()
            self._scanned = ""

    def repeat_item(self) -> None:
        """Set the name of the last grasped item, which may be sorted already."""
        self.set_item(self.last_item_id)
        self._confirmed = self._scanned = _name_of(self.item_id)

    def find_doubt(self, words: Words) -> str:
        """Return why the name is not taken before it is scanned a second time; else empty."""
        name = _name_of(self.item_id)
        if not name or self.is_returned:
            return ""
        first, why = self._scanned, "item.scanned"
        if self.why is not None and self.pending:
            first, why = self.pending, self.why
        if first and name != first and not self._is_taken:
            return words(why, item=short_name(first), other=short_name(name))
        found = None if name == self._confirmed else self.find_sorted(name)
        if found is None:
            return ""
        return words("item.sorted", item=short_name(name), bin=found[0], at=found[1])

    def end_scan(self, words: Words) -> str:
        """Take the entered name; return why it is not taken, or empty.

        A second scan of the same name overrules the doubt. Until then no grasp may take the name.
        """
        doubt, is_second = self.find_doubt(words), self.item_id == self._asked and self._is_entered
        if doubt and is_second:
            if not self._give_up():
                self._confirmed = _name_of(self.item_id)
            doubt = self.find_doubt(words)
        self._asked, self._is_entered = self.item_id if doubt else "", False
        if not doubt:
            # As it will be stored: a scanned label has a longer text.
            self.item_id = self._scanned = _name_of(self.item_id)
        return doubt

    def take_item(self, order: GraspOrder) -> None:
        """Take the name for an ordered grasp."""
        self.last_item_id = self.item_id or self.last_item_id
        self.item_id, self.is_returned, self.is_refused, self.ordered = "", False, False, order
        self._is_taken, self._given_up, self._confirmed, self._scanned = True, None, "", ""

    def return_item(self, order: GraspOrder, *, why: Unfinished | None) -> None:
        """Return the name for another grasp of the item, or withdraw it.

        `why`: reason why the item is not finished; None if it is. A name that was scanned since the
        grasp is retained; if the item is not finished, it is then in doubt.
        """
        if order != self.ordered:
            if why is None:
                # Another client has finished the item.
                self.end_item(order.item_id)
            return
        if why is not None and why is self._given_up:
            return
        self._is_taken = False
        if why is not None:
            self.await_item(order.item_id, why=why)
            if _name_of(self.item_id) in ("", order.item_id):
                self.item_id, self.is_returned = self.item_id or order.item_id, True
            return
        self.pending, self.why = "", None
        if self.is_returned:
            self.item_id, self.is_returned = "", False

    def await_item(self, item_id: str, *, why: Unfinished) -> None:
        """Expect the grasp of an item before any other; empty for an item without a name."""
        self.pending, self.why = item_id, why

    def end_item(self, item_id: str) -> None:
        """End an item if it is unfinished: a person or another client has decided on it."""
        if item_id and item_id == self.pending and self._give_up() and self.is_returned:
            self.item_id, self.is_returned = "", False

    def _give_up(self) -> bool:
        """End the item that comes first as it is; return whether there was one."""
        if self._is_taken or not (self.pending or self._scanned):
            return False
        self._given_up, self.pending, self.why, self._scanned = self.why, "", None, ""
        return True


def _name_of(text: str) -> str:
    """Return the item of a text, or the text of a damaged label."""
    try:
        return check_item(text) if text else ""
    except InputError:
        return text
