"""Pixels that fail during a grasp: open, shorted, stuck, or pressed beyond what can be read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.grasp.belief import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.sensor.findings import pixel_name
from palpate.sensor.health_pixels import at_ends

#: An end of the range must be read this often in a row: a joint that flickers once is no dead
#: pixel.
_FRAMES = 2
#: A pixel is under load when it has lost this share of its resistance, and has jumped when its
#: reading changed by this share from one frame to the next.
_LOADED, _JUMP = 0.5, 0.05
#: Every movement of the fingers shakes each pixel's reading, contact or not. A pixel that has slept
#: through this many, while no other one slept through more than `_OTHERS` of them, is stuck. Where
#: all of them slept through `_ALL_MOVES`, the frames arrive and are not new.
_MOVES, _OTHERS, _ALL_MOVES = 8, 3, 4
#: So is one that slept through fewer, for this long, while no other slept through more than one: a
#: hand that approaches at speed makes few movements. In 160 healthy simulated grasps no pixel slept
#: through two, however short.
_FEW_MOVES, _LONG_S = 2, 3.0
#: The sheet has answered a movement after this time; the reports of a hand that stands still differ
#: by less than this, mm or kPa.
_ANSWERED_S, _SAME = 0.3, 0.1
#: A sensor that flickers, so that among this many frames never more than a few in a row were alike,
#: does not fall quiet all at once: this many alike in a row are no new ones.
_SEEN, _FEW_ALIKE, _MOST_ALIKE = 30, 2, 10
#: No two pixels rest alike: where this many differ by this many counts at rest, a frame in which no
#: two differ by more than one count can't be genuine.
_SEVERAL, _UNLIKE, _EQUAL = 4, 8, 1
_SEE_DOCTOR = "run `palpate doctor`"


class PixelWatch:
    """Watches the pixels that the calibration knows; what it did not read is not missed.

    A pixel that jumps to an end of its range makes a frame doubtful, and is an alarm at its second
    frame. A short is never taken for no load: it differs from a sheet pressed beyond the
    converter's range by how it came, alone or while the fingers stood still, which no load does.
    Where a load brings a pixel to the end step by step, it reads the least that it can be, and the
    others go on; once it has brought most of those that it presses there, nothing is known of it
    any more, and that is an alarm too. A pixel that sticks in the middle of its range is known
    after eight movements of the fingers (two in three seconds or more, where the others are
    lively), all of them together after four, and in a hand that stands too where the sensor
    flickers. Pixels that all read the same are known at the second frame. A single one that sticks
    in the hold is not known here.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._layout = plan, plan.layout
        rest_ohm = np.asarray(plan.rest_ohm, dtype=float)
        self._known = np.isfinite(rest_ohm) & (rest_ohm > 0)
        # Resistance over reference: follows from the counts without knowing the reference.
        self._rest = np.where(self._known, rest_ohm, 1.0) / plan.layout.divider.reference_ohm
        resting = plan.layout.divider.full_scale / (1.0 + self._rest[self._known])
        self._unlike = resting.size >= _SEVERAL and float(np.ptp(resting)) >= _UNLIKE
        self._equal = 0
        self._counts: NDArray[np.float64] | None = None
        self._opened = np.zeros(rest_ohm.shape, dtype=int)
        self._ended = np.zeros(rest_ohm.shape, dtype=int)
        self._shorted = np.zeros(rest_ohm.shape, dtype=bool)
        self._pressed = np.zeros(rest_ohm.shape, dtype=bool)
        self._loaded = np.zeros(rest_ohm.shape, dtype=bool)
        self._slept = np.zeros(rest_ohm.shape, dtype=int)
        self._shaken = np.zeros(rest_ohm.shape, dtype=bool)
        self._awake_s = np.full(rest_ohm.shape, np.inf)
        self._now_s = 0.0
        self._counted_at = 0.0
        self._frames = self._alike = self._longest = 0
        self._closure = 0.0
        self._moved_s = -np.inf

    @property
    def doubtful(self) -> bool:
        """Whether a pixel has just jumped to an end of its range: nothing is decided on that."""
        sudden = (self._ended > 0) & ~self._pressed
        return bool((self._known & ((self._opened > 0) | sudden)).any())

    @property
    def beyond(self) -> str | None:
        """The remark on pixels that a load has brought to the end of their range, if any."""
        if not (self._known & self._pressed).any():
            return None
        return (
            f"{self._first(self._pressed)} is pressed beyond what can be read: the force may be "
            "more than measured; a smaller reference resistor reads further"
        )

    def alarm(self, observation: Observation) -> Alarm | None:
        """Take the next observation; return which pixel failed and how, None if none did."""
        frame = observation.frame
        counts = np.asarray(frame.counts, dtype=float) / frame.oversampling
        before = counts if self._counts is None else self._counts
        changed = counts != before
        self._shaken |= changed
        self._awake_s = np.where(changed, frame.time_s, np.fmin(self._awake_s, frame.time_s))
        self._now_s = frame.time_s
        self._count_alike(alike=bool((counts == before)[self._known].all()))
        equal = self._unlike and float(np.ptp(counts[self._known])) <= _EQUAL
        self._equal = self._equal + 1 if equal else 0
        moving, closure = (
            observation.gripper.moving,
            self._plan.gripper.closure(observation.gripper),
        )
        if self._counts is not None and (moving or abs(closure - self._closure) > _SAME):
            self._moved_s = frame.time_s
        self._closure = closure
        # A long way at one speed shakes the sheet at its ends only: it is one movement.
        if not moving:
            self._count_moves(closure)
        opened, ended = at_ends(counts, layout=self._layout)
        self._opened = np.where(opened, self._opened + 1, 0)
        self._ended = np.where(ended, self._ended + 1, 0)
        jumped = np.abs(counts - before) > _JUMP * np.maximum(before, 1.0)
        jumped = self._known & (jumped if self._counts is not None else ended)
        standing = frame.time_s - self._moved_s > _ANSWERED_S
        came = jumped & (~_others(jumped) | standing)
        self._loaded = self._under_load(counts)
        short = ~_others(self._loaded) | came
        begins = self._ended == 1
        self._shorted = ended & (self._shorted | (begins & short))
        self._pressed = ended & (self._pressed | (begins & ~short & ~jumped))
        # What stays at the end under a load does not sleep.
        self._shaken |= self._pressed
        self._counts = counts
        return self._found()

    def _found(self) -> Alarm | None:
        asleep = self._known & (self._slept >= _ALL_MOVES)
        if self._known.any() and ((asleep == self._known).all() or self._repeating):
            since = f"{self._alike} frames"
            if not self._repeating:
                since = f"{_ALL_MOVES} movements of the fingers"
            return Alarm(
                danger=Danger.SENSOR_LOST,
                words=f"no pixel has changed in {since}: frames arrive, and are not new; "
                f"{_SEE_DOCTOR}",
            )
        ended = self._ended >= _FRAMES
        failed = {
            "open": self._opened >= _FRAMES,
            "short": ended & self._shorted,
            "stuck": self._stuck(),
        }
        for how, mask in failed.items():
            if (mask & self._known).any():
                words = f"{self._first(mask)} reads {how}; {_SEE_DOCTOR}"
                return Alarm(danger=Danger.SENSOR_LOST, words=words)
        lost = ended & ~self._pressed
        if 2 * int((self._known & self._pressed).sum()) > int(self._loaded.sum()):
            lost = ended
        if (lost & self._known).any():
            words = f"{self._first(ended)} is pressed beyond what can be read: force unknown"
            return Alarm(danger=Danger.FORCE_LIMIT, words=words)
        if self._equal >= _FRAMES:
            words = f"all pixels read the same, which no sheet does; {_SEE_DOCTOR}"
            return Alarm(danger=Danger.SENSOR_LOST, words=words)
        return None

    def _first(self, mask: NDArray[np.bool_]) -> str:
        row, col = np.argwhere(mask & self._known)[0].tolist()
        return f"pixel {pixel_name(row, col)}"

    def _count_alike(self, *, alike: bool) -> None:
        """Count frames that repeat the one before; a run that has ended shows what is usual."""
        self._frames += 1
        if alike:
            self._alike += 1
            return
        self._longest, self._alike = max(self._longest, self._alike), 0

    @property
    def _repeating(self) -> bool:
        before = self._frames - self._alike
        flickers = before >= _SEEN and self._longest <= _FEW_ALIKE
        return flickers and self._alike > _MOST_ALIKE

    def _count_moves(self, closure: float) -> None:
        """Count the movements that each pixel has slept through."""
        if abs(closure - self._counted_at) >= self._plan.fine_step:
            self._slept = np.where(self._shaken, 0, self._slept + 1)
            self._shaken = np.zeros_like(self._shaken)
            self._counted_at = closure

    def _stuck(self) -> NDArray[np.bool_]:
        long = self._now_s - self._awake_s > _LONG_S
        return self._asleep(_MOVES, others=_OTHERS) | (self._asleep(_FEW_MOVES, others=1) & long)

    def _asleep(self, moves: int, *, others: int) -> NDArray[np.bool_]:
        """Return which pixels slept through `moves` movements, where the others were awake."""
        asleep = self._known & (self._slept >= moves)
        if not asleep.any():
            return np.asarray(asleep)
        rest = self._slept[self._known & ~asleep]
        quiet = rest.size == 0 or rest.max() > others
        return np.zeros_like(asleep) if quiet else asleep

    def _under_load(self, counts: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which pixels are under load."""
        full = self._layout.divider.full_scale
        upper = self._layout.divider.taxel_leg == "upper"
        seen = np.clip(counts if upper else full - counts, 1.0, full - 1.0)
        return np.asarray(self._known & (full / seen - 1.0 < (1.0 - _LOADED) * self._rest))


def _others(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, for each pixel, whether the mask holds for another one."""
    return np.asarray(mask.sum() - mask > 0)
