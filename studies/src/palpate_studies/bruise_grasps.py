"""Grasps of twin apples by a user's steps: search for contact, close on, hold, read every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.produce.bruise.shape import LoadShape, shape_of
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import (
    CONTACT_PERCENT,
    mean_change,
    relative_change_percent,
)
from palpate.twin.devices import TwinArray
from palpate_studies.twin_apple import Apple
from palpate_studies.twin_session import HOLD_S, SETTLED_MEAN_S, Session

#: The fingers stand this wide before an apple whose size nobody knows, and this much wider than
#: the last contact before the next grasp of the same one.
OPEN_MM, GAP_MM = 72.0, 8.0
#: Speed while looking for contact, and how far they close on, fast, from where it was seen.
SEARCH_MM_PER_S, CLOSURE_MM = 6.0, 2.0
#: Still time of the open fingers before each grasp; its last half second gives the rest values.
REST_S = 10.0
#: The early answer.
CUTOFF_S = 2.5
_TIGHTEST_MM = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplePress:
    """One grasp of one apple.

    Attributes
    ----------
    width_mm : float
        Width at which contact was seen, the closure before the end where none was looked for.
    time_s : ndarray, shape (times,)
        From the moment that the fingers close on, up to the early answer.
    change_percent : ndarray, shape (times, rows, cols)
        Relative change of each pixel then.
    settled_percent : ndarray, shape (rows, cols)
        The same after 20 s.
    """

    width_mm: float
    time_s: FloatArray
    change_percent: FloatArray
    settled_percent: FloatArray

    def shape(self, cutoff_s: float) -> LoadShape:
        """Return how the load lies: the last three frames before a time, or (20 s) the end."""
        change = self.settled_percent
        if cutoff_s < HOLD_S:
            change = self.change_percent[self.time_s <= cutoff_s][-3:].mean(axis=0)
        return shape_of(change, width_mm=self.width_mm)

    @property
    def mean_percent(self) -> float:
        """The paper's aggregate after 20 s: the mean over all pixels."""
        return float(mean_change(self.settled_percent))


def press(
    session: Session,
    apple: Apple,
    *,
    angle_deg: float,
    open_mm: float = OPEN_MM,
    to_mm: float | None = None,
) -> ApplePress:
    """Lay an apple between the fingers, one side to the first of them, and grasp it.

    The fingers close slowly until both feel the paper's 10 %, then on by a fixed way;
    or, without looking for contact, to a width that is given.
    """
    clock, world = session.world.clock, session.world
    session.close_to(open_mm)
    clock.sleep_s(1.0)
    world.place(apple.facing(angle_deg))
    clock.sleep_s(REST_S - 1.0 - SETTLED_MEAN_S)
    rest_ohm = session.mean_ohm()
    width_mm = _search(session, rest_ohm) if to_mm is None else to_mm + CLOSURE_MM
    session.close_to(width_mm - CLOSURE_MM)
    change = relative_change_percent(session.read(CUTOFF_S), rest_ohm=rest_ohm)
    clock.sleep_s(HOLD_S - CUTOFF_S - SETTLED_MEAN_S)
    settled = relative_change_percent(session.mean_ohm(), rest_ohm=rest_ohm)
    return ApplePress(
        width_mm=width_mm,
        time_s=np.arange(1, len(change) + 1) / world.frame_rate_hz,
        change_percent=change,
        settled_percent=settled,
    )


def _search(session: Session, rest_ohm: FloatArray) -> float:
    """Close slowly until a pixel of every finger feels something; return the width reported.

    Until both fingers touch, the first one only pushes the fruit along.
    """
    session.close_to(_TIGHTEST_MM, speed_mm_per_s=SEARCH_MM_PER_S)
    array, layout = TwinArray(session.world), session.world.layout
    lightest = 0.0
    while lightest > CONTACT_PERCENT:
        ohm = resistance_ohm(array.read(timeout_s=1.0).counts, divider=layout.divider)
        change = relative_change_percent(ohm, rest_ohm=rest_ohm)
        lightest = max(
            float(change[layout.finger_mask(finger)].min()) for finger in range(layout.fingers)
        )
    array.close()
    return session.gripper.state().width_mm
