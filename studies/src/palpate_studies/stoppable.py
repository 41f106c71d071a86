"""Stopping of a whole study at the user's request, beyond its current grasp."""

from __future__ import annotations

from palpate.grasp.result import GraspResult, Outcome


def require_uninterrupted(result: GraspResult) -> GraspResult:
    """Return the result of a grasp that ran to its end.

    `run_grasp` takes Ctrl-C and SIGTERM for itself, to leave the hand safe. A study asks for no
    stop of its own, so a stopped grasp is no data, and its user wants the study to end.

    Raises
    ------
    KeyboardInterrupt
        If it was stopped from outside.

    Examples
    --------
    >>> require_uninterrupted(GraspResult(outcome=Outcome.HELD)).outcome.value
    'held'
    """
    if result.outcome is Outcome.STOPPED:
        raise KeyboardInterrupt
    return result
