"""One line for every page: whether the rig is ready, why not, and what is guarded."""

from __future__ import annotations

import math

from palpate.grasp.safety import FORCE_CEILING_N
from palpate_station.dashboard.headline import activity_text
from palpate_station.dashboard.messages import DeviceActivity
from palpate_station.dashboard.session import Session


def guard_text(session: Session) -> str:
    """Return whether a grasp can start, and above which force a grasp ends, as one line.

    Without fresh frames nothing is checked, so no limit is stated.
    """
    words, devices, why = session.words, session.devices, session.not_ready
    live, source = devices.live, devices.live.source
    if devices.is_sensor_only:
        return words("guard.no_gripper")
    if why:
        ready = words("guard.not_ready", why=why)
    elif devices.activity is not DeviceActivity.WATCHING:
        ready = words("guard.busy", activity=activity_text(devices.activity, words))
    else:
        ready = words("guard.ready")
    is_checked = not live.link.stale and session.silence_s is None
    if source is None or source.replayed or source.law is None or not is_checked:
        return words.name_parts(ready)
    limit, rate_hz = words("guard.limit", limit=f"{FORCE_CEILING_N:g}"), live.link.rate_hz
    if session.form.kind:
        limit += words("guard.kind", kind=session.form.kind)
    if math.isfinite(rate_hz):
        limit += words("guard.rate", rate=f"{rate_hz:.0f}")
    return words.name_parts(f"{ready} · {limit}")
