"""Settings of the next grasp: one for all pages, so that a reload loses nothing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class GraspForm:
    """The form of the next grasp.

    Attributes
    ----------
    target_force_n : float or None
        Grip force to reach; None is a gentle squeeze.
    item_id : str
        What it is; empty where it is not to be remembered.
    kind : str
        Kind of produce, for its damage limit; empty where it is not known.
    """

    target_force_n: float | None = None
    item_id: str = ""
    kind: str = ""
