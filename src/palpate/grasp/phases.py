"""The phases of a grasp, in the order that it goes through them."""

from __future__ import annotations

from enum import StrEnum


class Phase(StrEnum):
    """What the grasp is doing. `adjust` returns to `settle`,
    through `ease` where the force was too large; `stopped` is the only end.

    `sweep` closes at speed until something is felt, in `felt` the hand stands still and reads, and
    `approach` touches finely. `wait` is the open hand between two tries, where nothing was there;
    `approach` follows it.
    """

    WAIT = "wait"
    APPROACH = "approach"
    SWEEP = "sweep"
    FELT = "felt"
    CONTACT = "contact"
    SQUEEZE = "squeeze"
    SETTLE = "settle"
    ADJUST = "adjust"
    EASE = "ease"
    HOLD = "hold"
    RELEASE = "release"
    STOPPED = "stopped"
