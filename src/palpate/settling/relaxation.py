"""Our predictor: a prior over how materials relax, conditioned on the samples in closed form."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.holds import Hold
from palpate.settling.bins import noise_scatter
from palpate.settling.conditionals import WALK_FROM_S, Conditionals, conditionals
from palpate.settling.default_prior import DEFAULT_PRIOR
from palpate.settling.intervals import UNCALIBRATED, IntervalScale
from palpate.settling.prior import Prior
from palpate.settling.result import FloatArray, SettledEstimate, Status
from palpate.settling.scoring import SETTLED_WINDOW_S, settled_value
from palpate.signal.transient import peak_index

#: Holds worked on at once; bounds the memory whatever the batch.
CHUNK = 256
#: A prediction from less than this after the peak has no basis but the prior.
SHORTEST_S = 0.3
#: And from fewer samples there is no telling noise from change.
FEWEST_SAMPLES = 4
#: Until then contact may still be bouncing: a prediction that is not even sure of the direction
#: (its standard deviation exceeds the change still to come) is then called too short.
BOUNCING_S = 2.0
#: A hold that has come back by more than this share of its drop is bouncing, not settling.
TURNED_BACK = 0.3
#: Per e-fold of time a hold may speed up, where a decay is just setting in, but hardly by more.
FASTEST_PACE = 2.0
#: While contact may still be bouncing, a prediction that much above the recent pace is too short.
HURRIED_PACE = 1.4
#: No prior holds every shape: the standard deviation is at least this share of the change to come
#: if the recent pace per e-fold of time went on.
SHAPE_DOUBT = 0.1
#: Window lengths at which calibration residuals are taken, s.
CALIBRATION_WINDOWS_S = (0.5, 1.0, 1.75, 2.5, 3.5, 5.0, 7.0, 10.0, 14.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Mixture of Gaussian conditionals over relaxation shapes.

    Scale, sign and offset of the values drop out exactly; see `docs/prediction.md`.

    Attributes
    ----------
    prior : Prior
        Shapes that a hold may have.
    scale : IntervalScale
        Width of the intervals.

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

    prior: Prior = field(default=DEFAULT_PRIOR, repr=False)
    scale: IntervalScale = field(default=UNCALIBRATED, repr=False)

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
        value, deviation, window_s, status = _predict(self.prior, time_s, values, horizon_s)
        half_width = deviation * self.scale.half_widths(window_s, level=level)
        return SettledEstimate(
            value=value,
            low=value - half_width,
            high=value + half_width,
            level=level,
            horizon_s=horizon_s,
            window_s=window_s,
            method=self.name,
            status=status,
        )

    def calibrated_on(self, holds: Iterable[Hold], *, horizon_s: float = 20.0) -> Relaxation:
        """Return a predictor whose intervals are as wide as these holds' residuals call for.

        Parameters
        ----------
        holds : iterable of Hold
            Calibration holds that reach the horizon (others are passed over), best of several
            specimens. Sampling may differ from hold to hold.
        horizon_s : float
            Time of the settled value.
        """
        residuals: list[list[float]] = [[] for _ in CALIBRATION_WINDOWS_S]
        for hold in holds:
            settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
            if np.isnan(settled):
                continue
            for index, window in enumerate(CALIBRATION_WINDOWS_S):
                seen = hold.time_s <= window
                if window >= horizon_s or seen.sum() < 2:
                    continue
                value, deviation, _, _ = _predict(
                    self.prior, hold.time_s[seen], hold.values[None, seen], horizon_s
                )
                if deviation[0] > 0:
                    residuals[index].append(abs(float(value[0]) - settled) / float(deviation[0]))
        scale = IntervalScale(
            window_s=np.array(CALIBRATION_WINDOWS_S),
            residuals=tuple(np.sort(np.array(r)) for r in residuals),
        )
        return Relaxation(prior=self.prior, scale=scale)


def _predict(
    prior: Prior, time_s: FloatArray, values: FloatArray, horizon_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.object_]]:
    """Return value, standard deviation, window and status of each hold."""
    value = values[:, -1].copy()
    deviation = np.ptp(values, axis=1)
    status = np.array([Status.OK] * len(values), dtype=object)
    status[deviation == 0] = Status.NOT_SETTLING
    peaks = peak_index(values)
    window_s = time_s[-1] - time_s[peaks]
    target_s = horizon_s - SETTLED_WINDOW_S / 2
    if time_s[-1] >= target_s:
        return *_settled_already(time_s, values, horizon_s=horizon_s), window_s, status
    for peak in np.unique(peaks):
        rows = np.flatnonzero(peaks == peak)
        since = time_s[peak:] - time_s[peak]
        if since.size < FEWEST_SAMPLES or since[-1] < SHORTEST_S:
            status[rows] = Status.TOO_SHORT
        if since.size < 2:
            continue
        forms = conditionals(since, after_s=float(target_s - time_s[peak]), prior=prior)
        for start in range(0, rows.size, CHUNK):
            chunk = rows[start : start + CHUNK]
            value[chunk], deviation[chunk], limited, hurried, turned = _forecast(
                forms, prior, since, values[chunk, peak:]
            )
            fine = status[chunk] == Status.OK
            status[chunk[fine & limited]] = Status.FELL_BACK
            if since[-1] < BOUNCING_S:
                unsure = deviation[chunk] > np.abs(value[chunk] - values[chunk, -1])
                status[chunk[fine & (unsure | hurried)]] = Status.TOO_SHORT
            status[chunk[turned]] = Status.NOT_SETTLING
    return value, deviation, window_s, status


def _settled_already(
    time_s: FloatArray, values: FloatArray, *, horizon_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and its standard deviation of the last samples up to the horizon."""
    upto = values[:, : max(1, int(np.searchsorted(time_s, horizon_s, side="right")))]
    last = upto[:, time_s[: upto.shape[1]] >= horizon_s - SETTLED_WINDOW_S]
    last = last if last.size else upto[:, -1:]
    variance, _ = noise_scatter(time_s, values)
    return last.mean(axis=1), np.sqrt(variance)


def _forecast(
    forms: Conditionals, prior: Prior, time_s: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return mean and standard deviation at the horizon; what was limited, hurries, turned back."""
    binned = values @ forms.bins.averaging.T
    last, first = binned[:, -1], values[:, 0]
    direction = np.where(last >= first, 1.0, -1.0)
    fallen = (values - first[:, None]) * direction[:, None]
    drop = fallen.max(axis=1)
    scale = np.where(drop > 0, drop, 1.0)
    mean, deviation = _mix(
        forms,
        prior,
        seen=(binned[:, :-1] - last[:, None]) / scale[:, None],
        scatter=noise_scatter(time_s, values / scale[:, None]),
    )
    # Relaxation doesn't turn round, nor does it fall faster and faster: where noise or a process
    # that is over say so, the last value or its recent pace are better guides.
    fall = mean * direction
    to_come = _recent_pace(forms, binned)
    possible = np.clip(fall, 0.0, FASTEST_PACE * to_come / scale)
    turned = drop - np.abs(last - first) > TURNED_BACK * drop
    doubt = np.where(turned, drop, SHAPE_DOUBT * to_come)
    value = last + drop * possible * direction
    hurried = fall * scale > HURRIED_PACE * to_come
    return value, np.hypot(drop * deviation, doubt), possible != fall, hurried, turned


def _recent_pace(forms: Conditionals, binned: FloatArray) -> FloatArray:
    """Return the change to come if time went on by e-folds as it did over the last one."""
    time_s = forms.bins.time_s
    first = min(int(np.searchsorted(time_s, time_s[-1] / np.e)), time_s.size - 2)
    folds = np.log((time_s[-1] + WALK_FROM_S) / (time_s[first] + WALK_FROM_S))
    return np.asarray(np.abs(binned[:, first] - binned[:, -1]) / folds * forms.e_folds)


def _mix(
    forms: Conditionals, prior: Prior, *, seen: FloatArray, scatter: tuple[FloatArray, float]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the mixture's forecast from the last bin."""
    variance, samples = scatter
    squares = ((forms.whitening @ seen.T) ** 2).sum(axis=1).T
    squares += samples * variance[:, None] / prior.noise**2
    degrees = seen.shape[1] + samples
    log_weight = (
        prior.log_weight
        - forms.log_det / 2
        - samples * np.log(prior.noise)
        - degrees / 2 * np.log(squares + np.finfo(float).tiny)
    )
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    forecast = seen @ forms.forecast.T
    mean = (weight * forecast).sum(axis=1)
    within = squares / max(degrees - 2, 1) * forms.variance
    spread = within + (forecast - mean[:, None]) ** 2
    return mean, np.sqrt((weight * spread).sum(axis=1))
