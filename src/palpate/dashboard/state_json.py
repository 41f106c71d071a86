"""What the dashboard is doing, for machines (`docs/schemas/state.json`): it changes by events."""

from __future__ import annotations

from palpate.dashboard.session import Activity, Session


def state_document(session: Session) -> dict[str, object]:
    """Return the state of a session; equal documents mean that nothing has happened."""
    live, source = session.live, session.live.source
    # Until the devices have begun, what is known is of the grasp before.
    begun = session.activity is Activity.GRASPING and session.grasped is None
    running = live.thought if begun else None
    return {
        "activity": session.activity.value,
        "phase": None if running is None else running.phase,
        "answered": running is not None and running.decided,
        "rig": None if session.rig is None else session.rig.name,
        "simulated": None if source is None else source.simulated,
        "fresh": not live.pulse.stale and session.hung_s is None,
        "hand_open": live.open_hand,
        "driver": session.driver is not None,
        "trouble": session.trouble,
        "stopped_after_s": session.stopped_after_s,
    }
