"""Force of successive frames with its limits, from the law of a calibration."""

from __future__ import annotations

import numpy as np

from palpate.estimate.force import StaticLaw, law_from_dict
from palpate.estimate.force_follower import ForceFollower
from palpate.estimate.force_law import ForceLaw
from palpate.measurement import Status
from palpate.sensor.calibration import Calibration
from palpate.sensor.sample import Sample


class FrameForce:
    """Converts samples to force.

    Attributes
    ----------
    has_history : bool
        Whether the law needs every frame.
    """

    def __init__(self, calibration: Calibration) -> None:
        law = calibration.force_law
        self._law: StaticLaw | None = law_from_dict(law) if law.get("law") == "power" else None
        self.has_history = law.get("law") == ForceLaw.name
        self._follower = ForceFollower(ForceLaw.from_dict(law)) if self.has_history else None

    def limits_n(self, sample: Sample) -> tuple[float, ...]:
        """Return force, lower and upper limit; empty without a law or a readable pixel.

        With a saturated or lost pixel the force is its lower limit, and the upper limit infinite.
        """
        if self._follower is not None:
            now = self._follower.step(
                sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
            )
            if now.status is Status.NOT_MEASURED:
                return ()
            value, low, high = now.value, now.low, now.high
        elif self._law is not None and not np.isnan(sample.excess).all():
            found = self._law.force_n(np.maximum(np.nansum(sample.excess), 0.0))
            value, low, high = (float(one) for one in (found.value, found.low, found.high))
        else:
            return ()
        if sample.has_saturated or sample.has_lost or value is None:
            return low, low, np.inf
        return value, low, high
