"""palpate's predictor: a mixture of relaxation shapes, conditioned on the samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.holds import SETTLED_WINDOW_S
from palpate.measurement import Status
from palpate.settling.conditionals import (
    compute_conditionals,
    estimate_noise,
    weigh_line,
    weigh_noise,
)
from palpate.settling.mixture import STEEPNESS, compute_posterior, compute_quantiles
from palpate.settling.origin import Rows, Window, find_updates, find_windows, group_rows
from palpate.settling.result import SettledEstimate, make_estimate

#: Holds per batch, which limits the memory.
_BATCH_SIZE = 1024
#: With samples over a shorter time than this the prediction depends only on the prior.
_MIN_DURATION_S = 0.3
#: With fewer samples noise cannot be distinguished from change.
_MIN_SAMPLES = 4
#: After a contact, whose ringing may last, a shorter time than this is too short.
_MIN_CONTACT_S = 1.5
#: Standard deviation of ln(settled / reading) for a single reading: that of the first readings of
#: 309 holds of six real materials, each alike. A single signed reading has no scale of its own.
_ALONE_SD = 0.45
#: Before this time after the origin a wide interval is reported as `too_short`, later as `misfit`.
_EARLY_S = 2.0
#: Largest useful half-width of the interval, as a fraction of the value.
_MAX_HALF_WIDTH = 0.2
#: Ratio of the settling rate per e-fold of time to the rate in the last e-fold. For 97 % of 217
#: holds of five real materials it is within this margin from 2.5 s on (study `settled`).
_PROVEN_PACE, _PACE_MARGIN = 1.2, 0.6
#: Latest horizon at which the shapes were compared with real materials, seconds. For a later one
#: each side of the interval grows by the number of e-folds of time beyond it.
_PROVEN_HORIZON_S = 20.0
#: Model error, because no curve is exact: this fraction of the forecast, and this fraction of the
#: change at the recent rate per e-fold of time. Drawn stretched exponentials need it for a coverage
#: of 0.8 (study `settled`).
_MODEL_ERROR = 0.16
#: Share of the distance to the log law: for all statuses but `ok` the value moves by it, and each
#: side of the interval grows by it. Chosen on six real materials: with one of them left out, the
#: best of 0, 1/4, 1/2, 3/4 and 1 is 3/4 again, and 1/2 without meat.
_LINE_SHARE = 0.75
#: Posterior probability from which on the samples themselves prove a single exponential (odds of
#: 100, "decisive" in Jeffreys, Theory of Probability, appendix B). The value then stays. Before
#: `_EARLY_S` meat has reached such odds and still continued; there they must be 1000, that is, all
#: components with a relevant weight are single exponentials.
_DECISIVE, _DECISIVE_EARLY = 0.99, 0.999
#: A hold that returns by more than this fraction of its change is not settling.
_MAX_RETURN = 0.3
#: Largest predicted change, as a multiple of the observed change.
_MAX_CHANGE = 10.0
#: Largest change of a logarithm, which keeps readings finite and positive.
_MAX_LOG = 600.0

#: Positive values with a smaller ratio of minimum to maximum than this are treated as signed.
_MIN_RATIO = 1e-12
#: Smallest ratio to the last reading that the log law predicts, and smallest change.
_MIN_LINE, _TINY = 1e-3, float(np.finfo(float).tiny)
_SIGNS = np.array([[-1.0], [0.0], [1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Mixture of Gaussian conditionals over relaxation shapes.

    The logarithm is used for holds with only positive samples (ohm, newton, conductance). The
    result is then independent of scale and always positive. For other holds the result is
    independent of scale, sign and offset. See `docs/prediction.md`.

    Examples
    --------
    The first two seconds of a hold that falls with the logarithm of time:

    >>> time_s = np.arange(0.0, 20.5, 0.1)
    >>> hold = 100.0 - 5.0 * np.log(time_s + 0.4)
    >>> used = time_s <= 2.0
    >>> estimate = Relaxation().predict(time_s[used], hold[None, used], horizon_s=20.0, level=0.9)
    >>> bool(estimate.low[0] < hold[200] < estimate.high[0]), estimate.status[0].value
    (True, 'ok')
    """

    name: ClassVar[str] = "relaxation"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`."""
        ends, window_s = np.empty((3, len(values))), np.empty(len(values))
        status = np.empty(len(values), dtype=object)
        for start in range(0, len(values), _BATCH_SIZE):
            batch = slice(start, start + _BATCH_SIZE)
            samples = values[batch]
            # Readings that repeat have a resolution or an update rate; so may a single reading.
            is_repeated = samples[:, 1:] == samples[:, :-1]
            is_alone = time_s.size == 1
            [repeating] = np.logical_or.reduce(is_repeated, axis=1, initial=is_alone).nonzero()
            for rows, columns, positive in _group_holds(samples, repeating):
                found = _predict(
                    time_s[columns], samples[rows][:, columns], horizon_s, level, positive=positive
                )
                ends[:, batch][:, rows], status[batch][rows], window_s[batch][rows] = found
            _widen_to_resolution(ends[:, batch], samples, repeating)
        return make_estimate(
            ends, status, window_s, horizon_s=horizon_s, level=level, name=self.name
        )


def _predict(
    time_s: FloatArray, values: FloatArray, horizon_s: float, level: float, *, positive: bool
) -> tuple[FloatArray, NDArray[np.object_], FloatArray]:
    """Return lower limit, value and upper limit, statuses and durations of the samples used.

    `positive`: whether to use logarithms.
    """
    last = values[:, -1:]
    # Changes are relative to the last sample, which keeps a constant hold exact.
    change = np.log(values / last) if positive else values - last
    ends = np.empty((3, len(change)))
    status, window_s = np.empty(len(change), dtype=object), np.empty(len(change))
    after_s = horizon_s - SETTLED_WINDOW_S / 2
    if time_s[-1] >= after_s:
        ends = _average_end(time_s, change, horizon_s=horizon_s, level=level)
        status[:], window_s[:] = Status.OK, time_s[-1] - time_s[0]
        status[np.ptp(change, axis=1) == 0] = Status.NOT_SETTLING
    else:
        beyond = max(0.0, math.log(horizon_s / _PROVEN_HORIZON_S))
        for window in find_windows(time_s, change, positive=positive):
            window_s[window.rows] = window.since_s[-1] - window.since_s[0]
            # This order of the axes is faster: operations run along the holds.
            used = np.asfortranarray(change[window.rows, window.first :])
            since_origin_s = after_s - float(time_s[window.origin])
            ends[:, window.rows], status[window.rows] = _forecast(
                window, used, positive=positive, after_s=since_origin_s, level=level, beyond=beyond
            )
    if positive:
        return last.T * np.exp(np.minimum(np.maximum(ends, -_MAX_LOG), _MAX_LOG)), status, window_s
    return last.T + ends, status, window_s


def _forecast(
    window: Window, used: FloatArray, *, positive: bool, after_s: float, level: float, beyond: float
) -> tuple[FloatArray, NDArray[np.object_]]:
    """Return lower limit, value and upper limit of a window's holds, and their statuses.

    `beyond`: number of e-folds of time from the latest proven horizon to the horizon.
    """
    since_s, duration_s = window.since_s, float(window.since_s[-1])
    span = np.maximum.reduce(used, axis=1) - np.minimum.reduce(used, axis=1)
    if since_s.size < 2:
        half = positive * ndtri((1 + level) / 2) * _ALONE_SD
        return used[:, -1] + half * _SIGNS, np.array([Status.TOO_SHORT] * len(used), dtype=object)
    time_bytes = since_s.tobytes()
    forms = compute_conditionals(time_bytes, after_s=after_s, scaled=positive)
    binned = np.add.reduceat(used, forms.starts, axis=1) / forms.sizes
    last = binned[:, -1]
    differences = binned[:, :-1] - last[:, None]
    noise = estimate_noise(forms.noise_weights, used)
    recent = -forms.pace * differences[:, forms.pace_from]
    mixture = compute_posterior(forms, differences, noise=noise)
    log_odds = math.atanh(level) * _SIGNS
    ends = compute_quantiles(mixture, log_odds)
    change = ends[1]
    error = np.hypot(change, recent) * (_MODEL_ERROR / STEEPNESS * log_odds)
    ends = change + _SIGNS * np.hypot(ends - change, error)
    largest_change = _MAX_CHANGE * span
    is_limited = np.abs(change) >= largest_change
    if np.count_nonzero(is_limited):
        shrinking = largest_change / np.maximum(np.abs(change), _TINY)
        ends *= np.where(is_limited, shrinking, 1.0)
        change = ends[1].copy()
    min_duration_s = _MIN_CONTACT_S if window.first > window.origin else _MIN_DURATION_S
    is_short = duration_s < min_duration_s or since_s.size < _MIN_SAMPLES
    is_early = duration_s <= _EARLY_S
    # A later status replaces an earlier one.
    is_off_pace = np.abs(change - _PROVEN_PACE * recent) > _PACE_MARGIN * np.abs(recent)
    chosen = is_off_pace.astype(np.intp)
    chosen[is_limited] = 2
    chosen[is_short or _is_wide(ends, span=span, positive=positive)] = 3
    chosen[_is_returning(binned)] = 4
    is_moved = chosen > 0
    if np.count_nonzero(is_moved):
        # The line is straighter for readings than for their logarithms.
        line = (np.exp(used) if positive else used).dot(weigh_line(time_bytes, after_s))
        line = (np.log(np.maximum(line, _MIN_LINE)) if positive else line) - last
        line = np.minimum(np.maximum(line, -largest_change), largest_change)
        gap = (line - change) * (_LINE_SHARE * is_moved)
        ends += _SIGNS * np.abs(gap)
        decisive = _DECISIVE_EARLY if is_early else _DECISIVE
        ends += gap * (mixture.exponential_probability() < decisive)
    if beyond:
        ends += beyond * (ends - ends[1])
    wide = Status.TOO_SHORT if is_short or is_early else Status.MISFIT
    otherwise = Status.UNPROVEN if beyond else Status.OK
    statuses = (otherwise, Status.UNPROVEN, Status.FELL_BACK, wide, Status.NOT_SETTLING)
    return last + ends, np.array(statuses, dtype=object).take(chosen)


def _is_returning(binned: FloatArray) -> NDArray[np.bool_]:
    """Return whether a reading has returned by a large part of its change, or is constant."""
    excursion = np.abs(binned - binned[:, :1])
    largest = np.maximum.reduce(excursion, axis=1)
    return np.asarray(excursion[:, -1] <= (1 - _MAX_RETURN) * largest)


def _group_holds(
    values: FloatArray, repeating: NDArray[np.intp]
) -> Iterator[tuple[Rows, slice | NDArray[np.intp], bool]]:
    """Yield groups of holds, the samples to use, and whether their logarithm is used.

    `repeating`: holds in which a sample equals the one before.
    """
    # True only for positive samples: no negative value is above a fraction of a larger one.
    positive = np.minimum.reduce(values, axis=1) > _MIN_RATIO * np.maximum.reduce(values, axis=1)
    group = positive.astype(np.intp)
    if repeating.size:
        is_changed = np.diff(values[repeating], axis=1) != 0
        # A reading that changes twice in a row is updated at every sample.
        is_current = (is_changed[:, 1:] & is_changed[:, :-1]).any(axis=1)
        first_rows: dict[bytes, int] = {}
        for row in repeating[~is_current].tolist():
            group[row] += 2 + 2 * first_rows.setdefault(find_updates(values[row]).tobytes(), row)
    for number, rows in group_rows(group):
        columns = find_updates(values[number // 2 - 1]) if number > 1 else slice(None)
        yield rows, columns, number % 2 == 1


def _widen_to_resolution(ends: FloatArray, values: FloatArray, rows: NDArray[np.intp]) -> None:
    """Widen intervals in place that are narrower than a step of the readings.

    The step is the smallest between two samples, or the last decimal of a constant reading.

    `rows`: holds to consider. If all samples of a hold differ, its noise is more than a step.
    """
    for row in rows:
        samples, (low, value, high) = values[row], ends[:, row]
        steps = np.abs(np.diff(samples))
        half = (float(steps[steps > 0].min()) if steps.any() else _last_decimal(samples[-1])) / 2
        if samples.min() > 0:
            half = min(half, value / 2)
        ends[:, row] = min(low, value - half), value, max(high, value + half)


def _last_decimal(reading: float) -> float:
    """Return the value of the last decimal of a reading.

    >>> _last_decimal(620.0), _last_decimal(3.03)
    (1.0, 0.01)
    """
    decimals = np.format_float_positional(reading, trim="-").partition(".")[2]
    return float(10.0 ** -len(decimals))


def _is_wide(ends: FloatArray, *, span: FloatArray, positive: bool) -> NDArray[np.bool_]:
    """Return whether the interval is wider than a fraction of the value.

    For signed values it is compared with the observed change.
    """
    low, value, high = ends
    if positive:
        # The bound is wide in any case, and the exponential of a larger side may overflow.
        above = np.minimum(high - value, 1.0)
        return np.asarray(np.exp(above) - np.exp(low - value) > 2 * _MAX_HALF_WIDTH)
    return np.asarray(high - low > 2 * span)


def _average_end(
    time_s: FloatArray, change: FloatArray, *, horizon_s: float, level: float
) -> FloatArray:
    """Return the mean of the last samples up to the horizon, with one sample's interval."""
    stop = max(1, int(np.searchsorted(time_s, horizon_s, side="right")))
    last = change[:, :stop][:, time_s[:stop] >= horizon_s - SETTLED_WINDOW_S]
    last = last if last.size else change[:, stop - 1 : stop]
    deviation = np.sqrt(estimate_noise(weigh_noise(time_s), change))
    return np.asarray(last.mean(axis=1) + _SIGNS * ndtri((1 + level) / 2) * deviation)
