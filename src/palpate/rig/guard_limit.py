"""The force at which a guard stops: where it is no longer certain to be below the limit."""

from __future__ import annotations

import numpy as np

from palpate.calibration import Calibration
from palpate.force.of_calibration import force_now, is_made_by_weights
from palpate.measurement import Measurement

#: A closing hand reaches the load in about this time, seconds, in as many steps.
_CLOSING_S, _STEPS = 2.0, 150
#: First and last reading of the ramp, relative to the largest one of the calibration.
_FIRST, _LAST = 1e-3, 3.0
#: Probability that the force is below the limit: the upper end of a 90 % interval.
USUAL_CERTAINTY = 0.95
#: Below this fraction of its limit a guard stops early.
_EARLY_FRACTION = 0.6


def find_stop(
    calibration: Calibration, *, limit_n: float, certainty: float = USUAL_CERTAINTY
) -> Measurement | None:
    """Return the force when it is no longer below a limit with a probability, as a hand closes.

    The load is distributed over the pixels as it was in the calibration. None if it never passes,
    or the calibration has no force law.
    """
    pairs, layout = calibration.force, calibration.layout
    if not pairs.excess:
        return None
    source, largest = force_now(calibration), max(pairs.excess)
    shape = (layout.rows, layout.cols)
    share = np.full(layout.pixels, 1.0 / layout.pixels)
    if pairs.pixel_excess:
        mean = np.mean(pairs.pixel_excess, axis=0)
        share = mean / mean.sum()
    source.step(0.0, np.zeros(shape))
    time_s = np.linspace(0.0, _CLOSING_S, _STEPS + 1)[1:]
    for at_s, part in zip(time_s, np.geomspace(_FIRST, _LAST, _STEPS), strict=True):
        found = source.step(float(at_s), largest * part * share.reshape(shape))
        if found.quantile(certainty) > limit_n:
            return found
    return None


def explain_stop(stop: Measurement | None, *, limit_n: float, calibration: Calibration) -> str:
    """Return one line on where a guard stops, and how it comes nearer to its limit; or nothing."""
    if stop is None or stop.value is None:
        return ""
    if stop.value == 0.0:
        return (
            f"a guard at {limit_n:g} N stops at once, because a force of up to {stop.high:.2g} N "
            "is not seen; use a larger limit"
        )
    text = (
        f"a guard at {limit_n:g} N stops at about {stop.value:.2g} N (interval {stop.low:.2g} to "
        f"{stop.high:.2g} N)"
    )
    if not is_early(stop, limit_n=limit_n):
        return text
    if is_made_by_weights(calibration.force):
        more = "three more weights, spread over the range, or a load cell"
    else:
        more = "more placements of the load cell"
    return f"{text}; nearer after `palpate calibrate force` with {more}, or with a lower certainty"


def is_early(stop: Measurement | None, *, limit_n: float) -> bool:
    """Return whether a guard stops much earlier than it was asked to."""
    return stop is not None and stop.middle < _EARLY_FRACTION * limit_n
