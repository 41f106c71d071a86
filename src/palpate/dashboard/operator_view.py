"""What an operator reads from two metres: a verdict of a word or two, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.dashboard.activity import Activity
from palpate.dashboard.messages import Grasped
from palpate.dashboard.session import Session
from palpate.grasp.result import Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS, outcome_text

#: The word of each phase.
PHASES = {
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
#: How a grasp ended in a word, and what to do then.
OUTCOMES = {
    Outcome.HELD: ("Held", "Put the next item in, then press Grasp"),
    Outcome.NOTHING_THERE: (
        "Nothing there",
        "Put an item between the fingers, then press Grasp",
    ),
    Outcome.SLIPPED: (
        "Slipped",
        "Put the item in again, further up, then press Grasp",
    ),
    Outcome.TOO_WEAK: (
        "Too weak",
        "Lift this item by hand: no safe grip is sure to hold it",
    ),
    Outcome.FORCE_LIMIT: (
        "Too much force",
        "Look at the item and the hand before you go on",
    ),
    Outcome.TIMED_OUT: (
        "Gave up",
        "Look at the item and the hand, then press Grasp again",
    ),
    Outcome.SENSOR_LOST: ("Sensor lost", "Check the sensor's cable and power"),
    Outcome.GRIPPER_FAULT: ("Hand fault", "Check the hand before you go on"),
    Outcome.STOPPED: ("Stopped", "Look at the hand, then press Grasp again"),
}
_OFF, _READY = "Off target", "Ready"
#: Headline after a stop, once the hand has opened: there is nothing to be done about it.
STOPPED_OPEN = "stopped, hand open"


def operator_view(
    session: Session,
    *,
    headline: Mapping[str, object],
) -> dict[str, str]:
    """Return the words of the operator's view.

    Parameters
    ----------
    session : Session
        As it is now.
    headline : mapping
        The verdict as the whole page shows it.
    """
    target_force_n = session.form.target_force_n
    if session.devices.activity in (Activity.GRASPING, Activity.REPLAYING):
        target_force_n = session.shown_target_n
    gentle = target_force_n is None
    return {
        "word": _capital(_word(session, headline)),
        "next": _capital(_next(session, headline)),
        "target": "gentle squeeze" if gentle else f"{target_force_n:g} N",
    }


def _word(session: Session, headline: Mapping[str, object]) -> str:
    grasped, progress = session.devices.grasped, session.devices.live.progress
    if headline["text"] == STOPPED_OPEN:
        return STOPPED_OPEN
    if _stopped(headline):
        return OUTCOMES[Outcome.STOPPED][0]
    if session.devices.activity is Activity.GONE or (headline["kind"] == "bad" and grasped is None):
        return str(headline["text"])
    if session.devices.calibration_failure is not None:
        return str(headline["text"])
    if session.devices.activity not in (Activity.WATCHING, Activity.GRASPING, Activity.REPLAYING):
        return str(session.devices.activity)
    if headline.get("bin"):
        return str(headline["bin"])
    firmness = headline["firmness"] if headline["firmness"] != UNKNOWN_FIRMNESS else None
    if grasped is not None:
        if _damaged(grasped):
            return "Damaged"
        if grasped.result.outcome is not Outcome.HELD:
            return OUTCOMES[grasped.result.outcome][0]
        return _OFF if headline["on_target"] is False else str(firmness or "held")
    if progress is None and session.devices.activity is Activity.GRASPING:
        return "Closing"
    if session.devices.sensor_alone:
        return "contact" if session.devices.live.touching else _READY
    if progress is None:
        return _READY if session.devices.live.open_hand is not False else "Hand closed"
    known = progress.decided and progress.phase == "hold" and headline["on_target"] is not False
    if known and firmness:
        return str(firmness)
    return PHASES.get(progress.phase) or OUTCOMES[progress.answer.outcome][0]


def _next(session: Session, headline: Mapping[str, object]) -> str:
    grasped, progress = session.devices.grasped, session.devices.live.progress
    if session.devices.activity is Activity.GONE:
        return "Start palpate serve again"
    if session.devices.guide is not None:
        return session.devices.guide.text
    if session.devices.activity is Activity.IDLE:
        return "Choose a rig on the full page"
    if session.devices.activity is Activity.GRASPING:
        if progress is not None and progress.phase == "hold":
            return "Take the item, then press Release"
        return "Keep your hands away"
    if session.devices.activity is not Activity.WATCHING:
        return "Wait"
    if session.devices.calibration_failure is not None:
        return "Repeat it on the page Calibrate, or go on without"
    if headline["kind"] == "bad" and grasped is None and not _stopped(headline):
        return str(headline.get("why", ""))
    if session.devices.sensor_alone:
        return "No gripper: press the pads"
    if session.devices.live.open_hand is False:
        return "Press Release: the hand opens"
    if _stopped(headline):
        return OUTCOMES[Outcome.STOPPED][1]
    if grasped is None or headline["text"] == STOPPED_OPEN:
        return OUTCOMES[Outcome.HELD][1]
    if _damaged(grasped):
        return "Set this item aside"
    if headline.get("again"):
        return "Turn the item, then press Grasp again: the bin is only for now"
    return OUTCOMES[grasped.result.outcome][1]


def _stopped(headline: Mapping[str, object]) -> bool:
    """Whether a grasp was stopped, be it before it began."""
    return headline["text"] == outcome_text(Outcome.STOPPED)


def _damaged(grasped: Grasped) -> bool:
    return bool((grasped.truth or {}).get("damaged"))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
