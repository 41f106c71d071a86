"""Stop a whole study, not only its current grasp, at the user's request."""

from __future__ import annotations

from palpate.grasp.result import GraspResult, Outcome


def require_uninterrupted(result: GraspResult) -> GraspResult:
    """Return the result of a grasp unless the user stopped it.

    `run_grasp` handles Ctrl-C and SIGTERM itself to leave the hand safe. Studies never stop a grasp
    themselves, so a stopped grasp means that the user wants to end the study.

    Raises
    ------
    KeyboardInterrupt
        If the grasp was stopped.

    Examples
    --------
    >>> require_uninterrupted(GraspResult(outcome=Outcome.HELD)).outcome.value
    'held'
    """
    if result.outcome is Outcome.STOPPED:
        raise KeyboardInterrupt
    return result
