"""What the dashboard is doing, for machines (`docs/schemas/state.json`): it changes by events."""

from __future__ import annotations

from palpate.dashboard.activity import Activity
from palpate.dashboard.session import Session


def state_document(session: Session) -> dict[str, object]:
    """Return the state of a session; equal documents mean that nothing has happened."""
    live, source = session.devices.live, session.devices.live.source
    # Until the devices have begun, what is known is of the grasp before.
    begun = session.devices.activity is Activity.GRASPING and session.devices.grasped is None
    running = live.progress if begun else None
    return {
        "activity": session.devices.activity.value,
        "phase": None if running is None else running.phase,
        "answered": running is not None and running.decided,
        "bin": (session.devices.placed.get("bin") or {}).get("name"),
        "rig": None if session.rig is None else session.rig.name,
        "simulated": None if source is None else source.simulated,
        "fresh": not live.link.stale and session.hung_s is None,
        "hand_open": live.open_hand,
        "driver": session.driver is not None,
        "trouble": session.devices.trouble,
        "stops": session.stops,
        "stopped_after_s": session.devices.stopped_after_s,
    }
