"""Force of successive frames with its limits, from the law of a calibration."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import CalibrationError
from palpate.force.force_follower import ForceSource
from palpate.force.of_calibration import force_now
from palpate.measurement import Status
from palpate.sensor.sample import Sample


class FrameForce:
    """Converts every sample to force; without measured forces to none."""

    def __init__(self, calibration: Calibration) -> None:
        self._follower: ForceSource | None = None
        with suppress(CalibrationError):
            self._follower = force_now(calibration)

    def limits_n(self, sample: Sample) -> tuple[float, ...]:
        """Return force, lower and upper limit; empty without a law or a readable pixel.

        With a saturated or lost pixel the force is its lower limit, and the upper limit infinite.
        """
        if self._follower is None:
            return ()
        now = self._follower.step(
            sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
        )
        if now.status is Status.NOT_MEASURED:
            return ()
        if sample.has_saturated or sample.has_lost or now.value is None:
            return now.low, now.low, np.inf
        return now.value, now.low, now.high
