"""Selection of the reference resistor for a range of pixel resistances."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from palpate.signal.circuit import Divider, resolution_ohm

#: Largest acceptable change of the reading for one count: a fifth of the paper's contact threshold.
_MAX_STEP_PERCENT = 2.0
#: A replacement must reduce the largest step by at least this factor.
_MIN_IMPROVEMENT = 2.0
_E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)


@dataclass(frozen=True, slots=True, kw_only=True)
class ResistorFit:
    """The present reference resistor and the best resistor of the E12 series."""

    #: Working range of the pixels.
    low_ohm: float
    high_ohm: float
    #: Present and recommended resistor.
    present_ohm: float
    recommended_ohm: float
    #: Change of the reading for one count at the worse end of the range, for each resistor.
    step_percent: float
    recommended_step_percent: float

    @property
    def is_adequate(self) -> bool:
        """Whether the step is acceptable, or no other resistor would reduce it substantially."""
        is_fine = self.step_percent <= _MAX_STEP_PERCENT
        return is_fine or self.step_percent < _MIN_IMPROVEMENT * self.recommended_step_percent


def fit_reference(*, low_ohm: float, high_ohm: float, divider: Divider) -> ResistorFit:
    """Compare the divider's resistor with the best resistor for a resistance range.

    The relative change of a reading for one count is (R + R_ref)^2 / (R R_ref N). It depends only
    on R / R_ref and is equal for a ratio and its inverse. The largest step in a range is therefore
    smallest if R_ref is the geometric mean of the two ends.

    `low_ohm`, `high_ohm`: lowest resistance under load, and resistance at rest.
    Raises `ValueError` if the range is empty or not positive.

    The paper's 4.7 kohm, for a pixel between 12 kohm and 40 ohm (9 counts from the end):

    >>> fit = fit_reference(low_ohm=40.0, high_ohm=12e3, divider=Divider())
    >>> fit.recommended_ohm, round(fit.step_percent, 1), round(fit.recommended_step_percent, 1)
    (680.0, 11.7, 1.9)
    """
    if not 0 < low_ohm <= high_ohm < math.inf:
        raise ValueError(
            f"the resistance range is empty or not positive: {low_ohm:g} to {high_ohm:g} ohm"
        )
    best = nearest_e12(math.sqrt(low_ohm * high_ohm))

    def largest_step_percent(candidate: Divider) -> float:
        ends = ((r, float(resolution_ohm(r, divider=candidate))) for r in (low_ohm, high_ohm))
        return max(100.0 * step / r for r, step in ends)

    return ResistorFit(
        low_ohm=low_ohm,
        high_ohm=high_ohm,
        present_ohm=divider.reference_ohm,
        recommended_ohm=best,
        step_percent=largest_step_percent(divider),
        recommended_step_percent=largest_step_percent(replace(divider, reference_ohm=best)),
    )


def nearest_e12(ohm: float) -> float:
    """Return the E12 resistor (IEC 60063) nearest to a resistance, compared as a ratio.

    >>> nearest_e12(693.0), nearest_e12(9300.0)
    (680.0, 10000.0)
    """
    decade = math.floor(math.log10(ohm))
    values = [v * 10.0 ** (decade + up) for up in (0, 1) for v in _E12]
    return float(f"{min(values, key=lambda v: abs(math.log(v / ohm))):.2g}")
