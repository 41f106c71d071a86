"""The session as the page polls it: one JSON document, small enough to be asked for 15 times/s."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from palpate.dashboard.activity import Activity
from palpate.dashboard.device_state import CalibrationFailure
from palpate.dashboard.grasp_progress import GraspProgress
from palpate.dashboard.live import Live, finite
from palpate.dashboard.messages import Grasped
from palpate.dashboard.operator_view import STOPPED_OPEN, operator_view
from palpate.dashboard.session import Session
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS, outcome_text, verdict
from palpate.sensor.findings import pixel_name
from palpate.sensor.health import Health

_MEASURED = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent")


def document(
    session: Session,
    *,
    generation: int,
    after_s: float,
) -> dict[str, Any]:
    """Return what a page needs to draw.

    Parameters
    ----------
    session : Session
        As it is now.
    generation, after_s : int, float
        What the page has of the curve: of another generation it needs all of it.
    """
    live, link = session.devices.live, _link(session)
    headline = _verdict(session, stale=link["stale"])
    after_s = after_s if generation == live.generation else -math.inf
    source = live.source
    return {
        "generation": live.generation,
        "activity": session.devices.activity.value,
        "trouble": session.devices.trouble,
        "source": None
        if source is None
        else {
            "name": source.name,
            "subject": source.subject,
            "origin": source.origin,
            "simulated": source.simulated,
            "replayed": source.replayed,
            "newtons": live.newtons,
        },
        "link": link,
        "hand": _hand(live),
        "pixels": _pixels(session),
        "curve": [
            [point.time_s, round(point.percent, 2), *_newtons(point.force)]
            for point in live.since(after_s)
        ],
        "moves": list(live.moves),
        "band": [
            [band.time_s, band.low, band.value, band.high, *_newtons(band.force)]
            for band in live.band
            if band.time_s > after_s - 1.0
        ],
        "grasp": _grasp(live.progress, live),
        "replay": _replay(live),
        "verdict": {**headline, **{key: str(headline.get(key) or "") for key in _TEXTS}},
        "operator": operator_view(session, headline=headline),
        "nothing_there": headline["text"] == outcome_text(Outcome.NOTHING_THERE),
        "item": session.devices.item_id,
        "measured": _measured(session),
        "stops": session.stops,
        "stopped_after_s": session.devices.stopped_after_s,
        "recording": None if session.devices.recording is None else session.devices.recording.name,
    }


def _newtons(force: Measurement | None) -> list[float]:
    """Return low, value and high, to the milli; nothing where no force is known."""
    return [] if force is None else [round(n, 3) for n in (force.low, force.middle, force.high)]


def _replay(live: Live) -> dict[str, Any] | None:
    """Return where a replay is, and the phases and events of the whole recording."""
    timeline, playing = live.timeline, live.playing
    if timeline is None or playing is None:
        return None
    return {
        "start_s": timeline.start_s,
        "end_s": timeline.end_s,
        "phases": [[time_s, _PHASES.get(phase, "")] for time_s, phase in timeline.phases],
        "grasp": _grasp(timeline.ended, live),
        "time_s": playing.time_s,
        "paused": playing.paused,
        "speed": playing.speed,
    }


def _grasp(progress: GraspProgress | None, live: Live) -> dict[str, Any] | None:
    """Return phase and events of the grasp that runs, or ran last."""
    if progress is None:
        return None
    return {
        "phase": progress.phase,
        "began_s": progress.began_s,
        "touched_s": progress.touched_s,
        "moments": [[one.time_s, one.name, one.finger] for one in progress.moments],
        "fingers": [] if live.open_hand else _touching(progress.moments),
        "bounds": asdict(progress.bounds),
    }


def _touching(moments: Sequence[Moment]) -> list[int]:
    """Return the fingers that touch, by the controller's own events."""
    touching: set[int] = set()
    for moment in moments:
        if moment.finger is not None and moment.name == "finger_contact":
            touching.add(moment.finger)
        elif moment.finger is not None and moment.name == "finger_removal":
            touching.discard(moment.finger)
    return sorted(touching)


def _link(session: Session) -> dict[str, Any]:
    link, hung_s = session.devices.live.link, session.hung_s
    hung = hung_s is not None
    rate_hz, age_s, p99_s, worst_s = finite(
        [link.rate_hz, link.age_s + (hung_s or 0.0), link.period_p99_s, link.period_worst_s]
    )
    waiting = session.devices.activity in (Activity.OPENING, Activity.IDLE, Activity.REPLAYING)
    return {
        "frames": link.frames,
        "lost": link.lost,
        "corrupt": link.corrupt,
        "late": link.late,
        "undrawn": link.undrawn,
        "rate_hz": rate_hz,
        "age_s": age_s,
        "period_p99_s": p99_s,
        "period_worst_s": worst_s,
        "hung_s": hung_s,
        "stale": hung or (link.stale and not waiting),
        "waiting": waiting and not hung,
    }


def _hand(live: Live) -> dict[str, Any] | None:
    limits = None if live.source is None else live.source.gripper
    if limits is None:
        return None
    (value,) = finite([live.reported])
    return {
        "drive": limits.drive,
        "value": value,
        "closed": None if value is None else abs(value - limits.target(0.0)) / limits.span,
        "moving": live.moving,
        "open": live.open_hand,
        "opening": live.released and live.moving,
    }


def _pixels(session: Session) -> dict[str, Any] | None:
    live = session.devices.live
    if live.source is None or live.percent is None or live.ohm is None:
        return None
    return {
        "time_s": finite([live.time_s])[0],
        "finger_of_row": live.source.layout.finger_of_row,
        "percent": [finite(row) for row in live.percent],
        "ohm": [finite(row) for row in live.ohm],
        "finger_percent": finite(live.finger_percent()),
        "touching": live.touching,
        "findings": _on_pixels(session.devices.health),
    }


def _on_pixels(health: Health | None) -> list[dict[str, Any]]:
    """Return what was found on single pixels, rows and columns, pixel by pixel."""
    if health is None:
        return []
    rows, cols = health.pixels.rest_ohm.shape
    return [
        {"row": row, "col": col, "severity": str(found.severity), "text": found.text}
        for found in health.findings
        for row in range(rows)
        for col in range(cols)
        if found.where in (pixel_name(row, col), f"row R{row}", f"column C{col}", "every pixel")
    ]


def _verdict(session: Session, *, stale: bool) -> dict[str, Any]:
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
        return {**_WORDLESS, **_uncalibrated(failure, session.devices.live)}
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
        elif _limit_passed(grasped, damage_low_n=low_n):
            headline["why"] = "the force passed the damage limit before it was known"
        kind = kind_of(grasped, target_force_n=session.shown_target_n, damage_low_n=low_n)
        return _placed({**headline, "kind": kind}, grasped.result, session.devices.placed)
    if progress is None:
        text = session.devices.activity.value
        if session.devices.activity is Activity.WATCHING and not session.devices.sensor_alone:
            text = "ready"
        begins = session.devices.activity is Activity.GRASPING
        return {**_WORDLESS, "text": text, "kind": "busy" if begins else "idle"}
    # In its last phase, for a moment, the grasp has ended.
    text = _PHASES.get(progress.phase) or outcome_text(progress.answer.outcome)
    if not progress.decided:
        return {**_WORDLESS, "text": text, "kind": "busy"}
    headline = verdict(progress.answer, target_force_n=session.shown_target_n)
    kind = "warn" if headline["on_target"] is False else "good"
    headline |= {"text": text, "kind": kind}
    if progress.phase != "hold":
        return headline
    return _placed(headline, progress.answer, session.devices.placed)


def _placed(
    headline: dict[str, Any], result: GraspResult, placed: Mapping[str, Any]
) -> dict[str, Any]:
    """Let the bin be the headline, with what was measured below; amber for the default one."""
    found = placed.get("bin")
    if headline["kind"] == "bad" or "bin" not in placed:
        return headline
    if found is None:
        return headline | {"why": f"no bin: {placed['why']}", "kind": "warn"}
    firm = None if headline["firmness"] == UNKNOWN_FIRMNESS else headline["firmness"]
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
        f"{one.middle:.{digits}f} {unit}" if one.number else f"{_bound(one)} {unit}"
        for one, unit, digits in rows
        if one is not None and (one.number or any(one.known_ends))
    ]


def _is_stopped(session: Session) -> bool:
    """Whether the last grasp was stopped, be it before it began."""
    grasped = session.devices.grasped
    is_ended_so = grasped is not None and grasped.result.outcome is Outcome.STOPPED
    return is_ended_so or session.devices.stopped_early


#: The fields of a verdict that are text.
_TEXTS = ("text", "firmness", "why", "bin")
_OF_THEIR_OWN = (Activity.RESTING, Activity.WEIGHING, Activity.EXAMINING, Activity.RELEASING)
_WORDLESS: dict[str, Any] = {"firmness": None, "on_target": None}


def kind_of(grasped: Grasped, *, target_force_n: float | None, damage_low_n: float | None) -> str:
    """Return how a grasp ended, as a colour: nothing that went wrong is good."""
    result, truth = grasped.result, grasped.truth or {}
    on_target = verdict(result, target_force_n=target_force_n)["on_target"]
    if result.outcome is not Outcome.HELD or truth.get("damaged"):
        return "bad"
    passed = _limit_passed(grasped, damage_low_n=damage_low_n)
    return "warn" if on_target is False or result.faults or passed else "good"


def _limit_passed(grasped: Grasped, *, damage_low_n: float | None) -> bool:
    """Whether the object bore more than its learned limit: the sheet showed that too late."""
    peak_n = grasped.result.peak_force_n
    return damage_low_n is not None and peak_n is not None and peak_n > damage_low_n


def _uncalibrated(failure: CalibrationFailure, live: Live) -> dict[str, str]:
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


_PHASES = {
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
    "release": "giving it back",
}


def _measured(session: Session) -> dict[str, Any]:
    """Return the measurements with their intervals, and the twin's true values."""
    grasped, progress = session.devices.grasped, session.devices.live.progress
    result: GraspResult | None = None
    truth: Mapping[str, object] = {}
    if grasped is not None:
        result, truth = grasped.result, grasped.truth or {}
    elif progress is not None:
        result = progress.answer
    rows = {name: None if result is None else getattr(result, name) for name in _MEASURED}
    return {
        "values": {name: _one(value, truth.get(name)) for name, value in rows.items()},
        "decided": grasped is not None or (progress is not None and progress.decided),
        "decision_time_s": None if result is None else result.decision_time_s,
        "data_s": None if progress is None else progress.data_s,
        "settled": _at_horizon(session.devices.live),
        "limited": result is not None and result.limited,
        "damaged": truth.get("damaged"),
        "force_now": _one(session.devices.live.force, None),
        "holds": grasped is None and session.devices.live.open_hand is not True,
        "faults": [] if grasped is None else list(grasped.result.faults),
    }


def _at_horizon(live: Live) -> dict[str, Any] | None:
    """Return what was measured at the time that the forecast is of; None before."""
    if live.settled is None:
        return None
    percent, force = live.settled
    return {"settled_percent": {"value": percent}, "force_n": _one(force, None)}


def _one(measured: Measurement | None, true: object) -> dict[str, Any] | None:
    if measured is None:
        return None
    known = {"status": str(measured.status), "truth": true}
    if not measured.number:
        return known | {"value": None, "low": None, "high": None, "text": _bound(measured)}
    value, low, high = finite([measured.middle, measured.low, measured.high])
    return known | {"value": value, "low": low, "high": high}


def _bound(measured: Measurement) -> str:
    low, high = measured.known_ends
    if low is not None:
        return f"at least {low:.2f}"
    return "not measured" if high is None else f"at most {high:.2f}"
