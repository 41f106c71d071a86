"""The headline of a session, its colour, and the words that an operator reads from two metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.dashboard.device_state import CalibrationFailure
from palpate.dashboard.live import Live
from palpate.dashboard.messages import Grasped
from palpate.dashboard.orders import Activity
from palpate.dashboard.session import Session
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS, outcome_text, verdict


def headline_of(session: Session, *, stale: bool) -> dict[str, Any]:
    """Return the headline: of the grasp that ended, of the one that runs, or what goes on."""
    if session.devices.activity is Activity.GONE:
        return {**_WORDLESS, "text": "the devices are gone", "kind": "bad"}
    if session.devices.activity is Activity.WATCHING and (
        broken := _broken(session.devices.live, stale=stale)
    ):
        text, why = broken
        return {**_WORDLESS, "text": text, "why": why, "kind": "bad"}
    failure = session.devices.calibration_failure
    if session.devices.activity is Activity.WATCHING and failure is not None:
        return {**_WORDLESS, **_headline_without_calibration(failure, session.devices.live)}
    if session.devices.activity is Activity.WATCHING and _is_stopped(session):
        if session.devices.live.open_hand:
            return {**_WORDLESS, "text": STOPPED_OPEN, "kind": "idle"}
        if session.devices.stopped_early:
            return {**_WORDLESS, "text": outcome_text(Outcome.STOPPED), "kind": "bad"}
    if session.devices.activity in _OF_THEIR_OWN:
        # Not the verdict of the grasp before.
        return {**_WORDLESS, "text": session.devices.activity.value, "kind": "busy"}
    grasped, progress = session.devices.grasped, session.devices.live.progress
    if grasped is not None:
        headline = verdict(grasped.result, target_force_n=session.shown_target_n)
        low_n = None if progress is None else progress.bounds.damage_low_n
        if (grasped.truth or {}).get("damaged"):
            damaged = "the object was damaged"
            headline |= {"text": damaged, "why": headline["text"], "firmness": None}
        elif _describe_passed_limit(grasped, damage_low_n=low_n):
            headline["why"] = "the force passed the damage limit before it was known"
        kind = kind_of(grasped, target_force_n=session.shown_target_n, damage_low_n=low_n)
        return _with_place({**headline, "kind": kind}, grasped.result, session.devices.placed)
    if progress is None:
        text = session.devices.activity.value
        if session.devices.activity is Activity.WATCHING and not session.devices.sensor_alone:
            text = "ready"
        begins = session.devices.activity is Activity.GRASPING
        return {**_WORDLESS, "text": text, "kind": "busy" if begins else "idle"}
    # In its last phase, for a moment, the grasp has ended.
    text = PHASE_TEXTS.get(progress.phase) or outcome_text(progress.answer.outcome)
    if not progress.decided:
        return {**_WORDLESS, "text": text, "kind": "busy"}
    headline = verdict(progress.answer, target_force_n=session.shown_target_n)
    kind = "warn" if headline["on_target"] is False else "good"
    headline |= {"text": text, "kind": kind}
    if progress.phase != "hold":
        return headline
    return _with_place(headline, progress.answer, session.devices.placed)


def _with_place(
    headline: dict[str, Any], result: GraspResult, placed: Mapping[str, Any]
) -> dict[str, Any]:
    """Let the bin be the headline, with what was measured below; amber for the default one."""
    found = placed.get("bin")
    if headline["kind"] == "bad" or "bin" not in placed:
        return headline
    if found is None:
        return headline | {"why": f"no bin: {placed['why']}", "kind": "warn"}
    firm = None if headline["firmness"] == UNKNOWN_FIRMNESS else headline["firmness"]
    if result.firmness is not None:
        index = f"{result.firmness.middle:.0f} of 100"
        firm = f"firmness {index}" if firm is None else f"{firm} ({index})"
    return headline | {
        "text": found["name"],
        "bin": found["name"],
        "again": found["again"],
        "why": f"{headline['text']}: {found['why'].partition(': ')[2]}",
        "firmness": ", ".join(filter(None, (firm, *_sizes(result)))),
        "kind": "warn" if found["rule"] is None else headline["kind"],
    }


def _sizes(result: GraspResult) -> list[str]:
    """Return size and stiffness in words, where they are known."""
    rows = ((result.size_mm, "mm", 0), (result.stiffness_n_per_mm, "N/mm", 1))
    return [
        f"{one.text(digits=digits if one.number else 2)} {unit}"
        for one, unit, digits in rows
        if one is not None and (one.number or any(one.known_ends))
    ]


def _is_stopped(session: Session) -> bool:
    """Whether the last grasp was stopped, be it before it began."""
    grasped = session.devices.grasped
    is_ended_so = grasped is not None and grasped.result.outcome is Outcome.STOPPED
    return is_ended_so or session.devices.stopped_early


#: The fields of a verdict that are text.
TEXTS = ("text", "firmness", "why", "bin")
_OF_THEIR_OWN = (Activity.RESTING, Activity.WEIGHING, Activity.EXAMINING, Activity.RELEASING)
_WORDLESS: dict[str, Any] = {"firmness": None, "on_target": None}


def kind_of(grasped: Grasped, *, target_force_n: float | None, damage_low_n: float | None) -> str:
    """Return how a grasp ended, as a colour: nothing that went wrong is good."""
    result, truth = grasped.result, grasped.truth or {}
    on_target = verdict(result, target_force_n=target_force_n)["on_target"]
    if result.outcome is not Outcome.HELD or truth.get("damaged"):
        return "bad"
    passed = _describe_passed_limit(grasped, damage_low_n=damage_low_n)
    return "warn" if on_target is False or result.faults or passed else "good"


def _describe_passed_limit(grasped: Grasped, *, damage_low_n: float | None) -> bool:
    """Whether the object bore more than its learned limit: the sheet showed that too late."""
    peak_n = grasped.result.peak_force_n
    return damage_low_n is not None and peak_n is not None and peak_n > damage_low_n


def _headline_without_calibration(failure: CalibrationFailure, live: Live) -> dict[str, str]:
    """Return the headline of a calibration that was stopped or failed."""
    kept = live.source is not None and live.source.rest_ohm is not None
    text = "calibration stopped" if failure.stopped else "calibration failed"
    why = "no calibration is in use"
    if kept:
        why = "the previous calibration stays in use"
    return {"text": text, "why": why, "kind": "warn" if failure.stopped else "bad"}


def _broken(live: Live, *, stale: bool) -> tuple[str, str] | None:
    """Return what is wrong with the sensor that is watched, and what to do; None while it reads."""
    if stale and live.link.frames:
        return "the sensor is silent", "check its cable and power; it goes on as soon as it answers"
    if live.percent is not None and np.isnan(live.percent).all():
        return (
            "no pixel reads",
            "check the cable between sensor and board; the page Doctor gives details",
        )
    return None


PHASE_TEXTS = {
    "wait": "waiting until the sheet has recovered",
    "sweep": "closing in",
    "felt": "possible contact",
    "approach": "approaching slowly",
    "contact": "contact found",
    "squeeze": "squeezing gently",
    "settle": "waiting for the sheet",
    "adjust": "adjusting",
    "ease": "easing off",
    "hold": "holding",
    "release": "releasing",
}


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
    if _headline_of_stop(headline):
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
        if _headline_of_damage(grasped):
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
    if headline["kind"] == "bad" and grasped is None and not _headline_of_stop(headline):
        return str(headline.get("why", ""))
    if session.devices.sensor_alone:
        return "No gripper: press the pads"
    if session.devices.live.open_hand is False:
        return "Press Release: the hand opens"
    if _headline_of_stop(headline):
        return OUTCOMES[Outcome.STOPPED][1]
    if grasped is None or headline["text"] == STOPPED_OPEN:
        return OUTCOMES[Outcome.HELD][1]
    if _headline_of_damage(grasped):
        return "Set this item aside"
    if headline.get("again"):
        return "Turn the item, then press Grasp again: the bin is only for now"
    return OUTCOMES[grasped.result.outcome][1]


def _headline_of_stop(headline: Mapping[str, object]) -> bool:
    """Whether a grasp was stopped, be it before it began."""
    return headline["text"] == outcome_text(Outcome.STOPPED)


def _headline_of_damage(grasped: Grasped) -> bool:
    return bool((grasped.truth or {}).get("damaged"))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
