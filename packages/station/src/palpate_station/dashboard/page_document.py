"""The state of a session as JSON, for the page and for other clients."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.phases import Phase
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.measurement import Measurement
from palpate.object.firmness import firmness_text, is_determined
from palpate.sensor.health import Health
from palpate_station.dashboard.grasp_progress import GraspProgress
from palpate_station.dashboard.guard import guard_text
from palpate_station.dashboard.headline import (
    activity_text,
    find_headline,
    operator_document,
    phase_text,
    verdict_document,
)
from palpate_station.dashboard.live import Live, finite_or_none
from palpate_station.dashboard.messages import DeviceActivity
from palpate_station.dashboard.session import Session
from palpate_station.dashboard.words import Words
from palpate_station.line.machine import LineState, line_state
from palpate_station.line.results import MEASUREMENTS

#: Maximum number of past times, and of pixel readings, sent to a newly opened page (guess).
_MAX_PAST_MOMENTS, _MAX_PAST_VALUES = 200, 20000


def state_document(session: Session) -> dict[str, object]:
    """Return the state document of a session."""
    live, source = session.devices.live, session.devices.live.source
    placed, interrupted = session.devices.placed, session.devices.interrupted
    # Until the devices start the grasp, the progress belongs to the previous grasp.
    is_grasping = (
        session.devices.activity is DeviceActivity.GRASPING and session.devices.grasped is None
    )
    running = live.progress if is_grasping else None
    found: dict[str, object] = {
        "activity": session.devices.activity.value,
        "phase": None if running is None else running.phase,
        "answered": running is not None and session.devices.is_answered,
        "bin": (placed and placed.bin_name) or None,
        "rig": None if session.rig is None else session.rig.name,
        "simulated": None if source is None else source.is_simulated,
        "fresh": not live.link.stale and session.silence_s is None,
        "hand_open": live.is_hand_open,
        "driver": session.driver is not None,
        "driver_name": session.driver_name or None,
        "trouble": session.devices.trouble,
        "stops": session.stops,
        "stopped_after_s": session.devices.stopped_after_s,
        "interrupted": None if interrupted is None else asdict(interrupted),
        "held": None,
    }
    state = line_state(found)
    found["state"], found["state_number"] = state.name.lower(), int(state)
    if state is LineState.HOLDING and running is not None:
        answers = {name: getattr(running.answer, name) for name in MEASUREMENTS}
        found["held"] = {
            "item_id": session.devices.item_id,
            "bin": (placed and placed.bin_name) or None,
            "again": placed is not None and placed.needs_regrasp,
            **{name: one and one.to_dict() for name, one in answers.items()},
        }
    return found


def document(session: Session, *, generation: int, after_s: float) -> dict[str, Any]:
    """Return the document of the page.

    Parameters
    ----------
    session : Session
        The session.
    generation, after_s : int, float
        Generation and newest time of the page's curve. The document contains later points only, or
        the whole curve if the generation differs.
    """
    live, link, words = session.devices.live, _link(session), session.words
    headline = find_headline(session, stale=link["stale"])
    after_s = after_s if generation == live.generation else -math.inf
    source = live.source
    return {
        **state_document(session),
        "trouble": words.name_parts(session.devices.trouble),
        "generation": live.generation,
        "source": None
        if source is None
        else {
            "name": source.name,
            "subject": source.subject,
            "origin": source.origin,
            "simulated": source.is_simulated,
            "replayed": source.replayed,
            "newtons": source.law is not None,
        },
        "link": link,
        "hand": _hand(
            live, live.reported, moving=live.moving, released=live.released, force=live.force
        ),
        "pixels": _pixels(session),
        "past": _past_moments(live) if after_s == -math.inf else [],
        "curve": [
            [point.time_s, round(point.percent, 2), *_newtons(point.force)]
            for point in live.points_after(after_s)
        ],
        "frozen_s": live.frozen[-1].time_s if live.frozen else None,
        "moves": list(live.moves),
        "band": [
            [band.time_s, band.low, band.value, band.high, *_newtons(band.force)]
            for band in live.band
            if band.time_s > after_s - 1.0
        ],
        "grasp": _grasp(live.progress, live, words=session.words),
        "replay": _replay(live, words=session.words),
        "guide": None if session.devices.guide is None else asdict(session.devices.guide),
        "alarms": [
            [f"{at.astimezone():%H:%M}", words.name_parts(text)]
            for at, text in session.devices.alarms
        ],
        "alarm_count": session.devices.alarm_count,
        "driver_id": session.driver,
        "guard": guard_text(session),
        "ready": session.devices.activity is DeviceActivity.WATCHING
        and (session.not_ready == "" or session.devices.is_sensor_only),
        "activity_text": activity_text(session.devices.activity, session.words),
        "verdict": verdict_document(session, headline),
        "operator": operator_document(session, headline),
        "nothing_there": headline.outcome is Outcome.NOTHING_THERE,
        "item": session.devices.item_id,
        "kind": session.form.kind,
        "measured": _list_measurements(session),
        "recording": None if session.devices.recording is None else session.devices.recording.name,
    }


def _newtons(force: Measurement | None) -> list[float]:
    """Return low, value and high rounded to 1 mN; empty without a force."""
    return [] if force is None else [round(n, 3) for n in (force.low, force.middle, force.high)]


def _replay(live: Live, *, words: Words) -> dict[str, Any] | None:
    """Return the replay position and the phases and events of the whole recording."""
    timeline, playing = live.timeline, live.playing
    if timeline is None or playing is None:
        return None
    return {
        "start_s": timeline.start_s,
        "end_s": timeline.end_s,
        "phases": _phase_texts(timeline.phases, words),
        "grasp": _grasp(timeline.ended, live, words=words),
        "time_s": playing.time_s,
        "paused": playing.paused,
        "speed": playing.speed,
    }


def _phase_texts(phases: Sequence[tuple[float, str]], words: Words) -> list[list[object]]:
    return [[time_s, phase_text(phase, words)] for time_s, phase in phases]


def _grasp(progress: GraspProgress | None, live: Live, *, words: Words) -> dict[str, Any] | None:
    """Return phase and events of the running or last grasp."""
    if progress is None:
        return None
    return {
        "phase": progress.phase,
        "phases": _phase_texts(live.phases, words),
        "began_s": progress.began_s,
        "touched_s": progress.touched_s,
        # The contact is confirmed a few frames after it: its mark is at the zero of all times.
        "moments": [
            [progress.touched_s if one.name == "contact" else one.time_s, one.name, one.finger]
            for one in progress.moments
        ],
        "fingers": [] if live.is_hand_open else _fingers_in_contact(progress.moments),
        "bounds": asdict(progress.bounds),
    }


def _fingers_in_contact(moments: Sequence[Moment]) -> list[int]:
    """Return the fingers in contact according to the controller's events."""
    touching: set[int] = set()
    for moment in moments:
        if moment.finger is not None and moment.name == "finger_contact":
            touching.add(moment.finger)
        elif moment.finger is not None and moment.name == "finger_removal":
            touching.discard(moment.finger)
    return sorted(touching)


def _link(session: Session) -> dict[str, Any]:
    link, hung_s = session.devices.live.link, session.silence_s
    hung = hung_s is not None
    counted = asdict(replace(link, age_s=link.age_s + (hung_s or 0.0)))
    waiting = session.devices.activity in (
        DeviceActivity.OPENING,
        DeviceActivity.IDLE,
        DeviceActivity.REPLAYING,
    )
    return dict(zip(counted, finite_or_none(list(counted.values())), strict=True)) | {
        "hung_s": hung_s,
        "stale": hung or (link.stale and not waiting),
        "waiting": waiting and not hung,
    }


def _hand(
    live: Live, reported: float, *, moving: bool, released: bool, force: Measurement | None
) -> dict[str, Any] | None:
    limits = None if live.source is None else live.source.gripper
    if limits is None:
        return None
    (value,) = finite_or_none([reported])
    return {
        "drive": limits.drive,
        "value": value,
        "closed": None if value is None else abs(value - limits.target(0.0)) / limits.span,
        "moving": moving,
        "open": live.is_open(reported, moving=moving),
        "opening": released and moving,
        "own_mm": _own_deflection_mm(live, force),
    }


def _own_deflection_mm(live: Live, force: Measurement | None) -> float | None:
    """Return by how much the gripper's reported width is too small; None if unknown."""
    compliance = None if live.progress is None else live.progress.compliance
    if compliance is None or force is None or not force.has_value:
        return None
    return round(float(compliance.deflection_mm(force.middle)) - compliance.zero_mm, 3)


def _pixels(session: Session) -> dict[str, Any] | None:
    live = session.devices.live
    if live.source is None or live.percent is None or live.ohm is None:
        return None
    return {
        **_pads(live, live.time_s, live.percent, live.ohm, live.force),
        "finger_of_row": live.source.layout.finger_of_row,
        "touching": live.touching_fingers,
        "findings": _pixel_findings(session.devices.health, words=session.words),
    }


def _pads(
    live: Live,
    time_s: float,
    percent: FloatArray,
    ohm: FloatArray,
    force: Measurement | None,
) -> dict[str, Any]:
    """Return the readings of all pixels and fingers at one time."""
    return {
        "time_s": finite_or_none([time_s])[0],
        "percent": [finite_or_none(row) for row in percent],
        "ohm": [finite_or_none(row) for row in ohm],
        "finger_percent": finite_or_none(live.finger_percent(percent)),
        "finger_n": [round(one, 2) for one in live.finger_forces_n(force, ohm)],
    }


def _past_moments(live: Live) -> list[dict[str, Any]]:
    """Return decimated past readings of the pads and the hand for a newly opened page."""
    points = [point for point in live.points_after(-math.inf) if point.ohm.size]
    if not points:
        return []
    released_s = next(
        (at_s for at_s, phase in live.phases if phase == Phase.RELEASE.value), math.inf
    )
    max_moments = min(_MAX_PAST_MOMENTS, max(_MAX_PAST_VALUES // points[0].ohm.size, 1))
    return [
        {
            **_pads(live, point.time_s, pixels.change_percent, point.ohm, point.force),
            "touching": point.touching,
            "hand": _hand(
                live,
                point.reported,
                moving=point.moving,
                released=point.time_s >= released_s,
                force=point.force,
            ),
        }
        for point in points[:: math.ceil(len(points) / max_moments)]
        if (pixels := live.signals_at(point.ohm)) is not None
    ]


def _pixel_findings(health: Health | None, *, words: Words) -> list[dict[str, Any]]:
    """Return the health findings for each affected pixel."""
    if health is None:
        return []
    return [
        {
            "row": row,
            "col": col,
            "severity": str(found.severity),
            "text": words.name_parts(found.text),
        }
        for found in health.findings
        for row, col in np.ndindex(*health.pixels.rest_ohm.shape)
        if found.affects_pixel(row, col)
    ]


def _list_measurements(session: Session) -> dict[str, Any]:
    """Return the measurements with intervals, and the twin's true values."""
    grasped, progress = session.devices.grasped, session.devices.live.progress
    result: GraspResult | None = None
    truth: Mapping[str, object] = {}
    if grasped is not None:
        result, truth = grasped.document.result, grasped.document.truth or {}
    elif progress is not None:
        result = progress.answer
    rows = {name: None if result is None else getattr(result, name) for name in MEASUREMENTS}
    return {
        "values": {
            name: _measurement_document(value, truth.get(name)) for name, value in rows.items()
        },
        "decided": grasped is not None or (progress is not None and progress.decided),
        "decision_time_s": None if result is None else result.decision_time_s,
        "data_s": None if progress is None else progress.data_s,
        "settled": _horizon_document(session.devices.live),
        "limited": result is not None and result.is_limited,
        "damaged": truth.get("damaged"),
        "damaged_s": truth.get("damaged_s"),
        "force_now": _measurement_document(session.devices.live.force, None),
        "holds": grasped is None and session.devices.live.is_hand_open is not True,
        "faults": []
        if result is None or grasped is None
        else [session.words.name_parts(fault) for fault in result.faults],
    }


def _horizon_document(live: Live) -> dict[str, Any] | None:
    """Return the values measured at the forecast horizon; None before the horizon."""
    if live.settled_measurement is None:
        return None
    percent, force = live.settled_measurement
    return {"settled_percent": {"value": percent}, "force_n": _measurement_document(force, None)}


def _measurement_document(measured: Measurement | None, true: object) -> dict[str, Any] | None:
    if measured is None:
        return None
    content = {"status": str(measured.status), "truth": true}
    if not measured.has_value:
        low, high = measured.known_ends
        content |= {"known": [low, None, high], "text": measured.text(digits=2)}
        return content | {"value": None, "low": None, "high": None}
    if measured.unit == "index" and not is_determined(measured):
        content["text"] = firmness_text(measured)
    value, low, high = finite_or_none([measured.middle, measured.low, measured.high])
    return content | {"value": value, "low": low, "high": high}
