"""Readings: resistances, change from rest, force and contact of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import Calibration
from palpate.errors import CalibrationError
from palpate.force.force_follower import ForceSource
from palpate.force.of_calibration import force_now
from palpate.measurement import Measurement
from palpate.sensor.array import Frame
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import CONTACT_PERCENT

#: Number of waiting frames that the memory of the force law uses.
_MOST_FOLLOWED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One frame of a rig's sensor.

    Attributes
    ----------
    time_s : float
        Scan time on the rig's clock.
    resistance_ohm : ndarray, shape (rows, cols)
        Resistance of each pixel; infinite for an open pixel.
    change_percent : ndarray, shape (rows, cols)
        Change relative to rest (equation 1); NaN for an open pixel.
    force_n : Measurement or None
        Present force; None if the calibration has no force law. With a saturated pixel, or one that
        has lost its reading, it is a lower bound, `at_least`; without a readable pixel
        `not_measured`.
    contact : bool
        Whether a pixel's change exceeds the contact threshold (paper, section 4.1).
    age_s : float
        Time from the scan to this reading.
    """

    time_s: float
    resistance_ohm: FloatArray
    change_percent: FloatArray
    force_n: Measurement | None
    contact: bool
    age_s: float = 0.0

    def __repr__(self) -> str:
        force = "no force law" if self.force_n is None else f"{self.force_n.text(digits=2)} N"
        known = self.change_percent[np.isfinite(self.change_percent)]
        change = f"{known.mean():+.1f} %" if known.size else "no pixel has a reading"
        return (
            f"Reading({self.time_s:.3f} s, {change}, {force}, "
            f"{'contact' if self.contact else 'no contact'})"
        )


class Reader:
    """Converts successive frames to readings.

    `calibration`: calibration of the sensor; `rest_ohm` may be set to newer rest values.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.rest_ohm = calibration.rest_ohm
        self._layout = calibration.layout
        self._force: ForceSource | None = None
        with suppress(CalibrationError):
            self._force = force_now(calibration)

    @property
    def has_force(self) -> bool:
        """Whether the calibration has a force law."""
        return self._force is not None

    def follow(self, frames: Sequence[Frame]) -> None:
        """Update the force with earlier frames; in a long series some suffice."""
        if self._force is not None:
            for frame in frames[:: max(len(frames) // _MOST_FOLLOWED, 1)]:
                self.read(frame)

    def read(self, frame: Frame, *, now_s: float | None = None) -> Reading:
        """Return the reading of the next frame; its age is 0 without a present time."""
        sample = SampleReader(self._layout, self.rest_ohm).read(frame, now_s=now_s)
        force = None
        if self._force is not None:
            force = self._force.step(
                sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
            )
        return Reading(
            time_s=sample.time_s,
            resistance_ohm=sample.resistance_ohm,
            change_percent=sample.change_percent,
            force_n=force,
            contact=bool(np.nanmin(sample.change_percent, initial=0.0) <= CONTACT_PERCENT),
            age_s=sample.age_s or 0.0,
        )
