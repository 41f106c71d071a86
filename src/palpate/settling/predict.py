"""`predict_settled`: prediction of the settled value from the first seconds of a hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds import Hold
from palpate.settling.baselines import LogLaw, Recorded
from palpate.settling.exponential import Exponential
from palpate.settling.percent import adapt_method
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate, SettlingMethod

#: Cut-off of the paper, seconds (section 2.2).
CUTOFF_S = 2.5
#: Factory of each uncalibrated method, by name on the command line and in `predict_settled`.
METHODS: Mapping[str, Callable[[], SettlingMethod]] = MappingProxyType(
    {
        "recorded": Recorded,
        "exponential": Exponential,
        "log_law": LogLaw,
        # Starts earlier: better in the first second of creep, worse after a contact.
        "log_law_early": partial(LogLaw, name="log_law_early", wait_s=0.1, from_s=0.4),
        "relaxation": Relaxation,
    }
)


def find_method(method: str | SettlingMethod) -> SettlingMethod:
    """Return an uncalibrated method by its name; return another method unchanged.

    Raises `InputError` for an unknown name; the message lists all methods.
    """
    if not isinstance(method, str):
        return method
    if method not in METHODS:
        raise InputError(f"no method {method!r}; available: {', '.join(METHODS)}")
    return METHODS[method]()


def name_methods(methods: Iterable[str | SettlingMethod]) -> dict[str, SettlingMethod]:
    """Return methods, given by name or as objects, by their names.

    Raises `InputError` for an unknown name, or two methods of one name.

    >>> [*name_methods(["recorded", LogLaw(name="mine")])]
    ['recorded', 'mine']
    """
    found: dict[str, SettlingMethod] = {}
    for method in map(find_method, methods):
        if found.setdefault(method.name, method) != method:
            raise InputError(
                f"two methods are named {method.name!r}; give one of them another name"
            )
    return found


def predict_settled(
    time_s: ArrayLike | Hold,
    values: ArrayLike | None = None,
    *,
    cutoff_s: float = CUTOFF_S,
    horizon_s: float = 20.0,
    method: str | SettlingMethod = "relaxation",
    level: float = 0.9,
    unit: str | None = None,
) -> SettledEstimate:
    """Predict the settled value of a hold from its samples up to a cut-off.

    Parameters
    ----------
    time_s : Hold or array_like, shape (n_times,)
        A hold, with its unit; or strictly increasing sampling times, seconds. Time
        0 is the actuation or the peak. Sampling may be uneven.
    values : array_like, shape (n_times,) or (n_holds, n_times)
        One hold or a batch of holds, in any unit; omitted if `time_s` is a hold. Samples after the
        cut-off are ignored.
    cutoff_s : float
        Only samples with ``time_s <= cutoff_s`` are used.
    horizon_s : float
        Time of the value to predict, not before the cut-off.
    method : str or SettlingMethod
        ``"relaxation"`` (palpate's), ``"exponential"`` (the paper's), ``"recorded"``,
        ``"log_law"`` or ``"log_law_early"``, or your own method, such as a calibrated method.
    level : float
        Coverage probability of the interval, between 0 and 1.
    unit : str, optional
        ``"percent"`` for changes relative to rest: rest is 0 and the lower bound is -100. Other
        units are not needed.

    Returns
    -------
    SettledEstimate
        Scalar fields for one hold, arrays of shape (n_holds,) for a batch.

    Raises
    ------
    InputError
        (a `ValueError`) If shapes do not match, times do not increase, a sample is not finite,
        there is no sample before the cut-off, or an option is out of range.

    Examples
    --------
    >>> time_s = np.arange(0.0, 2.5, 1 / 15)
    >>> hold = 40 * np.exp(-1.2 * time_s) - 60
    >>> settled = predict_settled(time_s, hold, cutoff_s=2.5, method="exponential")
    >>> round(float(settled.value), 6), settled.status.value
    (-60.0, 'ok')
    >>> recorded = Hold(hold_id="a", channel=None, time_s=time_s, values=hold, unit="percent")
    >>> round(float(predict_settled(recorded, method="exponential").value), 6)
    -60.0
    """
    if isinstance(time_s, Hold):
        if values is not None:
            raise InputError("a hold already has its values; omit `values`")
        unit = unit or time_s.unit
        times, samples = time_s.time_s, time_s.values
    elif values is None:
        raise InputError("give a Hold, or both time_s and values")
    else:
        times = np.asarray(time_s, dtype=np.float64)
        samples = np.asarray(values, dtype=np.float64)
    if times.ndim != 1 or samples.ndim not in (1, 2) or samples.shape[-1] != times.size:
        raise InputError(
            f"values of shape {samples.shape} don't fit time_s of shape {times.shape}; give time_s "
            "of shape (n_times,) and values of shape (n_times,) or (n_holds, n_times)"
        )
    if not cutoff_s <= horizon_s < np.inf:
        raise InputError(
            f"cutoff_s {cutoff_s:g} and horizon_s {horizon_s:g}: give finite times, with the "
            "cut-off not after the horizon"
        )
    if not 0 < level < 1:
        raise InputError(f"level {level:g}: give a probability between 0 and 1, such as 0.9")
    predictor = adapt_method(find_method(method), unit=unit)
    stop = _count_samples(times, cutoff_s)
    used = samples.reshape(-1, times.size)[:, :stop]
    if np.count_nonzero(np.isfinite(used)) < used.size:
        row, sample = np.argwhere(~np.isfinite(used))[0]
        raise InputError(
            f"values of hold {row} at {times[sample]:g} s: {used[row, sample]} is not a finite "
            "number; remove such samples or end the hold before them"
        )
    estimate = predictor.predict(times[:stop], used, horizon_s=horizon_s, level=level)
    return estimate if samples.ndim == 2 else estimate.hold(0)


def _count_samples(times: FloatArray, cutoff_s: float) -> int:
    """Count the samples up to the cut-off; raise if times are out of order."""
    is_rising = times[1:] > times[:-1]
    if np.count_nonzero(is_rising) < times.size - 1 or not np.isfinite(times[-1:]).all():
        index = times.size - 1 if is_rising.all() else int(is_rising.argmin()) + 1
        raise InputError(
            f"time_s[{index}] is {times[index]:g} s after {times[max(index - 1, 0)]:g} s; times "
            "must be finite and increase from sample to sample"
        )
    stop = int(times.searchsorted(cutoff_s, side="right"))
    if stop == 0:
        raise InputError(f"no sample at or before cutoff_s {cutoff_s:g}; give a later cut-off")
    return stop
