"""Our predictor: a mixture of relaxation shapes, conditioned on the samples in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.holds import SETTLED_WINDOW_S
from palpate.settling.conditionals import conditionals, noise_variance
from palpate.settling.mixture import posterior, quantiles
from palpate.settling.origin import Window, find_renewals, windows
from palpate.settling.result import SettledEstimate, Status

#: Holds worked on at once; bounds the memory whatever the batch.
CHUNK = 512
#: A prediction from less than this after the origin has no basis but the prior.
SHORTEST_S = 0.3
#: And with fewer samples noise can't be distinguished from change.
FEWEST_SAMPLES = 4
#: This soon after a contact it may still be ringing.
RINGING_S = 1.5
#: Before this time after the origin a wide interval means that it is too early to decide; later,
#: that no shape fits.
EARLY_S = 2.0
#: An interval wider than this to either side, as a fraction of the value, is too wide to act on.
WIDEST = 0.2
#: Real materials settle at the pace per e-fold of time of the last e-fold, times a factor: 97 % of
#: 217 holds of five materials lie within these ends from 2.5 s on (study `settled`).
PROVEN_PACE = (0.6, 1.8)
#: A hold that has come back by more than this fraction of its drop is bouncing, not settling.
TURNED_BACK = 0.3
#: Nothing is predicted to go further than this many times what was seen.
FURTHEST = 10.0

#: A hold with samples below this fraction of its largest is nothing that only has a ratio.
_MIN_FRACTION = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Mixture of Gaussian conditionals over relaxation shapes.

    Holds whose samples are all positive (ohm, newton, conductance) are predicted as logarithms:
    their scale drops out, and nothing at or below zero is ever predicted. Others are predicted as
    they are: scale, sign and offset drop out. See `docs/prediction.md`.

    Attributes
    ----------
    loading_s : float
        How long the load grew before the hold, seconds; 0 where it is not known or was sudden.
        What was loaded slowly relaxes slowly.

    Examples
    --------
    The first two seconds of a hold that falls with the logarithm of time:

    >>> time_s = np.arange(0.0, 20.5, 0.1)
    >>> hold = 100.0 - 5.0 * np.log(time_s + 0.4)
    >>> seen = time_s <= 2.0
    >>> estimate = Relaxation().predict(time_s[seen], hold[None, seen], horizon_s=20.0, level=0.9)
    >>> bool(estimate.low[0] < hold[200] < estimate.high[0]), estimate.status[0].value
    (True, 'ok')
    """

    name: ClassVar[str] = "relaxation"
    loading_s: float = 0.0

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise ValueError(f"level must lie between 0 and 1, not {level:g}")
        ends = np.empty((3, len(values)))
        status, window_s = np.empty(len(values), dtype=object), np.empty(len(values))
        quantile = np.array([(1 - level) / 2, 0.5, (1 + level) / 2])
        after_s = horizon_s - SETTLED_WINDOW_S / 2
        for rows, columns, positive in _group(values):
            times, some = time_s[columns], values[rows[:, None], columns]
            last = some[:, -1:]
            # Counted from the last sample, so that a constant hold stays exactly so.
            seen = np.log(some / last) if positive else some - last
            if times[-1] >= after_s:
                found = _average_end(times, seen, horizon_s=horizon_s, quantile=quantile)
                status[rows] = Status.OK
                status[rows[np.ptp(seen, axis=1) == 0]] = Status.NOT_SETTLING
                window_s[rows] = times[-1] - times[0]
                ends[:, rows] = last.T * np.exp(found) if positive else last.T + found
                continue
            for window in windows(times, seen, positive=positive):
                for start in range(0, window.rows.size, CHUNK):
                    part = window.rows[start : start + CHUNK]
                    hold = rows[part]
                    found, status[hold] = self._forecast(
                        window,
                        seen[part, window.first :],
                        positive=positive,
                        after_s=after_s - float(times[window.origin]),
                        quantile=quantile,
                    )
                    base = last[part, 0]
                    ends[:, hold] = base * np.exp(found) if positive else base + found
                    window_s[hold] = window.since_s[-1] - window.since_s[0]
        low, value, high = ends
        return SettledEstimate(
            value=value,
            low=low,
            high=high,
            level=level,
            horizon_s=horizon_s,
            window_s=window_s,
            method=self.name,
            status=status,
        )

    def _forecast(
        self,
        window: Window,
        used: FloatArray,
        *,
        positive: bool,
        after_s: float,
        quantile: FloatArray,
    ) -> tuple[FloatArray, NDArray[np.object_]]:
        """Return low end, value and high end of holds of one window, and their statuses."""
        since_s, reach = window.since_s, used.max(axis=1) - used.min(axis=1)
        if since_s.size < 2:
            sides = np.array([-1.0, 0.0, 1.0])[:, None]
            return used[:, -1] + sides * reach, _each(len(used), Status.TOO_SHORT)
        forms = conditionals(since_s, after_s=after_s, loading_s=self.loading_s, scaled=positive)
        binned = used @ forms.averaging.T
        steps = binned[:, :-1] - binned[:, -1:]
        noise = noise_variance(since_s, used)
        ahead = quantiles(posterior(forms, steps, noise=noise, scaled=positive), quantile)
        gone = np.abs(binned - binned[:, :1])
        furthest = gone.max(axis=1)
        turned = furthest - gone[:, -1] > TURNED_BACK * furthest
        possible = np.minimum(np.maximum(ahead, -FURTHEST * reach), FURTHEST * reach)
        ends = binned[:, -1] + possible
        status = _statuses(window, ends, reach=reach, positive=positive)
        status[(possible[1] != ahead[1]) & (status == Status.OK)] = Status.FELL_BACK
        pace = -forms.pace * steps[:, forms.pace_from]
        least, most = PROVEN_PACE
        unlike = (possible[1] - least * pace) * (possible[1] - most * pace) > 0
        status[unlike & (status == Status.OK)] = Status.UNPROVEN
        status[turned | (reach == 0)] = Status.NOT_SETTLING
        return ends, status


def _group(
    values: FloatArray,
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], bool]]:
    """Yield which holds, which of their samples are renewed, and whether those are logarithms."""
    least, most = values.min(axis=1), values.max(axis=1)
    positive = (least > 0) & (least > _MIN_FRACTION * most)
    changed = values[:, 1:] != values[:, :-1]
    # A reading that changes twice in a row is renewed at every sample.
    quick = (changed[:, 1:] & changed[:, :-1]).any(axis=1)
    groups: dict[bytes, list[int]] = {}
    for row in np.flatnonzero(~quick).tolist():
        groups.setdefault(find_renewals(values[row]).tobytes(), []).append(row)
    every = np.arange(values.shape[1])
    grids = [(np.flatnonzero(quick), every)]
    grids += [(np.array(rows), np.frombuffer(key, dtype=np.intp)) for key, rows in groups.items()]
    for rows, columns in grids:
        for sign in (True, False):
            if (alike := rows[positive[rows] == sign]).size:
                yield alike, columns, sign


def _each(holds: int, status: Status) -> NDArray[np.object_]:
    return np.array([status] * holds, dtype=object)


def _statuses(
    window: Window, ends: FloatArray, *, reach: FloatArray, positive: bool
) -> NDArray[np.object_]:
    """Return whether the interval can be believed and is worth it, or why not."""
    low, value, high = ends
    lasted_s = float(window.since_s[-1])
    if window.since_s.size < FEWEST_SAMPLES or lasted_s < SHORTEST_S:
        return _each(value.size, Status.TOO_SHORT)
    if lasted_s < RINGING_S and window.first > window.origin:
        return _each(value.size, Status.TOO_SHORT)
    # As a fraction of the value; where zero is not known, no more than the change seen.
    half = (np.exp(high - value) - np.exp(low - value) if positive else high - low) / 2
    status = _each(value.size, Status.OK)
    status[half > (WIDEST if positive else reach)] = (
        Status.MISFIT if lasted_s > EARLY_S else Status.TOO_SHORT
    )
    return status


def _average_end(
    time_s: FloatArray, seen: FloatArray, *, horizon_s: float, quantile: FloatArray
) -> FloatArray:
    """Return the mean of the last samples up to the horizon, with its noise interval."""
    upto = max(1, int(np.searchsorted(time_s, horizon_s, side="right")))
    last = seen[:, :upto][:, time_s[:upto] >= horizon_s - SETTLED_WINDOW_S]
    last = last if last.size else seen[:, upto - 1 : upto]
    variance = noise_variance(time_s, seen)
    return np.asarray(last.mean(axis=1) + ndtri(quantile)[:, None] * np.sqrt(variance))
