"""The session as the page polls it: one JSON document, small enough to be asked for 15 times/s."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.dashboard.live import Live, finite
from palpate.dashboard.session import Activity, Session
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import firmness, outcome_text, verdict

#: The devices' process speaks twenty times a second; silent for so long, it hangs.
_HUNG_S = 1.0
_MEASURED = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent")


def document(
    session: Session, *, generation: int, after_s: float, silent_s: float = 0.0
) -> dict[str, Any]:
    """Return what a page needs to draw.

    Parameters
    ----------
    session : Session
        As it is now.
    generation, after_s : int, float
        What the page has of the curve: of another generation it needs all of it.
    silent_s : float
        How long ago the devices' process said anything.
    """
    live, link = session.live, _link(session, silent_s=silent_s)
    after_s = after_s if generation == live.generation else -math.inf
    source = live.source
    return {
        "generation": live.generation,
        "activity": session.activity.value,
        "trouble": session.trouble,
        "guide": _guide(session),
        "source": None
        if source is None
        else {
            "name": source.name,
            "subject": source.subject,
            "origin": source.origin,
            "simulated": source.simulated,
            "replayed": source.replayed,
        },
        "link": link,
        "hand": _hand(live),
        "pixels": _pixels(live),
        "curve": [[point.time_s, round(point.percent, 2)] for point in live.since(after_s)],
        "moves": list(live.moves),
        "band": [
            [band.time_s, band.low, band.value, band.high]
            for band in live.band
            if band.time_s > after_s - 1.0
        ],
        "began_s": None if live.thought is None else live.thought.began_s,
        "phase": None if live.thought is None else live.thought.phase,
        "verdict": _verdict(session, stale=link["stale"]),
        "measured": _measured(session),
        "stopped_after_s": session.stopped_after_s,
        "recording": None if session.recording is None else session.recording.name,
    }


def _guide(session: Session) -> dict[str, Any] | None:
    guide = session.guide
    if guide is None:
        return None
    return {"text": guide.text, "share": guide.share, "asks": guide.asks}


def _link(session: Session, *, silent_s: float) -> dict[str, Any]:
    pulse, hung = session.live.pulse, silent_s > _HUNG_S
    rate_hz, age_s, p99_s, worst_s = finite(
        [pulse.rate_hz, pulse.age_s + silent_s * hung, pulse.period_p99_s, pulse.period_worst_s]
    )
    waiting = session.activity in (Activity.OPENING, Activity.IDLE, Activity.REPLAYING)
    return {
        "frames": pulse.frames,
        "lost": pulse.lost,
        "corrupt": pulse.corrupt,
        "late": pulse.late,
        "undrawn": pulse.undrawn,
        "rate_hz": rate_hz,
        "age_s": age_s,
        "period_p99_s": p99_s,
        "period_worst_s": worst_s,
        "stale": hung or (pulse.stale and not waiting),
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
    }


def _pixels(live: Live) -> dict[str, Any] | None:
    if live.source is None or live.percent is None or live.ohm is None:
        return None
    return {
        "finger_of_row": live.source.layout.finger_of_row,
        "percent": [finite(row) for row in live.percent],
        "ohm": [finite(row) for row in live.ohm],
        "finger_percent": finite(live.finger_percent()),
    }


def _verdict(session: Session, *, stale: bool) -> dict[str, Any]:
    """Return the big words: of the grasp that ended, of the one that runs, or what goes on."""
    if session.activity is Activity.WATCHING and (broken := _broken(session.live, stale=stale)):
        text, why = broken
        return {"text": text, "why": why, "firmness": None, "on_target": None, "kind": "bad"}
    grasped, thought = session.grasped, session.live.thought
    if grasped is not None:
        said = verdict(grasped.result, target_force_n=session.target_force_n)
        good = grasped.result.outcome is Outcome.HELD
        return {**said, "kind": "good" if good else "bad"}
    if thought is None:
        text = "ready" if session.activity is Activity.WATCHING else session.activity.value
        return {"text": text, "firmness": None, "on_target": None, "kind": "idle"}
    stiffness = thought.answer.stiffness_n_per_mm if thought.decided else None
    return {
        "text": _PHASES.get(thought.phase, thought.phase),
        "firmness": None if stiffness is None else firmness(stiffness),
        "on_target": None,
        "kind": "good" if thought.decided else "busy",
    }


def _broken(live: Live, *, stale: bool) -> tuple[str, str] | None:
    """Return what is wrong with the sensor that is watched, and what to do; None while it reads."""
    if stale and live.pulse.frames:
        return "the sensor is silent", "check its cable and power; it goes on as soon as it answers"
    if live.percent is not None and np.isnan(live.percent).all():
        return "no pixel reads", "check the cable between sensor and board; Doctor says more"
    return None


_PHASES = {
    "approach": "closing in",
    "contact": "something is there",
    "squeeze": "squeezing gently",
    "settle": "waiting for the sheet",
    "adjust": "adjusting",
    "hold": "holding",
    "release": "giving it back",
    "stopped": outcome_text(Outcome.STOPPED),
}


def _measured(session: Session) -> dict[str, Any]:
    """Return the measurements with their intervals, and the twin's truth beside them."""
    grasped, thought = session.grasped, session.live.thought
    result: GraspResult | None = None
    truth: Mapping[str, object] = {}
    if grasped is not None:
        result, truth = grasped.result, grasped.truth or {}
    elif thought is not None:
        result = thought.answer
    rows = {name: None if result is None else getattr(result, name) for name in _MEASURED}
    return {
        "values": {name: _one(value, truth.get(name)) for name, value in rows.items()},
        "decided": grasped is not None or (thought is not None and thought.decided),
        "decision_time_s": None if result is None else result.decision_time_s,
        "limited": result is not None and result.limited,
        "damaged": truth.get("damaged"),
        "force_now_n": None if thought is None else thought.force_n,
        "faults": [] if grasped is None else list(grasped.result.faults),
    }


def _one(measured: Measurement | None, true: object) -> dict[str, Any] | None:
    if measured is None:
        return None
    value, low, high = finite([measured.value, measured.low, measured.high])
    return {
        "value": value,
        "low": low,
        "high": high,
        "status": str(measured.status),
        "truth": true,
    }
