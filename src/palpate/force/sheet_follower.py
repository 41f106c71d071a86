"""Force at every frame from the law of a sheet that was calibrated with a load cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.arrays import FloatArray
from palpate.force.force_follower import ForceSource, HistoryFollower, TouchDetector
from palpate.force.force_states import CONTACT_EXCESS
from palpate.force.gain import Gain
from palpate.force.sheet_law import SheetLaw
from palpate.force.sheet_states import SheetHistory, States
from palpate.measurement import Measurement

#: Largest excess conductance of any pixel of an empty hand, from offset and noise at rest.
_EMPTY_EXCESS = 0.03


class SheetReader(HistoryFollower["FrameForce"]):
    """Reads the force at every frame of one contact after another, by the law of a sheet.

    >>> from palpate.force.sheet_states import compute_states
    >>> time_s, force_n = np.arange(7.0), np.array([0.0, 1, 2, 4, 6, 8, 10])
    >>> law = SheetLaw.fit([(compute_states(time_s, force_n[:, None]), force_n)] * 3)
    >>> reader = SheetReader(law)
    >>> frames = (0.0, np.zeros(1)), (1.0, np.full(1, 2.0))
    >>> [round(reader.follow(*frame).force_n, 1) for frame in frames]
    [0.0, 2.1]
    """

    def __init__(self, law: SheetLaw) -> None:
        super().__init__()
        self.law = law
        self._history = SheetHistory()
        #: The last frame.
        self.excess = np.empty(0)
        self._states: States | None = None

    def _follow(self, time_s: float, excess: FloatArray) -> FrameForce:
        self.excess = excess
        seen = self.law.select_pixels(self.excess.ravel())
        self._states = self._history.step(time_s, seen)
        found = self.law.read(self._states)
        return FrameForce(
            force_n=float(found.force_n[0]),
            log_sd=float(found.log_sd[0]),
            is_beyond=bool(found.is_beyond[0]),
        )

    def settle(self, *, log_n: float = 0.0) -> FloatArray:
        """Return the excess of the last frame once its creep has ended, in the frame's shape.

        The force changes by the factor exp(log_n). A law of the sum applies to each pixel alike.

        >>> from palpate.force.sheet_states import compute_states
        >>> time_s, force_n = np.arange(7.0), np.array([0.0, 1, 2, 4, 6, 8, 10])
        >>> reader = SheetReader(
        ...     SheetLaw.fit([(compute_states(time_s, force_n[:, None]), force_n)] * 3)
        ... )
        >>> _, force = reader.follow(0.0, np.zeros(2)), reader.follow(1.0, np.array([2.0, 3.0]))
        >>> bool((reader.settle() > 1.9).all())
        True
        """
        assert self._states is not None
        seen = self.law.select_pixels(self.excess.ravel())
        now = np.exp(self._states.log_x[0]) - CONTACT_EXCESS
        later = self.law.settle(self._states, log_n=log_n)[0]
        if self.law.pixels == 1:
            factor = later / now if now > 0 else 1.0
            return np.asarray(self.excess * factor)
        return np.asarray((seen + later - now).reshape(self.excess.shape))


class FrameForce(NamedTuple):
    """Force of one frame by the law of a sheet; see `SheetForce`."""

    force_n: float
    log_sd: float
    is_beyond: bool


class SheetFollower(ForceSource):
    """Estimates the force at every frame from the pixels and their history.

    Without contact the force is 0, and its upper limit is the detection threshold.

    The law's force is the mean of the fingers' normal forces. A pad that is pressed alone, as by a
    weight, shows its own force: with p_k the share of finger k, the law's force is multiplied by
    n sum_k p_k^2, which is 1 for n equal fingers and n for one. A grasp, whose `gain` is known,
    presses all of them.

    `finger_of_row`: finger of each row of the frames.
    `gain` (attribute): gain of the present contact, if a grasp has measured it.

    >>> from palpate.force.sheet_states import compute_states
    >>> time_s, force_n = np.arange(7.0), np.array([0.0, 1, 2, 4, 6, 8, 10])
    >>> law = SheetLaw.fit([(compute_states(time_s, force_n[:, None]), force_n)] * 3)
    >>> follower = SheetFollower(law)
    >>> follower.step(0.0, [[0.0, 0.0]]).value
    0.0
    >>> estimate = follower.step(1.0, [[2.0, 3.0]])
    >>> estimate.low < 5.0 < estimate.high
    True
    """

    def __init__(
        self, law: SheetLaw, *, finger_of_row: Sequence[int] = (0,), level: float = 0.9
    ) -> None:
        super().__init__()
        self.gain: Gain | None = None
        self._fingers = [np.array(finger_of_row) == one for one in sorted(set(finger_of_row))]
        self._law, self._level = law, level
        self._threshold_n = law.threshold_n(level=level)
        self._reader, self._touch = SheetReader(law), TouchDetector()

    def split_n(self, excess: FloatArray) -> FloatArray:
        return self._law.parts_n(excess)

    def _follow(self, time_s: float, excess: FloatArray) -> Measurement:
        found = self._reader.follow(time_s, excess)
        touched = self._touch.step(excess)
        if not touched and float(np.nanmax(excess, initial=0.0)) < _EMPTY_EXCESS:
            value, low, high = 0.0, 0.0, self._threshold_n
        else:
            value, log_sd = found.force_n, found.log_sd
            if self.gain is not None:
                value, log_sd = value * self.gain.factor, self.gain.log_sd
            elif len(self._fingers) > 1:
                value *= self._pad_factor(excess)
            ends = self._law.interval_n(value, log_sd=log_sd, level=self._level)
            low, high = float(ends[0]), float(ends[1])
            if not touched:
                low, high = 0.0, max(high, self._threshold_n)
        return Measurement(value=value, low=low, high=high, unit="n", level=self._level)

    def _pad_factor(self, excess: FloatArray) -> float:
        """Return the force on the pressed pads relative to the mean over all fingers."""
        parts = self._law.parts_n(excess)
        of_finger = np.array([parts[rows].sum() for rows in self._fingers])
        return float(of_finger.size * (of_finger**2).sum() / of_finger.sum() ** 2)
