"""One line for every page: whether the rig is ready, why not, and what is guarded."""

from __future__ import annotations

import math

from palpate.grasp.safety import FORCE_CEILING_N
from palpate_station.dashboard.session import Session


def guard_text(session: Session) -> str:
    """Return whether a grasp can start, and above which force a grasp ends, as one line."""
    words, live = session.words, session.devices.live
    source, why = live.source, session.not_ready
    if session.devices.is_sensor_only:
        return words("guard.no_gripper")
    ready = words("guard.not_ready", why=why) if why else words("guard.ready")
    if source is None or source.replayed or source.law is None:
        return words.name_parts(ready)
    limit, kind = f"{FORCE_CEILING_N:g}", session.form.kind
    rate_hz = live.link.rate_hz
    parts = [ready, words("guard.limit", limit=limit)]
    if kind:
        parts.append(words("guard.kind", kind=kind))
    if math.isfinite(rate_hz):
        parts.append(words("guard.rate", rate=f"{rate_hz:.0f}"))
    return words.name_parts(" · ".join(parts))
