"""When is a prediction's interval narrow enough to act on?

The rule behind ``palpate settle --until-half-width PERCENT``: the first sample at which the
interval is narrow enough twice in a row. One narrow interval may be luck; two seldom are.

>>> from palpate.settling.relaxation import Relaxation
>>> import numpy as np
>>> time_s = np.arange(0.0, 10.0, 0.1)
>>> hold = 100.0 - 5.0 * np.log(time_s + 0.4)
>>> decision = find_decision(time_s, hold, method=Relaxation(), half_width_percent=4.0)
>>> bool(decision.decided), bool(decision.time_s < 8.0), decision.estimate.method
(True, True, 'relaxation')
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.settling.result import SettledEstimate, SettlingMethod, Status

#: No decision before this: contact bounces of real presses last about as long.
EARLIEST_S = 0.5
#: Evaluations are spaced geometrically, because a prediction changes with the logarithm of time.
EVALUATION_RATIO = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """When a hold was called, and the estimate at that moment.

    Attributes
    ----------
    time_s : float
        Time of the last sample used.
    estimate : SettledEstimate
        The prediction at that time, with scalar fields.
    decided : bool
        False where the hold ended before the interval was narrow enough: then `time_s` is its last
        sample before the horizon.
    """

    time_s: float
    estimate: SettledEstimate
    decided: bool


def find_decision(
    time_s: ArrayLike,
    values: ArrayLike,
    *,
    method: SettlingMethod,
    half_width_percent: float,
    horizon_s: float = 20.0,
    level: float = 0.9,
) -> Decision:
    """Return the first prediction of one hold with two successive half-widths small enough.

    Parameters
    ----------
    time_s, values : array_like, shape (n_times,)
        One hold; every evaluation uses only the samples up to its own time.
    method : SettlingMethod
        Any method whose intervals are finite.
    half_width_percent : float
        Largest half-width of the interval, in percent of the predicted value.
    horizon_s, level : float
        As in `SettlingMethod.predict`.

    Returns
    -------
    Decision

    Raises
    ------
    ValueError
        If `half_width_percent` is not positive, or no sample lies at or before the horizon.
    """
    if not half_width_percent > 0:
        raise ValueError(f"half_width_percent must be positive, not {half_width_percent:g}")
    times = np.asarray(time_s, dtype=np.float64)
    samples = np.asarray(values, dtype=np.float64)
    stops = _count_samples(times[times <= horizon_s])
    was_narrow = False
    for stop in stops:
        estimate = method.predict(
            times[:stop], samples[None, :stop], horizon_s=horizon_s, level=level
        ).hold(0)
        half_width = (estimate.high - estimate.low) / 2
        widest = half_width_percent / 100 * np.abs(estimate.value)
        narrow = bool(estimate.status == Status.OK and half_width <= widest)
        if narrow and was_narrow:
            return Decision(time_s=float(times[stop - 1]), estimate=estimate, decided=True)
        was_narrow = narrow
    return Decision(time_s=float(times[stops[-1] - 1]), estimate=estimate, decided=False)


def _count_samples(times: FloatArray) -> list[int]:
    """Return how many samples each evaluation uses: geometrically spaced, the last one always."""
    if times.size == 0:
        raise ValueError("no sample at or before the horizon")
    stops: list[int] = []
    next_evaluation_s = times[0] + EARLIEST_S
    for index, time in enumerate(times):
        if time >= next_evaluation_s:
            stops.append(index + 1)
            next_evaluation_s = times[0] + EVALUATION_RATIO * (time - times[0])
    if not stops or stops[-1] != times.size:
        stops.append(times.size)
    return stops
