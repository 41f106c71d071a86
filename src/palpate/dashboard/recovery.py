"""A sheet that was let go of still reads as if pressed for a while: that is no force."""

from __future__ import annotations

import math

from palpate.arrays import FloatArray

#: The sheet has recovered once every finger was this near its rest values for this time.
_NEAR_PERCENT, _CALM_S = 1.0, 1.0


class Recovery:
    """Whether an open hand's sheet still shows what the hand held before."""

    def __init__(self) -> None:
        # What happened before the first frame is not known.
        self._held, self._calm_since_s = True, math.inf

    def step(self, time_s: float, finger_percent: FloatArray, *, open_hand: bool) -> bool:
        """Take a frame; return whether it shows a load that is gone.

        `finger_percent`, shape (fingers,): mean change of each finger's pixels; NaN, where no pixel
        reads, is no calm.
        """
        if not open_hand:
            self._held, self._calm_since_s = True, math.inf
        elif not all(abs(one) < _NEAR_PERCENT for one in finger_percent):
            self._calm_since_s = math.inf
        else:
            self._calm_since_s = min(self._calm_since_s, time_s)
            self._held = self._held and time_s - self._calm_since_s < _CALM_S
        return self._held and open_hand
