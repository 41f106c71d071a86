"""The states of a grasp, in the order that it goes through them."""

from __future__ import annotations

from enum import StrEnum


class Phase(StrEnum):
    """The state of a grasp.

    `done` is the only end, and settling may begin again after a hold.

    What happens within `approach` and `settle` is in `GraspState.activity`.
    """

    APPROACH = "approach"
    SQUEEZE = "squeeze"
    SETTLE = "settle"
    HOLD = "hold"
    RELEASE = "release"
    DONE = "stopped"


class Activity(StrEnum):
    """The activity of a grasp within a state.

    In `approach` the hand sweeps at speed until contact, evaluates it, closes finely and
    confirms the contact; where nothing was there it waits, open, for the next attempt. In `settle`
    it adjusts a settled force that is off the target, and eases off where it is too large.
    """

    TOUCH = "approach"
    SWEEP = "sweep"
    EVALUATE = "felt"
    CONFIRM = "contact"
    WAIT = "wait"
    FORECAST = "settle"
    ADJUST = "adjust"
    EASE = "ease"
