"""What an operator reads from two metres: a verdict of a word or two, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.dashboard.messages import Grasped
from palpate.dashboard.session import Activity, Session
from palpate.grasp.result import Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS

_PHASES = {
    "wait": "Measuring",
    "sweep": "Closing",
    "felt": "Closing",
    "approach": "Touching",
    "contact": "Touching",
    "squeeze": "Gripping",
    "settle": "Measuring",
    "adjust": "Gripping",
    "ease": "Gripping",
    "hold": "Holding",
    "release": "Opening",
}
_OUTCOMES = {
    Outcome.HELD: ("Held", "Put the next item in, then press Grasp"),
    Outcome.NOTHING_THERE: ("Nothing there", "Put an item between the fingers, then press Grasp"),
    Outcome.SLIPPED: ("Slipped", "Put the item in again, further up, then press Grasp"),
    Outcome.TOO_WEAK: ("Too weak", "Lift this item by hand: no safe grip is sure to hold it"),
    Outcome.FORCE_LIMIT: ("Too much force", "Look at the item and the hand before you go on"),
    Outcome.TIMED_OUT: ("Gave up", "Look at the item and the hand, then press Grasp again"),
    Outcome.SENSOR_LOST: ("Sensor lost", "Check the sensor's cable and power"),
    Outcome.GRIPPER_FAULT: ("Hand fault", "Check the hand before you go on"),
    Outcome.STOPPED: ("Stopped", "Look at the hand, then press Grasp again"),
}


def operator_view(
    session: Session, *, said: Mapping[str, object], target_force_n: float | None
) -> dict[str, str]:
    """Return the words of the operator's view.

    Parameters
    ----------
    session : Session
        As it is now.
    said : mapping
        The verdict as the whole page shows it.
    target_force_n : float or None
        What the next grasp reaches for; None is a gentle squeeze.
    """
    gentle = target_force_n is None
    return {
        "word": _word(session, said),
        "next": _next(session, said),
        "target": "gentle squeeze" if gentle else f"{target_force_n:g} N",
    }


def _word(session: Session, said: Mapping[str, object]) -> str:
    grasped, thought = session.grasped, session.live.thought
    if session.activity is Activity.GONE or (said["kind"] == "bad" and grasped is None):
        return _capital(str(said["text"]))
    if session.activity not in (Activity.WATCHING, Activity.GRASPING, Activity.REPLAYING):
        return _capital(str(session.activity))
    firmness = said["firmness"] if said["firmness"] != UNKNOWN_FIRMNESS else None
    if grasped is not None:
        if _damaged(grasped):
            return "Damaged"
        if grasped.result.outcome is not Outcome.HELD:
            return _OUTCOMES[grasped.result.outcome][0]
        return "Off target" if said["on_target"] is False else _capital(str(firmness or "held"))
    if thought is None and session.activity is Activity.GRASPING:
        return "Closing"
    if session.sensor_alone:
        return "Watching"
    if thought is None:
        return "Ready" if session.live.open_hand is not False else "Hand closed"
    known = thought.decided and thought.phase == "hold" and said["on_target"] is not False
    if known and firmness:
        return _capital(str(firmness))
    return _PHASES.get(thought.phase) or _OUTCOMES[thought.answer.outcome][0]


def _next(session: Session, said: Mapping[str, object]) -> str:
    grasped, thought = session.grasped, session.live.thought
    if session.activity is Activity.GONE:
        return "Start palpate serve again"
    if session.guide is not None:
        return session.guide.text
    if session.activity is Activity.IDLE:
        return "Choose a rig on the full page"
    if session.activity is Activity.GRASPING:
        if thought is not None and thought.phase == "hold":
            return "Take the item, then press Release"
        return "Keep your hands away"
    if session.activity is not Activity.WATCHING:
        return "Wait"
    if said["kind"] == "bad" and grasped is None:
        return _capital(str(said.get("why", "")))
    if session.sensor_alone:
        return "No gripper: press the pads"
    if session.live.open_hand is False:
        return "Press Release: the hand opens"
    if grasped is None:
        return _OUTCOMES[Outcome.HELD][1]
    return "Set this item aside" if _damaged(grasped) else _OUTCOMES[grasped.result.outcome][1]


def _damaged(grasped: Grasped) -> bool:
    return bool((grasped.truth or {}).get("damaged"))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
