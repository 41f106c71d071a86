"""The settings of the next grasp, and the item that it is for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from palpate.errors import InputError
from palpate_station.dashboard.messages import GraspOrder
from palpate_station.dashboard.words import Words
from palpate_station.line.gs1 import read_label
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
    return Item(item_id=read_label(text.rstrip(" "))).item_id


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
    #: Name that was last refused at the end of a scan, and whether a name was entered since then.
    _asked: str = ""
    _is_entered: bool = False
    #: Whether a grasp has the name of the last item, and its reason to return it that the user has
    #: overruled.
    _is_taken: bool = False
    _given_up: Unfinished | None = None

    @property
    def label_fault(self) -> str:
        """Why the name can't be the name of an item; empty if it can, or without a name."""
        try:
            if self.item_id:
                check_item(self.item_id)
        except InputError as error:
            return str(error)
        return ""

    def set_item(self, text: str) -> None:
        """Set the name that a user has typed or scanned."""
        if text != self.item_id:
            is_same = self.why is not None and not self._is_taken and _name_of(text) == self.pending
            self.item_id, self.is_returned, self.is_refused = text, is_same, False
            self._is_entered = True
        if not text:
            self._give_up()

    def repeat_item(self) -> None:
        """Set the name of the last grasped item, which may be sorted already."""
        self.set_item(self.last_item_id)
        self._confirmed = _name_of(self.item_id)

    def find_doubt(self, words: Words) -> str:
        """Return why the name is not taken before it is scanned a second time; else empty."""
        name = _name_of(self.item_id)
        if not name or self.is_returned:
            return ""
        if self.why is not None and not self._is_taken and name != self.pending:
            return words(self.why, item=short_name(self.pending), other=short_name(name))
        found = None if name == self._confirmed else self.find_sorted(name)
        if found is None:
            return ""
        return words("item.sorted", item=short_name(name), bin=found[0], at=found[1])

    def end_scan(self, words: Words) -> str:
        """Take the entered name; return why it is not taken, or empty.

        A second scan of the same name overrules the doubt. An unfinished item stays the next one.
        """
        doubt, is_second = self.find_doubt(words), self.item_id == self._asked and self._is_entered
        if doubt and is_second:
            if self.why is not None and not self._is_taken:
                self._give_up()
            else:
                self._confirmed = _name_of(self.item_id)
            doubt = self.find_doubt(words)
        self._asked, self._is_entered = self.item_id if doubt else "", False
        if doubt and self.why is not None and not self._is_taken:
            self.item_id, self.is_returned = self.last_item_id, True
        return doubt

    def take_item(self, order: GraspOrder) -> None:
        """Take the name for an ordered grasp."""
        self.last_item_id = self.item_id or self.last_item_id
        self.item_id, self.is_returned, self.is_refused, self.ordered = "", False, False, order
        self._is_taken, self._given_up, self._confirmed = True, None, ""

    def return_item(
        self, order: GraspOrder | None, *, again: bool, why: Unfinished | None = None
    ) -> None:
        """Return the name for another grasp of the item, or withdraw it.

        `why`: reason why the item is not finished, if so: its name then replaces one that was
        scanned since the grasp. Otherwise such a name is retained.
        """
        if order is None or order != self.ordered or (why is not None and why is self._given_up):
            return
        is_first, self._is_taken = self._is_taken or why not in (None, self.why), False
        if why is not None:
            self.pending, self.why = order.item_id, why
        if not (again or why is not None):
            self.pending, self.why = "", None
            if self.is_returned:
                self.item_id, self.is_returned = "", False
        elif not self.item_id or (self.why is not None and is_first):
            self.item_id, self.is_returned = self.last_item_id if order.item_id else "", True

    def _give_up(self) -> None:
        """End an unfinished item as it is."""
        if not self._is_taken:
            self._given_up, self.pending, self.why = self.why, "", None


def _name_of(text: str) -> str:
    """Return the item of a text, or the text of a damaged label."""
    try:
        return check_item(text) if text else ""
    except InputError:
        return text
