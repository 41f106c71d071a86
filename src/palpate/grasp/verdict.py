"""Text of a grasp's outcome and firmness."""

from __future__ import annotations

from palpate.grasp.result import GraspResult, Outcome
from palpate.measurement import Measurement

#: Upper limit of each word: the object's secant stiffness at the grip force, N/mm. The words are
#: informal, not a standard: a ripe avocado is soft, an apple firm, wood hard.
_FIRMNESS = (
    (1.0, "very soft"),
    (3.0, "soft"),
    (8.0, "medium"),
    (20.0, "firm"),
    (float("inf"), "hard"),
)

#: Text for an unknown stiffness.
UNKNOWN_FIRMNESS = "firmness not measured"

_OUTCOMES = {
    Outcome.HELD: "held and released",
    Outcome.NOTHING_THERE: "nothing there: the hand closed without touching anything",
    Outcome.SLIPPED: "slipped: the object left the hand",
    Outcome.TOO_WEAK: "too weak: no safe grip is certain to lift it; put back",
    Outcome.FORCE_LIMIT: "force limit: the hand was opened",
    Outcome.TIMED_OUT: "gave up: the grasp took too long, and the hand was opened",
    Outcome.SENSOR_LOST: "sensor lost: the grasp was stopped",
    Outcome.GRIPPER_FAULT: "gripper fault: the grasp was stopped",
    Outcome.STOPPED: "stopped on request",
}


def outcome_text(outcome: Outcome) -> str:
    """Return an outcome in words."""
    return _OUTCOMES[outcome]


def firmness(stiffness: Measurement) -> str:
    """Return the firmness in words: one word, a range, or a bound.

    A range from the softest to the hardest word is reported as not measured.

    >>> firmness(Measurement(value=2.0, low=1.2, high=2.9, unit="n_per_mm"))
    'soft'
    >>> firmness(Measurement(value=2.0, low=1.2, high=9.0, unit="n_per_mm"))
    'soft to firm'
    >>> wide = Measurement(value=9.0, low=4.0, high=90.0, unit="n_per_mm")
    >>> firmness(wide.or_bound("it deformed too little", least=0.02, most=500.0))
    'at least medium'
    >>> firmness(Measurement(value=9.0, low=0.4, high=90.0, unit="n_per_mm"))
    'firmness not measured'
    """
    low, high = stiffness.known_ends
    softest, firmest = _FIRMNESS[0][1], _FIRMNESS[-1][1]
    words = (
        softest if low is None else _firmness_word(low),
        firmest if high is None else _firmness_word(high),
    )
    if words == (softest, firmest):
        return UNKNOWN_FIRMNESS
    if words[0] == words[1]:
        return words[0]
    if high is None:
        return f"at least {words[0]}"
    return f"at most {words[1]}" if low is None else f"{words[0]} to {words[1]}"


def verdict(result: GraspResult, *, target_force_n: float | None) -> dict[str, object]:
    """Return the JSON form of the verdict: its text, and whether the target was reached.

    For an unknown stiffness, the firmness is given as its index.
    """
    stiffness, force, index = result.stiffness_n_per_mm, result.force_n, result.firmness
    on_target = None
    if target_force_n is not None and force is not None:
        on_target = force.low <= target_force_n <= force.high
    words = None if stiffness is None else firmness(stiffness)
    if words == UNKNOWN_FIRMNESS and index is not None and index.has_value:
        words = f"firmness {index.low:.0f} to {index.high:.0f} of 100"
    return {
        "text": outcome_text(result.outcome),
        "firmness": words,
        "target_force_n": target_force_n,
        "on_target": on_target,
    }


def _firmness_word(stiffness_n_per_mm: float) -> str:
    return next(word for upper, word in _FIRMNESS if stiffness_n_per_mm <= upper)
