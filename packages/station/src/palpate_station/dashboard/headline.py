"""The headline of a session, its colour, and the texts of the operator's page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import outcome_text, verdict
from palpate.object.firmness import firmness_text
from palpate_station.dashboard.messages import DeviceActivity
from palpate_station.dashboard.session import DeviceState, Session

#: Headline after a stop once the hand is open; the user need not act.
STOPPED_OPEN = "stopped, hand open"
_HEADLINE_ACTIVITIES = (
    DeviceActivity.CALIBRATING_REST,
    DeviceActivity.CALIBRATING_FORCE,
    DeviceActivity.EXAMINING,
    DeviceActivity.RELEASING,
)
#: Description of each phase, and a single word for the operator's page.
PHASES = {
    "wait": ("waiting until the sheet has recovered", "Measuring"),
    "sweep": ("closing in", "Closing"),
    "felt": ("possible contact", "Closing"),
    "approach": ("approaching slowly", "Touching"),
    "contact": ("contact found", "Touching"),
    "squeeze": ("squeezing gently", "Gripping"),
    "settle": ("waiting for the sheet", "Measuring"),
    "adjust": ("adjusting", "Gripping"),
    "ease": ("easing off", "Gripping"),
    "hold": ("holding", "Holding"),
    "release": ("releasing", "Opening"),
}
#: Each outcome of a grasp in few words, and the operator's next step.
OUTCOMES = {
    Outcome.HELD: ("Held", "Put the next item in, then press Grasp"),
    Outcome.NOTHING_THERE: ("Nothing there", "Put an item between the fingers, then press Grasp"),
    Outcome.SLIPPED: ("Slipped", "Put the item in again, further up, then press Grasp"),
    Outcome.TOO_WEAK: ("Too weak", "Lift this item by hand: no safe grip is certain to hold it"),
    Outcome.FORCE_LIMIT: ("Too much force", "Check the item and the hand before you continue"),
    Outcome.TIMED_OUT: ("Gave up", "Check the item and the hand, then press Grasp again"),
    Outcome.SENSOR_LOST: ("Sensor lost", "Check the sensor's cable and power"),
    Outcome.GRIPPER_FAULT: ("Hand fault", "Check the hand before you continue"),
    Outcome.STOPPED: ("Stopped", "Check the hand, then press Grasp again"),
}
#: Outcomes whose next step is another grasp of the same item.
REPEATED_OUTCOMES = frozenset(
    {
        Outcome.NOTHING_THERE,
        Outcome.SLIPPED,
        Outcome.TIMED_OUT,
        Outcome.SENSOR_LOST,
        Outcome.GRIPPER_FAULT,
        Outcome.STOPPED,
    }
)
#: Next step with a provisional bin, while the hand holds the item and after it opened.
AGAIN_STEPS = (
    "Press Release, turn the item, then press Grasp again: the bin is provisional",
    "Turn the item, then press Grasp again: the bin is provisional",
)


def headline_of(session: Session, *, stale: bool) -> dict[str, Any]:
    """Return the headline of the running or last grasp, or of the current activity."""
    devices, activity = session.devices, session.devices.activity
    grasped, progress = devices.grasped, devices.live.progress
    if activity is DeviceActivity.GONE:
        return _headline("the device process has ended", "bad")
    found = _fault_headline(devices, stale=stale) if activity is DeviceActivity.WATCHING else None
    if found is not None:
        return found
    if activity in _HEADLINE_ACTIVITIES:
        # Hides the verdict of the previous grasp.
        return _headline(activity.value, "busy")
    if grasped is not None:
        return _end_headline(devices, grasped.document)
    if progress is None:
        text = activity.value
        if activity is DeviceActivity.WATCHING and not devices.is_sensor_only:
            text = "ready"
        return _headline(text, "busy" if activity is DeviceActivity.GRASPING else "idle")
    # The last phase has no text: the grasp has ended, but its result has not arrived yet.
    text = phase_text(progress.phase) or outcome_text(progress.answer.outcome)
    if not progress.decided:
        return _headline(text, "busy")
    words = _verdict(progress.answer, target_force_n=session.shown_target_n)
    words |= {"text": text, "kind": "warn" if words["on_target"] is False else "good"}
    return _add_bin(words, devices) if progress.phase == "hold" else words


def phase_text(phase: str) -> str:
    """Return the description of a phase; empty for the last phase."""
    return PHASES.get(phase, ("", ""))[0]


def outcome_kind(document: GraspDocument) -> str:
    """Return ``"good"``, ``"warn"`` or ``"bad"``; a grasp with a fault is never good."""
    result = document.result
    on_target = verdict(result, target_force_n=document.target_force_n)["on_target"]
    if result.outcome is not Outcome.HELD or _is_damaged(document):
        return "bad"
    passed = _has_passed_limit(document)
    return "warn" if on_target is False or result.faults or passed else "good"


def _headline(text: str, kind: str, *, why: str = "") -> dict[str, Any]:
    return {
        "text": text,
        "kind": kind,
        "why": why,
        "firmness": "",
        "measured": "",
        "bin": "",
        "on_target": None,
    }


def _verdict(result: GraspResult, *, target_force_n: float | None) -> dict[str, Any]:
    """Return a headline with the verdict on a measured object."""
    words = verdict(result, target_force_n=target_force_n)
    measured = ", ".join(_describe_measurements(result))
    return _headline("", "") | words | {"firmness": words["firmness"] or "", "measured": measured}


def _is_firmness_word(firmness: str) -> bool:
    return firmness != "" and not firmness.startswith("firmness ")


def _fault_headline(devices: DeviceState, *, stale: bool) -> dict[str, Any] | None:
    """Return the headline of a fault, a failed calibration or a stop; else None."""
    live, failure = devices.live, devices.calibration_failure
    if stale and live.link.frames:
        why = "check its cable and power; reading resumes when the sensor answers"
        return _headline("the sensor is silent", "bad", why=why)
    if live.percent is not None and np.isnan(live.percent).all():
        why = "check the cable between sensor and board; the tab Doctor shows details"
        return _headline("no pixel readings", "bad", why=why)
    if failure is not None:
        is_calibrated = live.source is not None and live.source.rest_ohm is not None
        why = (
            "the previous calibration stays in use" if is_calibrated else "no calibration is in use"
        )
        if failure.stopped:
            return _headline("calibration stopped", "warn", why=why)
        return _headline("calibration failed", "bad", why=why)
    grasped = devices.grasped
    is_stopped = grasped is not None and grasped.document.result.outcome is Outcome.STOPPED
    if (is_stopped or devices.stopped_early) and live.is_hand_open:
        return _headline(STOPPED_OPEN, "idle")
    if devices.stopped_early:
        return _headline(outcome_text(Outcome.STOPPED), "bad")
    return None


def _end_headline(devices: DeviceState, document: GraspDocument) -> dict[str, Any]:
    """Return the headline of a grasp that has ended."""
    words = _verdict(document.result, target_force_n=document.target_force_n)
    if _is_damaged(document):
        words |= {"text": "the object was damaged", "why": words["text"], "firmness": ""}
    elif _has_passed_limit(document):
        words["why"] = "the force exceeded the damage limit before the limit was known"
    if _is_damaged(document) or document.result.outcome is not Outcome.HELD:
        words["measured"] = ""
    words["kind"] = outcome_kind(document)
    return _add_bin(words, devices)


def _add_bin(headline: dict[str, Any], devices: DeviceState) -> dict[str, Any]:
    """Return the headline with the bin as its text; amber for the default bin."""
    placed = devices.placed
    if headline["kind"] == "bad" or placed is None or not placed.is_sorted:
        return headline
    found = placed.bin
    if found is None:
        return headline | {"why": f"no bin: {placed.no_bin}", "kind": "warn"}
    firm = headline["firmness"] if _is_firmness_word(headline["firmness"]) else ""
    measured = ", ".join(filter(None, (firm, headline["measured"])))
    return headline | {
        "text": found.name,
        "bin": found.name,
        "again": found.again,
        "why": f"{headline['text']}: {found.why.partition(': ')[2]}",
        "firmness": measured,
        "measured": measured,
        "kind": "warn" if found.rule is None else headline["kind"],
    }


def _describe_measurements(result: GraspResult) -> list[str]:
    """Return the known firmness and size as text."""
    texts = []
    if result.firmness is not None and result.firmness.has_value:
        texts.append(f"firmness {firmness_text(result.firmness)} of 100")
    if result.size_mm is not None and result.size_mm.has_value:
        texts.append(f"{result.size_mm.middle:.0f} mm")
    return texts


def _has_passed_limit(document: GraspDocument) -> bool:
    """Return whether the peak force exceeded the object's learned damage limit."""
    peak_n = document.result.peak_force_n
    return peak_n is not None and peak_n > document.damage_low_n


def _is_damaged(document: GraspDocument) -> bool:
    return bool((document.truth or {}).get("damaged"))


def _is_stop_headline(headline: Mapping[str, object]) -> bool:
    """Return whether the headline reports a stopped grasp."""
    return headline["text"] == outcome_text(Outcome.STOPPED)


def operator_view(session: Session, *, headline: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts of the operator's page.

    Parameters
    ----------
    session : Session
        The session.
    headline : mapping
        The headline of the full page.
    """
    target_force_n = session.form.target_force_n
    if session.devices.activity in (DeviceActivity.GRASPING, DeviceActivity.REPLAYING):
        target_force_n = session.shown_target_n
    return {
        "word": _capitalize(_operator_word(session.devices, headline)),
        "next": _capitalize(_next_step(session.devices, headline)),
        "target": "gentle squeeze" if target_force_n is None else f"{target_force_n:g} N",
    }


def _operator_word(devices: DeviceState, headline: Mapping[str, Any]) -> str:
    grasped, progress, activity = devices.grasped, devices.live.progress, devices.activity
    if _is_stop_headline(headline):
        return OUTCOMES[Outcome.STOPPED][0]
    if (
        headline["text"] == STOPPED_OPEN
        or activity is DeviceActivity.GONE
        or (headline["kind"] == "bad" and grasped is None)
        or devices.calibration_failure is not None
    ):
        return str(headline["text"])
    if activity not in (DeviceActivity.WATCHING, DeviceActivity.GRASPING, DeviceActivity.REPLAYING):
        return str(activity)
    if headline["bin"]:
        return str(headline["bin"])
    firmness = headline["firmness"] if _is_firmness_word(headline["firmness"]) else ""
    if grasped is not None:
        if _is_damaged(grasped.document):
            return "Damaged"
        if grasped.document.result.outcome is not Outcome.HELD:
            return OUTCOMES[grasped.document.result.outcome][0]
        return "Off target" if headline["on_target"] is False else firmness or "held"
    if progress is None and activity is DeviceActivity.GRASPING:
        return "Closing"
    if devices.is_sensor_only:
        return "contact" if devices.live.touching_fingers else "Ready"
    if progress is None:
        return "Ready" if devices.live.is_hand_open is not False else "Hand closed"
    is_measured = (
        progress.decided and progress.phase == "hold" and headline["on_target"] is not False
    )
    if is_measured and firmness:
        return str(firmness)
    if progress.phase in PHASES:
        return PHASES[progress.phase][1]
    return OUTCOMES[progress.answer.outcome][0]


def _next_step(devices: DeviceState, headline: Mapping[str, Any]) -> str:
    grasped, progress, activity = devices.grasped, devices.live.progress, devices.activity
    if activity is DeviceActivity.GONE:
        return "Start palpate serve again"
    if devices.guide is not None:
        return devices.guide.text
    if activity is DeviceActivity.IDLE:
        return "Choose a rig on the full page"
    if activity is DeviceActivity.GRASPING:
        if progress is not None and progress.phase == "hold":
            return AGAIN_STEPS[0] if headline.get("again") else "Take the item, then press Release"
        return "Keep your hands away"
    if activity is not DeviceActivity.WATCHING:
        return "Wait"
    if devices.calibration_failure is not None:
        return "Repeat the calibration on the full page, or continue without it"
    if headline["kind"] == "bad" and grasped is None and not _is_stop_headline(headline):
        return str(headline["why"])
    if devices.is_sensor_only:
        return "No gripper: press the pads"
    if devices.live.is_hand_open is False:
        return "Press Release: the hand opens"
    if _is_stop_headline(headline):
        return OUTCOMES[Outcome.STOPPED][1]
    if grasped is None or headline["text"] == STOPPED_OPEN:
        return OUTCOMES[Outcome.HELD][1]
    if _is_damaged(grasped.document):
        return "Set this item aside"
    placed = devices.placed
    is_lost = placed is not None and placed.is_sorted and placed.bin is None
    if grasped.document.result.outcome is Outcome.HELD and is_lost:
        return "Set this item aside: it has no bin"
    if headline.get("again"):
        return AGAIN_STEPS[1]
    return OUTCOMES[grasped.document.result.outcome][1]


def _capitalize(text: str) -> str:
    return text[:1].upper() + text[1:]
