"""Newtons at every frame, by the laws that a grasp reads and what it learned of its contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import ArrayLike
from scipy.special import ndtri

from palpate.errors import CalibrationError
from palpate.estimate.force import ForceEstimate, StaticLaw
from palpate.estimate.force_now import ForceNow
from palpate.estimate.gain import Gain
from palpate.estimate.measurement import Measurement
from palpate.estimate.pixel_law import PixelReading
from palpate.grasp.planning import DWELL_S, HORIZON_S, laws_of
from palpate.sensor.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLaws:
    """The two laws of a calibration, soon after a movement and settled, and what they read."""

    reading: PixelReading
    early: StaticLaw
    settled: StaticLaw

    @classmethod
    def of(cls, calibration: Calibration | None) -> ForceLaws | None:
        """Return a calibration's laws; None where it has none: then there are no newtons."""
        if calibration is None:
            return None
        try:
            reading, early, settled = laws_of(calibration.force)
        except CalibrationError:
            return None
        return cls(reading=reading, early=early, settled=settled)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactGains:
    """How the present contact reads against each of the two laws; None for what is not known."""

    early: Gain | None = None
    settled: Gain | None = None


def settled_gain(force: Measurement, *, law_n: float, law: StaticLaw) -> Gain | None:
    """Return the gain that turns what the settled law reads into a settled force.

    Parameters
    ----------
    force : Measurement
        The settled force, with all that is known of it weighed in.
    law_n : float
        What the law alone reads.
    law : StaticLaw
        The settled law.

    Examples
    --------
    >>> from palpate.estimate.pixel_law import PixelForceLaw
    >>> law = PixelForceLaw(log_scale=0.0, exponent=1.0, residual_sd=0.2, floor_n=0.01,
    ...     range=(0.1, 10.0))
    >>> force = Measurement(value=3.0, low=2.7, high=3.3, unit="n")
    >>> gain = settled_gain(force, law_n=2.0, law=law)
    >>> round(math.exp(gain.log_mean), 2), gain.log_sd < gain.law_sd
    (1.5, True)
    """
    if not (law_n > 0 and force.low > 0):
        return None
    reach = float(ndtri(0.5 + force.level / 2))
    return Gain(
        log_mean=math.log(force.middle / law_n),
        log_sd=math.log(force.high / force.low) / (2.0 * reach),
        law_sd=law.residual_sd,
    )


class GripForce:
    """Follows the force of one contact.

    Parameters
    ----------
    laws : ForceLaws
        Of the calibration.
    """

    def __init__(self, laws: ForceLaws) -> None:
        self._early, self._settled = _GainedLaw(laws.early), _GainedLaw(laws.settled)
        self._now = ForceNow(
            laws.reading,
            early=self._early,
            settled=self._settled,
            early_s=DWELL_S,
            settled_s=HORIZON_S,
        )

    def take(self, gains: ContactGains) -> None:
        """Read by these gains from now on."""
        self._early.gain, self._settled.gain = gains.early, gains.settled

    def step(self, time_s: float, excess: ArrayLike) -> Measurement:
        """Return the force at a frame; `excess` of shape (rows, cols)."""
        return self._now.step(time_s, excess)


class _GainedLaw:
    """A force law with a contact's gain in it, once that is known."""

    name: ClassVar[str] = "gained"
    reads: ClassVar[str] = "as its law"

    def __init__(self, law: StaticLaw) -> None:
        self._law = law
        self.gain: Gain | None = None

    @property
    def range(self) -> tuple[float, float]:
        return self._law.range

    @property
    def residual_sd(self) -> float:
        return self._law.residual_sd

    def force_n(self, reading: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        force = self._law.force_n(reading, level=level)
        return force if self.gain is None else self.gain.applied(force)

    def as_dict(self) -> dict[str, Any]:
        return self._law.as_dict()
