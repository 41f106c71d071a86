"""Decision time of a hold: the first prediction with a sufficiently narrow interval.

This is the rule of ``palpate settle --until-half-width PERCENT``. Two successive evaluations must
have a narrow interval with status `ok`, because a single narrow interval may be accidental.

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
from palpate.measurement import Status
from palpate.settling.result import SettledEstimate, SettlingMethod

#: Time of the first evaluation, seconds: about the duration of contact bounces of real presses.
EARLIEST_S = 0.5
#: Ratio of successive evaluation times; predictions change with the logarithm of time.
EVALUATION_RATIO = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Time of a decision, and the estimate at this time.

    Attributes
    ----------
    time_s : float
        Time of the last sample used.
    estimate : SettledEstimate
        The prediction at that time, with scalar fields.
    decided : bool
        False if no two successive intervals were narrow. `time_s` is then the time of the last
        sample up to the horizon.
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
    """Return the prediction at the second of two successive narrow intervals.

    Parameters
    ----------
    time_s, values : array_like, shape (n_times,)
        Samples of one hold; each evaluation uses only the samples up to its time.
    method : SettlingMethod
        Method with finite intervals.
    half_width_percent : float
        Maximum half-width of the interval, in percent of the predicted value.
    horizon_s, level : float
        As in `SettlingMethod.predict`.

    Returns
    -------
    Decision

    Raises
    ------
    ValueError
        If `half_width_percent` is not positive, or there is no sample up to the horizon.
    """
    if not half_width_percent > 0:
        raise ValueError(f"half_width_percent must be positive, not {half_width_percent:g}")
    times = np.asarray(time_s, dtype=np.float64)
    samples = np.asarray(values, dtype=np.float64)
    counts = _count_samples(times[times <= horizon_s])
    was_narrow = False
    for count in counts:
        estimate = method.predict(
            times[:count], samples[None, :count], horizon_s=horizon_s, level=level
        ).hold(0)
        half_width = (estimate.high - estimate.low) / 2
        widest = half_width_percent / 100 * np.abs(estimate.value)
        is_narrow = bool(estimate.status == Status.OK and half_width <= widest)
        if is_narrow and was_narrow:
            return Decision(time_s=float(times[count - 1]), estimate=estimate, decided=True)
        was_narrow = is_narrow
    return Decision(time_s=float(times[counts[-1] - 1]), estimate=estimate, decided=False)


def _count_samples(times: FloatArray) -> list[int]:
    """Return the number of samples of each evaluation, geometrically spaced in time.

    The last evaluation uses all samples.
    """
    if times.size == 0:
        raise ValueError("no sample at or before the horizon")
    counts: list[int] = []
    next_evaluation_s = times[0] + EARLIEST_S
    for index, time in enumerate(times):
        if time >= next_evaluation_s:
            counts.append(index + 1)
            next_evaluation_s = times[0] + EVALUATION_RATIO * (time - times[0])
    if not counts or counts[-1] != times.size:
        counts.append(times.size)
    return counts
