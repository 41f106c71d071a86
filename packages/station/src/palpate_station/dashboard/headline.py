"""The headline of a session: what it reports, its colour, and its texts on the two pages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from enum import StrEnum
from typing import Any

import numpy as np

from palpate.grasp.document import Bin, GraspDocument
from palpate.grasp.phases import Phase
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS, firmness, verdict
from palpate.object.firmness import firmness_text
from palpate_station.dashboard.device_state import DeviceState
from palpate_station.dashboard.folder import Interruption
from palpate_station.dashboard.grasp_form import Unfinished, short_name
from palpate_station.dashboard.item_store import StoreFault
from palpate_station.dashboard.jobs import HOLD_S
from palpate_station.dashboard.messages import DeviceActivity
from palpate_station.dashboard.session import Session
from palpate_station.dashboard.words import Words
from palpate_station.sorting.conditions import percent
from palpate_station.sorting.placement import Placement

#: Activities that hide the verdict of the previous grasp.
_HEADLINE_ACTIVITIES = (
    DeviceActivity.CALIBRATING_REST,
    DeviceActivity.CALIBRATING_FORCE,
    DeviceActivity.EXAMINING,
    DeviceActivity.RELEASING,
)
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


#: Outcomes after which a closed hand may still hold the item.
_HOLDING_OUTCOMES = (Outcome.STOPPED, Outcome.SENSOR_LOST, Outcome.GRIPPER_FAULT)


class Report(StrEnum):
    """What a headline reports."""

    GONE = "gone"
    SILENT = "silent"
    UNREADABLE = "unreadable"
    CALIBRATION_STOPPED = "calibration_stopped"
    CALIBRATION_FAILED = "calibration_failed"
    #: A stop, or a lost sensor, after the hand is open and the sensor answers: nothing to do.
    STOPPED_OPEN = "stopped_open"
    SENSOR_BACK = "sensor_back"
    #: A rig that waits: with an open or a closed gripper, or without one.
    READY = "ready"
    #: A grasp was cut off by the end of a process: nothing was stored.
    INTERRUPTED = "interrupted"
    CLOSED = "closed"
    PADS = "pads"
    CONTACT = "contact"
    #: Another activity than a grasp.
    ACTIVITY = "activity"
    #: A grasp: its phase, its outcome, or the damage of the object on simulated rigs.
    PHASE = "phase"
    OUTCOME = "outcome"
    DAMAGED = "damaged"


#: Number of the colours of bins in `dashboard.css`.
BIN_COLORS = 5
#: Faults of the devices, which hide every verdict.
_FAULTS = (Report.SILENT, Report.UNREADABLE)
#: Reports with the item of an interrupted grasp.
_INTERRUPTED = (Report.INTERRUPTED, Report.GONE)
_CALIBRATION = (Report.CALIBRATION_STOPPED, Report.CALIBRATION_FAILED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Headline:
    """What a page reports of the running or last grasp, or of the current activity.

    Attributes
    ----------
    report : Report
        What is reported.
    kind : str
        Colour: ``"good"``, ``"warn"``, ``"bad"``, ``"busy"`` or ``"idle"``.
    result : GraspResult or None
        Result of the grasp, as far as it is shown.
    outcome : Outcome or None
        Outcome of the grasp; None before its end.
    phase : str
        Phase of the running grasp.
    target_force_n : float or None
        Target force of the grasp, newtons.
    bin : Bin or None
        The item's bin.
    evidence : str
        What the bin is based on.
    no_bin : str
        Why rules gave no bin; empty if they did, or without rules.
    has_passed_limit : bool
        Whether the peak force exceeded the object's learned damage limit.
    """

    report: Report
    kind: str
    result: GraspResult | None = None
    outcome: Outcome | None = None
    phase: str = ""
    target_force_n: float | None = None
    bin: Bin | None = None
    evidence: str = ""
    no_bin: str = ""
    has_passed_limit: bool = False

    @property
    def on_target(self) -> bool | None:
        """Whether the target force was reached; None without target or force."""
        if self.result is None:
            return None
        found = verdict(self.result, target_force_n=self.target_force_n)["on_target"]
        return None if found is None else bool(found)

    @property
    def firmness_word(self) -> str:
        """Firmness in words; empty if it is unknown."""
        stiffness = None if self.result is None else self.result.stiffness_n_per_mm
        words = UNKNOWN_FIRMNESS if stiffness is None else firmness(stiffness)
        return "" if words == UNKNOWN_FIRMNESS else words

    def measured(self, words: Words) -> list[str]:
        """Return the known firmness and size as texts; empty unless the object is held."""
        result = self.result
        if result is None or self.report is Report.DAMAGED:
            return []
        if self.outcome not in (None, Outcome.HELD):
            return []
        texts = []
        if result.firmness is not None and result.firmness.has_value:
            texts.append(words("firmness", value=firmness_text(result.firmness)))
        if result.size_mm is not None and result.size_mm.has_value:
            texts.append(words("size", size=f"{result.size_mm.middle:.0f}"))
        return texts


def find_headline(session: Session, *, stale: bool) -> Headline:
    """Return the headline of a session; `stale`: whether its frames are too old."""
    devices, activity = session.devices, session.devices.activity
    if activity is DeviceActivity.GONE:
        return Headline(report=Report.GONE, kind="bad")
    report = _find_fault(devices, stale=stale) if activity is DeviceActivity.WATCHING else None
    if report is not None:
        is_over = report in (Report.STOPPED_OPEN, Report.SENSOR_BACK)
        mild = "idle" if is_over else "warn" if report is Report.CALIBRATION_STOPPED else "bad"
        return Headline(report=report, kind=mild)
    if activity in _HEADLINE_ACTIVITIES:
        return Headline(report=Report.ACTIVITY, kind="busy")
    if devices.grasped is not None:
        return _end_headline(devices, devices.grasped.document)
    progress = devices.live.progress
    if devices.stopped_early and activity is DeviceActivity.WATCHING:
        return Headline(report=Report.OUTCOME, kind="bad", outcome=Outcome.STOPPED)
    if devices.interrupted is not None and activity is DeviceActivity.WATCHING:
        return Headline(report=Report.INTERRUPTED, kind="bad")
    if progress is None and activity is DeviceActivity.GRASPING:
        return Headline(report=Report.PHASE, kind="busy", phase="sweep")
    if progress is None:
        return Headline(report=_waiting_report(devices), kind="idle")
    # Between its last phase and its end, a grasp has an outcome, but no result yet.
    is_over = progress.phase == Phase.DONE.value
    outcome = progress.answer.outcome if is_over else None
    report = Report.OUTCOME if is_over else Report.PHASE
    # The bin is chosen a moment after the answer: until then nothing may look like one.
    is_open = activity is DeviceActivity.GRASPING and not devices.is_answered
    if not progress.decided or is_open:
        return Headline(report=report, kind="busy", phase=progress.phase, outcome=outcome)
    has_bin = progress.phase == Phase.HOLD.value or progress.answer.outcome is Outcome.HELD
    found = Headline(
        report=report,
        kind="good",
        phase=progress.phase,
        outcome=outcome,
        result=progress.answer,
        target_force_n=session.shown_target_n,
        # The opening hand keeps the bin: any other word could be mistaken for one.
        **(_bin_fields(devices) if has_bin else {}),
    )
    return _with_kind(found, "warn" if found.on_target is False else "good")


def _find_fault(devices: DeviceState, *, stale: bool) -> Report | None:
    """Return the fault of waiting devices, a failed calibration or a past stop; else None."""
    live, failure = devices.live, devices.calibration_failure
    if stale and live.link.frames:
        return Report.SILENT
    if live.percent is not None and np.isnan(live.percent).all():
        return Report.UNREADABLE
    if failure is not None:
        return Report.CALIBRATION_STOPPED if failure.stopped else Report.CALIBRATION_FAILED
    document = None if devices.grasped is None else devices.grasped.document
    outcome = None if document is None else document.result.outcome
    if not live.is_hand_open or (document is not None and _is_damaged(document)):
        return None
    if outcome is Outcome.STOPPED or devices.stopped_early:
        return Report.STOPPED_OPEN
    # Frames arrive again, as `stale` is checked above.
    return Report.SENSOR_BACK if outcome is Outcome.SENSOR_LOST else None


def _waiting_report(devices: DeviceState) -> Report:
    """Return the report of a session without a grasp."""
    if devices.activity is not DeviceActivity.WATCHING:
        return Report.ACTIVITY
    if devices.is_sensor_only:
        return Report.CONTACT if devices.live.touching_fingers else Report.PADS
    return Report.CLOSED if devices.live.is_hand_open is False else Report.READY


def _end_headline(devices: DeviceState, document: GraspDocument) -> Headline:
    """Return the headline of a grasp that has ended."""
    result, damaged = document.result, _is_damaged(document)
    found = Headline(
        report=Report.DAMAGED if damaged else Report.OUTCOME,
        kind=outcome_kind(document),
        result=result,
        outcome=result.outcome,
        target_force_n=document.target_force_n,
        has_passed_limit=not damaged and _has_passed_limit(document),
        **({} if damaged or result.outcome is not Outcome.HELD else _bin_fields(devices)),
    )
    is_lost = devices.item_id != "" and devices.not_stored != ""
    return _with_kind(found, "warn" if is_lost and found.kind == "good" else found.kind)


def _bin_fields(devices: DeviceState) -> dict[str, Any]:
    placed = devices.placed
    if placed is None or not placed.is_sorted:
        return {}
    return {"bin": placed.bin, "no_bin": placed.no_bin, "evidence": devices.evidence}


def _with_kind(found: Headline, kind: str) -> Headline:
    """Return the headline with its colour; default, provisional and missing bins are amber."""
    is_unsure = found.bin is not None and (found.bin.rule is None or found.bin.again)
    if kind != "bad" and (is_unsure or found.no_bin):
        kind = "warn"
    return replace(found, kind=kind)


def outcome_kind(document: GraspDocument) -> str:
    """Return ``"good"``, ``"warn"`` or ``"bad"``; a grasp with a fault is never good."""
    result = document.result
    on_target = verdict(result, target_force_n=document.target_force_n)["on_target"]
    if result.outcome is not Outcome.HELD or _is_damaged(document):
        return "bad"
    passed = _has_passed_limit(document)
    return "warn" if on_target is False or result.faults or passed else "good"


def _has_passed_limit(document: GraspDocument) -> bool:
    """Return whether the peak force exceeded the object's learned damage limit."""
    peak_n = document.result.peak_force_n
    return peak_n is not None and peak_n > document.damage_low_n


def _is_damaged(document: GraspDocument) -> bool:
    return bool((document.truth or {}).get("damaged"))


# -- texts ----------------------------------------------------------------------------------------


def activity_text(activity: DeviceActivity, words: Words) -> str:
    """Return an activity as text."""
    return words(f"activity.{activity.name.lower()}")


def phase_text(phase: str, words: Words) -> str:
    """Return the description of a phase; empty for the last phase."""
    return "" if phase == Phase.DONE.value else words(f"phase_full.{phase}")


def verdict_document(session: Session, headline: Headline) -> dict[str, Any]:
    """Return the verdict of the full page."""
    words, result = session.words, headline.result
    text, why = _full_texts(session, headline)
    if headline.bin is not None:
        is_final, name = not headline.bin.again, headline.bin.name
        text = name if is_final else words("bin.provisional", bin=name)
    measured, firm = ", ".join(headline.measured(words)), ""
    if headline.bin is not None:
        # What the bin rests on combines all grasps of the item: no second number next to it.
        firm = measured = headline.evidence
    elif result is not None and headline.report is not Report.DAMAGED:
        firm = str(verdict(result, target_force_n=None)["firmness"] or "")
    return {
        "report": headline.report,
        "text": text,
        "kind": headline.kind,
        "why": why,
        "firmness": firm,
        "measured": measured,
        "bin": "" if headline.bin is None else headline.bin.name,
        "is_grasp": result is not None,
        "target_force_n": headline.target_force_n,
        "on_target": headline.on_target,
    }


def _full_texts(session: Session, headline: Headline) -> tuple[str, str]:
    """Return text and reason of the full page's verdict."""
    words, report = session.words, headline.report
    if report is Report.ACTIVITY:
        return activity_text(session.devices.activity, words), ""
    if report is Report.PHASE:
        text = phase_text(headline.phase, words)
    elif report is Report.OUTCOME:
        text = words(f"outcome_full.{headline.outcome}")
    else:
        text = words(f"full.{report}")
    if report in _FAULTS:
        return text, words(f"why.{report}")
    if report in _CALIBRATION:
        source = session.devices.live.source
        is_calibrated = source is not None and source.rest_ohm is not None
        return text, words(f"why.calibration_{'kept' if is_calibrated else 'none'}")
    if report in _INTERRUPTED and (interrupted := session.devices.interrupted) is not None:
        return text, interruption_text(interrupted, words)
    if report is Report.DAMAGED:
        return text, words(f"outcome_full.{headline.outcome}")
    if headline.bin is not None:
        return text, text
    if headline.no_bin:
        why = _no_bin_reason(session.devices, headline, words)
        return text, words("why.no_bin", why=why) if why else words("word.no_bin").lower()
    return text, words("why.passed_limit") if headline.has_passed_limit else ""


def operator_document(session: Session, headline: Headline) -> dict[str, Any]:
    """Return the texts of the operator's page.

    ``word``, ``detail``: the verdict. ``is_bin``: whether its word is a final bin. ``color``: the
    number of its colour. ``item``: the end of the item's name. ``next``: the next step, on the
    screen that controls. ``is_refused``: whether the entered name is refused, which the next step
    then says. ``watch``: the text in its place on other screens. ``badge``: a note that the grasp
    is not stored. ``opens``: the countdown before the gripper opens by itself. ``is_past``: whether
    the verdict is that of another item than the scanned one, or of another lot.
    """
    words, form, devices = session.words, session.form, session.devices
    target_force_n = form.target_force_n
    measured = [headline.evidence] if headline.evidence else headline.measured(words)
    if headline.bin is not None and headline.bin.again:
        measured.insert(0, words("bin.so_far", bin=headline.bin.name))
    if devices.activity in (DeviceActivity.GRASPING, DeviceActivity.REPLAYING):
        target_force_n = session.shown_target_n
    is_past = form.is_refused or (form.item_id != "" and not form.is_returned) or devices.is_past
    return {
        "word": _capitalize(_operator_word(session, headline)),
        "detail": _operator_detail(headline, devices, words),
        "measured": ", ".join(measured),
        "is_bin": headline.bin is not None and not headline.bin.again,
        "color": _bin_color(session, headline),
        "item": short_name(devices.item_id) if headline.result is not None else "",
        "next": _capitalize(_next_step(session, headline)),
        "is_refused": form.item_id != "" and session.name_fault != "",
        "watch": _watch_text(session, headline),
        "badge": words("badge.interrupted")
        if devices.interrupted is not None and headline.report in _INTERRUPTED
        else ""
        if headline.result is None
        else store_note(devices, words),
        "opens": "" if session.silence_s is not None else _countdown(devices, headline, words),
        "is_past": is_past and headline.result is not None and devices.grasped is not None,
        "target": words("target.none")
        if target_force_n is None
        else words("target.force", force=f"{target_force_n:g}"),
    }


def _bin_color(session: Session, headline: Headline) -> int | None:
    """Return the number of a bin's colour, from 0; None for amber, red and without a bin."""
    name = headline.bin.name if headline.bin is not None and headline.kind == "good" else ""
    return session.bins.index(name) % BIN_COLORS if name in session.bins else None


def _operator_word(session: Session, headline: Headline) -> str:
    words, report = session.words, headline.report
    if report is Report.ACTIVITY:
        return activity_text(session.devices.activity, words)
    if headline.bin is not None:
        # A provisional bin must not look like the final one.
        return words("word.turn") if headline.bin.again else headline.bin.name
    if headline.no_bin:
        # Nor must a firmness look like a bin.
        return words("word.no_bin")
    is_measured = report is Report.PHASE and headline.phase == Phase.HOLD.value
    if report is Report.PHASE and not (is_measured and headline.result is not None):
        return words(f"phase.{headline.phase}")
    if report not in (Report.PHASE, Report.OUTCOME):
        return words(f"word.{report}")
    if headline.outcome not in (None, Outcome.HELD):
        return words(f"outcome.{headline.outcome}")
    if headline.on_target is False:
        return words("phase.hold" if is_measured else "word.off_target")
    return headline.firmness_word or words("phase.hold" if is_measured else "outcome.held")


def why_default(placement: Placement, words: Words) -> str:
    """Return why an item gets the default bin; empty for another bin, or without one."""
    decision = None if placement.done is None else placement.done.decision
    if (given := placement.given) is not None:
        measured = "-" if decision is None else decision.bin
        return words("why.given", name=given.giver, measured=measured)
    if decision is None or decision.rule is not None:
        return ""
    closest = decision.closest
    if closest is None:
        return decision.applied
    found, required = percent(decision.closest_probability), percent(closest.confidence)
    return words("why.closest", bin=closest.bin, percent=found, required=required)


def _operator_detail(headline: Headline, devices: DeviceState, words: Words) -> str:
    """Return what the word above does not say."""
    texts = []
    if headline.bin is not None and headline.bin.rule is None and not headline.bin.again:
        texts.append(devices.why_default)
    if headline.result is not None and devices.placed is not None and devices.placed.stored:
        texts.append(words("detail.stored"))
    if devices.interrupted is not None and headline.report in _INTERRUPTED:
        texts.append(interruption_text(devices.interrupted, words))
    if headline.report is Report.OUTCOME and headline.outcome is Outcome.HELD:
        hold_s = f"{HOLD_S:g}"
        is_alone = devices.is_released_alone
        texts.append(words("detail.held_alone", hold_s=hold_s) if is_alone else "")
    elif headline.report is Report.OUTCOME:
        texts.append(words(f"detail.{headline.outcome}"))
    if headline.no_bin:
        texts.append(_no_bin_reason(devices, headline, words))
    if headline.has_passed_limit:
        texts.append(words("why.passed_limit"))
    return "; ".join(filter(None, texts))


def _next_step(session: Session, headline: Headline) -> str:
    words, devices, report = session.words, session.devices, headline.report
    again = headline.bin is not None and headline.bin.again
    if report is Report.GONE:
        return words("next.gone")
    if session.silence_s is not None:
        return words("next.hung")
    if devices.guide is not None:
        return devices.guide.text
    if devices.activity is DeviceActivity.IDLE:
        return words("next.no_rig")
    if devices.activity is DeviceActivity.GRASPING:
        if headline.phase == Phase.HOLD.value and headline.result is None:
            return words("next.wait")
        if headline.phase == Phase.HOLD.value:
            if session.form.item_id and session.name_fault:
                return session.name_fault
            if headline.no_bin:
                return words("next.no_bin_held")
            return words("next.turn_held" if again else "next.take")
        return words("next.away")
    if devices.activity is not DeviceActivity.WATCHING:
        return words("next.wait")
    if report in _CALIBRATION:
        return words("next.calibrate")
    if report in _FAULTS:
        return words(f"next.{report}")
    if devices.is_sensor_only:
        return words("next.pads")
    if devices.live.is_hand_open is False:
        is_holding = headline.result is not None and headline.outcome in _HOLDING_OUTCOMES
        return words("next.release_item" if is_holding else "next.release")
    form = session.form
    if (form.item_id or form.is_refused) and session.name_fault:
        return session.name_fault
    if form.why is Unfinished.NOT_STORED and form.item_id and devices.item_id == form.pending:
        return words("next.not_stored", item=short_name(form.pending))
    if report is Report.INTERRUPTED and devices.interrupted is not None and not form.item_id:
        item_id = devices.interrupted.item_id
        return words("next.interrupted" if item_id else "next.again", item=short_name(item_id))
    if report in (Report.SENSOR_BACK, Report.INTERRUPTED) or (
        report is Report.STOPPED_OPEN and form.is_returned
    ):
        return words("next.again")
    if report is Report.DAMAGED:
        return words("next.aside")
    if headline.no_bin:
        return words("next.no_bin")
    if again:
        return words("next.turn")
    outcome = headline.outcome if report is Report.OUTCOME and headline.outcome else Outcome.HELD
    return (outcome is Outcome.HELD and session.name_fault) or words(f"next.{outcome}")


def interruption_text(interrupted: Interruption, words: Words) -> str:
    """Return which item was in the hand when a grasp was cut off, and when."""
    at = datetime.fromisoformat(interrupted.began_at).astimezone()
    item = interrupted.item_id
    return words("interrupted" if item else "interrupted.unnamed", item=item, at=f"{at:%H:%M}")


def _watch_text(session: Session, headline: Headline) -> str:
    """Return the text in place of the next step on a screen that does not control."""
    if headline.report is Report.GONE or session.silence_s is not None:
        # What everybody may do.
        return _next_step(session, headline)
    driver = session.driver_name
    return session.words("watch", name=driver) if driver else session.words("watch.nobody")


def store_note(devices: DeviceState, words: Words) -> str:
    """Return the note that the shown grasp is not stored; empty if it is, or is running."""
    if not devices.not_stored:
        return ""
    if not devices.item_id:
        return words("badge.unnamed")
    return words("badge.fault", why=_fault_text(devices.not_stored, words))


def _no_bin_reason(devices: DeviceState, headline: Headline, words: Words) -> str:
    """Return why an item has no bin; empty if the note on the store has the same reason."""
    is_noted = devices.item_id != "" and devices.not_stored == headline.no_bin
    return "" if is_noted else _fault_text(headline.no_bin, words)


def _fault_text(fault: str, words: Words) -> str:
    """Return the words of a fault of the store; other reasons are shown unchanged."""
    return words(f"fault.{fault.name.lower()}") if isinstance(fault, StoreFault) else fault


def _countdown(devices: DeviceState, headline: Headline, words: Words) -> str:
    """Return when the gripper opens by itself; empty unless it holds an object."""
    progress = devices.live.progress
    is_held = devices.activity is DeviceActivity.GRASPING and headline.phase == Phase.HOLD.value
    if progress is None or not is_held:
        return ""
    # The last phase is the hold.
    since_s, _ = devices.live.phases[-1]
    left_s = HOLD_S - (progress.time_s - since_s)
    return words("opens_in", s=max(0, math.ceil(left_s)))


def _capitalize(text: str) -> str:
    return text[:1].upper() + text[1:]
