"""Phases of a grasp, in order, and the activities within them."""

from __future__ import annotations

from enum import Enum


class Phase(Enum):
    """Phase of a grasp; `DONE` is the only final phase. The value is its name in messages.

    `GraspState.activity` has the activity within `APPROACH` and `SETTLE`.
    """

    APPROACH = "approach"
    SQUEEZE = "squeeze"
    SETTLE = "settle"
    HOLD = "hold"
    RELEASE = "release"
    DONE = "stopped"


class Activity(Enum):
    """Activity within a phase. The value is its name in messages.

    In `APPROACH` the hand sweeps at speed until contact, evaluates the contact, closes in fine
    steps and confirms the contact; after an attempt without contact it waits, open. In `SETTLE` the
    settled force is predicted, and corrected if it differs from the target.
    """

    TOUCH = "approach"
    SWEEP = "sweep"
    EVALUATE = "felt"
    CONFIRM = "contact"
    WAIT = "wait"
    FORECAST = "settle"
    ADJUST = "adjust"
    EASE = "ease"
