"""Settings of the next grasp: one for all pages, so that a reload loses nothing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class GraspForm:
    """The form of the next grasp."""

    #: Grip force to reach; None is a gentle squeeze.
    target_force_n: float | None = None
    #: Name of the item; empty if its grasp is not to be stored.
    item_id: str = ""
    #: Kind of produce, for its damage limit; empty if not known.
    kind: str = ""
