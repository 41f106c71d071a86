"""Our predictor: a mixture of relaxation shapes, conditioned on the samples in closed form."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.holds import Hold
from palpate.settling.conditionals import conditionals, noise_scatter
from palpate.settling.intervals import UNCALIBRATED, WIDENING, IntervalScale
from palpate.settling.mixture import LIGHTEST, Mixture, posterior, quantiles
from palpate.settling.odds import LOG_ODDS
from palpate.settling.origin import Window, windows
from palpate.settling.percent import without_percent
from palpate.settling.result import SettledEstimate, Status
from palpate.settling.scoring import SETTLED_WINDOW_S, settled_value

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
#: An interval wider than this to either side, as a share of the value, is too wide to act on.
WIDEST = 0.2
#: A hold that has come back by more than this share of its drop is bouncing, not settling.
TURNED_BACK = 0.3
#: Nothing is predicted to go further than this many times what was seen.
FURTHEST = 10.0
#: Window lengths at which calibration residuals are taken, s.
CALIBRATION_WINDOWS_S = (0.5, 1.0, 1.75, 2.5, 3.5, 5.0, 7.0, 10.0, 14.0)

#: A hold with samples below this share of its largest is nothing that only has a ratio.
_LEAST_SHARE = 1e-12
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Mixture of Gaussian conditionals over relaxation shapes.

    Holds whose samples are all positive (ohm, newton, conductance) are predicted as logarithms:
    their scale drops out, and nothing at or below zero is ever predicted. Others are predicted as
    they are: scale, sign and offset drop out. See `docs/prediction.md`.

    Attributes
    ----------
    log_odds : ndarray, shape (n_deviations, n_curves)
        Prior log odds of the components of `shapes`.
    scale : IntervalScale
        Width of the intervals.
    further : float
        How much further holds go than is forecast, as a share of the change seen so far.

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

    log_odds: FloatArray = field(default_factory=lambda: LOG_ODDS, repr=False)
    scale: IntervalScale = field(default=UNCALIBRATED, repr=False)
    further: float = 0.0

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return "relaxation"

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
        for rows, seen, positive in _by_sign(values):
            for part, since_s, found in self._ends(
                time_s, seen, positive=positive, horizon_s=horizon_s, level=level
            ):
                at = rows[part]
                last = values[at, -1]
                ends[:, at] = last * np.exp(found[0]) if positive else last + found[0]
                status[at], window_s[at] = found[1], since_s
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

    def _ends(
        self,
        time_s: FloatArray,
        seen: FloatArray,
        *,
        positive: bool,
        horizon_s: float,
        level: float,
    ) -> Iterator[tuple[NDArray[np.intp], float, tuple[FloatArray, NDArray[np.object_]]]]:
        """Yield which holds, the length of their window, and their ends and statuses."""
        quantile = np.array([(1 - level) / 2, 0.5, (1 + level) / 2])
        target_s = horizon_s - SETTLED_WINDOW_S / 2
        if time_s[-1] >= target_s:
            ends = _settled_already(time_s, seen, horizon_s=horizon_s, quantile=quantile)
            status = _each(len(seen), Status.OK)
            status[np.ptp(seen, axis=1) == 0] = Status.NOT_SETTLING
            yield np.arange(len(seen)), float(time_s[-1] - time_s[0]), (ends, status)
            return
        for window in windows(time_s, seen, positive=positive):
            after_s = target_s - float(time_s[window.origin])
            length_s = float(window.since_s[-1] - window.since_s[0])
            for start in range(0, window.rows.size, CHUNK):
                part = window.rows[start : start + CHUNK]
                used = seen[part, window.first :]
                yield (
                    part,
                    length_s,
                    self._settled(
                        window, used, positive=positive, after_s=after_s, quantile=quantile
                    ),
                )

    def _settled(
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
        found, binned = _weighed(
            since_s, used, positive=positive, after_s=after_s, log_odds=self.log_odds
        )
        ahead = quantiles(found, quantile)
        widening = self.scale.widening(
            float(since_s[-1] - since_s[0]), level=float(quantile[2] - quantile[0])
        )
        ahead = ahead[1] + widening * (ahead - ahead[1])
        if self.further:
            ahead += self.further * (binned[:, -1] - binned[:, 0])
        gone = np.abs(binned - binned[:, :1])
        furthest = gone.max(axis=1)
        turned = furthest - gone[:, -1] > TURNED_BACK * furthest
        if turned.any():
            ahead[0] -= turned * reach
            ahead[2] += turned * reach
        limit = FURTHEST * reach
        possible = np.minimum(np.maximum(ahead, -limit), limit)
        ends = binned[:, -1] + possible
        status = _statuses(window, ends, reach=reach, positive=positive)
        limited = possible[1] != ahead[1]
        if limited.any():
            status[limited & (status == Status.OK)] = Status.FELL_BACK
        status[turned | (reach == 0)] = Status.NOT_SETTLING
        return ends, status

    def components(
        self,
        time_s: FloatArray,
        values: FloatArray,
        *,
        horizon_s: float,
        lightest: float = LIGHTEST,
    ) -> tuple[Mixture, FloatArray] | None:
        """Return what the components forecast of one hold, and its binned samples.

        Parameters
        ----------
        time_s, values : ndarray, shape (n_times,)
            Samples up to the cut-off.
        horizon_s : float
            Time of the value to predict.
        lightest : float
            Components that weigh less than this share of the heaviest are dropped.

        Returns
        -------
        Mixture and ndarray, shape (n_bins,), or None
            Forecasts count from the last bin; all are logarithms where all values are positive.
            None where there are too few samples.
        """
        positive = bool((values > 0).all())
        seen = (np.log(values) if positive else values)[None]
        [window] = windows(time_s, seen, positive=positive)
        if window.since_s.size < FEWEST_SAMPLES:
            return None
        found, binned = _weighed(
            window.since_s,
            seen[:, window.first :],
            positive=positive,
            after_s=horizon_s - SETTLED_WINDOW_S / 2 - float(time_s[window.origin]),
            log_odds=self.log_odds,
            lightest=lightest,
        )
        return found, binned[0]

    def calibrated_on(self, holds: Iterable[Hold], *, horizon_s: float = 20.0) -> Relaxation:
        """Return a predictor whose intervals are as wide as these holds' residuals call for.

        Parameters
        ----------
        holds : iterable of Hold
            Calibration holds that reach the horizon (others are skipped), best of several
            specimens. Sampling may differ from hold to hold.
        horizon_s : float
            Time of the settled value.
        """
        plain = replace(self, scale=UNCALIBRATED)
        residuals: list[list[float]] = [[] for _ in CALIBRATION_WINDOWS_S]
        for hold in map(without_percent, holds):
            settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
            if np.isnan(settled):
                continue
            for index, window_s in enumerate(CALIBRATION_WINDOWS_S):
                seen = hold.time_s <= window_s
                if window_s >= horizon_s or seen.sum() < 2:
                    continue
                found = plain.predict(
                    hold.time_s[seen], hold.values[None, seen], horizon_s=horizon_s, level=0.9
                ).hold(0)
                side = found.high if settled > found.value else found.low
                if side != found.value:
                    ratio = (settled - found.value) / (side - found.value)
                    residuals[index].append(float(ratio) * float(ndtri(0.95)) * WIDENING)
        scale = IntervalScale(
            window_s=np.array(CALIBRATION_WINDOWS_S),
            residuals=tuple(np.sort(np.array(r)) for r in residuals),
        )
        return replace(self, scale=scale)


def _by_sign(values: FloatArray) -> Iterator[tuple[NDArray[np.intp], FloatArray, bool]]:
    """Yield which holds, what is seen of them, and whether those are logarithms.

    Counted from the last sample, so that a constant hold stays exactly so.
    """
    least, most = values.min(axis=1), values.max(axis=1)
    above_zero = np.asarray((least > 0) & (least > _LEAST_SHARE * most))
    for positive, alike in ((True, above_zero), (False, ~above_zero)):
        [rows] = alike.nonzero()
        if rows.size:
            some = values if rows.size == len(values) else values[rows]
            last = some[:, -1:]
            yield rows, np.log(some / last) if positive else some - last, positive


def _weighed(
    since_s: FloatArray,
    used: FloatArray,
    *,
    positive: bool,
    after_s: float,
    log_odds: FloatArray,
    lightest: float = LIGHTEST,
) -> tuple[Mixture, FloatArray]:
    """Return what the components forecast from the last bin on, and the binned samples.

    `since_s`, shape (n_used,): times of the samples, seconds after the origin.
    `after_s`: time of the value to predict, seconds after the origin.
    `log_odds`, `lightest`: as of `posterior`.
    """
    forms = conditionals(since_s, after_s=after_s)
    binned = used @ forms.bins.averaging.T
    found = posterior(
        forms,
        binned[:, :-1] - binned[:, -1:],
        log_odds=log_odds,
        scatter=noise_scatter(since_s, used),
        scaled=positive,
        lightest=lightest,
    )
    return found, binned


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
    # As a share of the value; where zero is not known, no more than the change seen.
    half = (np.exp(high - value) - np.exp(low - value) if positive else high - low) / 2
    status = _each(value.size, Status.OK)
    status[half > (WIDEST if positive else reach)] = (
        Status.MISFIT if lasted_s > EARLY_S else Status.TOO_SHORT
    )
    return status


def _settled_already(
    time_s: FloatArray, seen: FloatArray, *, horizon_s: float, quantile: FloatArray
) -> FloatArray:
    """Return the mean of the last samples up to the horizon, and its interval by their noise."""
    upto = max(1, int(np.searchsorted(time_s, horizon_s, side="right")))
    last = seen[:, :upto][:, time_s[:upto] >= horizon_s - SETTLED_WINDOW_S]
    last = last if last.size else seen[:, upto - 1 : upto]
    variance, _ = noise_scatter(time_s, seen)
    return np.asarray(last.mean(axis=1) + ndtri(quantile)[:, None] * np.sqrt(variance))
