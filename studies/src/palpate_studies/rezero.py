"""Re-zeroing that never swallows a held object: a pure step from frame to frame.

The rest values are taken again once after each contact, and only where nothing can be held: the
hand has opened well beyond the width at which it touched, has not closed since, has stood still for
some time, and every pixel reads steadily and near its old rest value. A hand whose opening is
unknown never re-zeroes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.signal.relative import CONTACT_PERCENT

#: Reported widths scatter by less than this, mm.
_WIDTH_NOISE_MM = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class RezeroRule:
    """When the rest values may be taken again, and how far they may go."""

    #: How far beyond the width of the contact the hand must be open. Contact is seen late, after a
    #: frame of closing and the first give of a soft object.
    clear_mm: float = 5.0
    #: How long it must stand still first (spike and creep fade), and how long is averaged then.
    still_s: float = 2.0
    average_s: float = 1.0
    #: By how much two such averages, one after the other, may differ: while a sheet still forgets
    #: its load its rest value is not there to be taken.
    settled_percent: float = 0.3
    #: A rest value may change by this much at once; a load only ever lowers it.
    fall_percent: float = 3.0
    rise_percent: float = 10.0
    #: Further than this from the calibration it stays, and a new calibration is advised.
    total_percent: float = 20.0


@dataclass(frozen=True, slots=True)
class RezeroState:
    """State of the re-zeroing. Arrays have shape (rows, cols)."""

    #: Rest values now, and those of the calibration.
    rest_ohm: FloatArray
    calibrated_ohm: FloatArray
    #: Whether some pixel shows a contact.
    touching: bool = False
    #: Width at which the last contact began; None when re-zeroed since, or before the first one.
    contact_mm: float | None = None
    #: Widest opening since then.
    widest_mm: float = -np.inf
    #: Opening at the last frame.
    width_mm: float | None = None
    #: Since when nothing can be held.
    clear_since_s: float | None = None
    #: Sum over the frames that are to be averaged, and their number.
    total_ohm: FloatArray | float = 0.0
    frames: int = 0
    #: The average before.
    averaged_ohm: FloatArray | None = None
    #: Empty, or why the sensor should be calibrated again.
    advice: str = ""

    @classmethod
    def calibrated(cls, rest_ohm: FloatArray) -> RezeroState:
        """Return the state right after a calibration of the rest values."""
        rest = np.array(rest_ohm, dtype=float)
        return cls(rest, rest)


def rezero_step(
    state: RezeroState,
    ohm: FloatArray,
    *,
    time_s: float,
    width_mm: float | None,
    moving: bool,
    rule: RezeroRule,
) -> RezeroState:
    """Take one frame; take the rest values again where nothing can be held.

    Parameters
    ----------
    state : RezeroState
        Memory.
    ohm : ndarray, shape (rows, cols)
        The frame's resistances.
    time_s : float
        Its time.
    width_mm : float or None
        Opening of the hand; None where it is not known.
    moving : bool
        Whether the fingers move.
    rule : RezeroRule
        Limits.

    Examples
    --------
    A grasp, an opening, and a rest value that has drifted by 2 %:

    >>> rule, state = RezeroRule(), RezeroState.calibrated(np.array([[1000.0]]))
    >>> history = [(1000.0, 41.0), (400.0, 40.0)] + [(1020.0, 70.0)] * 9
    >>> for second, (ohm, width_mm) in enumerate(history):
    ...     frame = np.array([[ohm]])
    ...     state = rezero_step(
    ...         state, frame, time_s=second, width_mm=width_mm, moving=False, rule=rule
    ...     )
    >>> state.rest_ohm.tolist()
    [[1020.0]]
    """
    state = _touch(state, _lowest_percent(ohm, state.rest_ohm), width_mm)
    if not _clear(state, width_mm, moving=moving, rule=rule):
        return replace(state, clear_since_s=None, total_ohm=0.0, frames=0, averaged_ohm=None)
    if state.clear_since_s is None:
        return replace(state, clear_since_s=time_s)
    waited_s = time_s - state.clear_since_s
    if waited_s < rule.still_s:
        return state
    state = replace(state, total_ohm=state.total_ohm + ohm, frames=state.frames + 1)
    if waited_s < rule.still_s + rule.average_s:
        return state
    fresh, before = np.asarray(state.total_ohm) / state.frames, state.averaged_ohm
    if before is None or _apart_percent(fresh, before) > rule.settled_percent:
        since_s = time_s - rule.still_s
        return replace(state, clear_since_s=since_s, total_ohm=0.0, frames=0, averaged_ohm=fresh)
    return _take(state, fresh, rule)


def _apart_percent(fresh: FloatArray, before: FloatArray) -> float:
    """Return the median pixel's change from one average to the next, without sign."""
    change = 100.0 * np.abs(fresh / before - 1.0)
    reads = np.isfinite(change)
    return float(np.median(change[reads])) if reads.any() else np.inf


def _lowest_percent(ohm: FloatArray, rest_ohm: FloatArray) -> float:
    """Return the change of the pixel that fell most; 0 where none reads."""
    change = 100.0 * (ohm / rest_ohm - 1.0)
    return float(np.min(change[np.isfinite(change)], initial=0.0))


def _touch(state: RezeroState, lowest_percent: float, width_mm: float | None) -> RezeroState:
    threshold = CONTACT_PERCENT * (0.5 if state.touching else 1.0)
    touching = lowest_percent <= threshold
    contact_mm, widest_mm = state.contact_mm, state.widest_mm
    closed = width_mm is None or width_mm < widest_mm - _WIDTH_NOISE_MM
    # Without closing it is what the last load left behind: as long as it shows, nothing is taken.
    if touching and not state.touching and (closed or contact_mm is None):
        # Seen at this frame, begun after the last one. Of an unknown width nothing can be clear.
        known = [mm for mm in (width_mm, state.width_mm) if mm is not None]
        contact_mm = max(known, default=np.inf)
        widest_mm = -np.inf
    if width_mm is not None:
        widest_mm = max(widest_mm, width_mm)
    return replace(
        state,
        touching=touching,
        contact_mm=contact_mm,
        widest_mm=widest_mm,
        width_mm=width_mm,
    )


def _clear(state: RezeroState, width_mm: float | None, *, moving: bool, rule: RezeroRule) -> bool:
    if width_mm is None or moving or state.touching or state.contact_mm is None:
        return False
    opened = width_mm >= state.contact_mm + rule.clear_mm
    return opened and width_mm >= state.widest_mm - _WIDTH_NOISE_MM


def _take(state: RezeroState, fresh: FloatArray, rule: RezeroRule) -> RezeroState:
    """Take the averaged frames for rest values, or keep the old ones and state why."""
    done = replace(
        state,
        contact_mm=None,
        clear_since_s=None,
        total_ohm=0.0,
        frames=0,
        averaged_ohm=None,
    )
    reads = np.isfinite(fresh)
    change = 100.0 * (fresh / state.rest_ohm - 1.0)[reads]
    total = 100.0 * (fresh / state.calibrated_ohm - 1.0)[reads]
    if (change < -rule.fall_percent).any() or (change > rule.rise_percent).any():
        worst = change[np.argmax(np.abs(change))]
        return replace(
            done,
            advice=f"a rest value moved by {worst:+.0f} % in one grasp: look for something on the "
            "sensor, then calibrate rest",
        )
    if (np.abs(total) > rule.total_percent).any():
        worst = total[np.argmax(np.abs(total))]
        return replace(
            done,
            advice=f"a rest value is {worst:+.0f} % from its calibration: calibrate force again",
        )
    return replace(done, rest_ohm=np.where(reads, fresh, state.rest_ohm), advice="")
