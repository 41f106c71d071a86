"""The settings of the next grasp, and the item that it is for."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.errors import InputError
from palpate_station.dashboard.messages import (
    GraspOrder,
)
from palpate_station.line.gs1 import read_label
from palpate_station.records import Item, check_printable


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
            self.item_id, self.is_returned, self.is_refused = text, False, False

    def take_item(self, order: GraspOrder) -> None:
        """Take the name for an ordered grasp."""
        self.last_item_id = self.item_id or self.last_item_id
        self.item_id, self.is_returned, self.is_refused, self.ordered = "", False, False, order

    def return_item(self, order: GraspOrder | None, *, again: bool) -> None:
        """Return the name for another grasp of the item, or withdraw it.

        A name that was typed or scanned since the grasp is retained.
        """
        if order is None or order != self.ordered:
            return
        if again and not self.item_id:
            self.item_id, self.is_returned = self.last_item_id if order.item_id else "", True
        elif not again and self.is_returned:
            self.item_id, self.is_returned = "", False
