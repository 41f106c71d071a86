"""Force law of a sheet: pixel law, linear creep and plays, fitted by one Kalman filter.

With the states of `sheet_states`, the force f_i of pixel i and the total force F are

    ln f_i = a + g_i + b l_i + q p(l_i) + sum_k c_k r_i (v_i - v_ik)
    ln F   = ln sum_i s_i f_i - sum_j h_j u_j

p(l) = max(l, 0)^2 bends the law of a saturating sheet; its tangent continues it beyond the largest
reading of the calibration. Forces of pixels add. The weights w = (a, b, q, c, h, g) are Gaussian.
ln F is linear in w for one pixel, and nearly so for several: a calibration is an iterated Kalman
update with all its readings. A contact deviates from its sheet by a common gain and by gains of its
pixels; how much, the placements of the calibration tell (expectation maximisation). The interval
includes the remaining covariance of w, the deviation of a contact, and the scatter. The errors of
each placement, by a law of the others, scale it. Early readings of weights update the creep c alone
(`creep_update`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.force.creep_update import update_creep
from palpate.force.force_states import CONTACT_EXCESS
from palpate.force.sheet_states import (
    N_LAGS,
    N_PLAYS,
    ONSET_EXCESS,
    States,
    build_settled_states,
    compute_states,
)
from palpate.measurement import find_spread, half_width_sds

#: Weights of the constant, the reading and its curve; and all weights but the gains of the pixels.
_STATIC = 3
N_SHARED = _STATIC + N_LAGS + N_PLAYS
#: Readings of one contact count at most like this many, because they are correlated.
_MOST_READINGS = 25.0
#: Smallest force of a fit, and scatter of weak forces in it, newtons.
LEAST_N, _WEAK_N = 0.15, 0.3
#: Force from which errors are relative, newtons.
_FIRM_N = 1.0
#: Prior standard deviations: of ln gain of a pixel of a sheet, and of a pad where each may have its
#: own; of a pixel in a contact, and of the common gain of a contact in units of the pixels'. The
#: prior of contacts counts like this many.
_SHEET_PIXEL_SD, _PIXEL_SD, _COMMON, _PRIOR_CONTACTS = 0.2, 0.1, 0.5, 0.5
_MOST_PIXEL_SD = 2.0
#: Rounds of a fit, largest change of a weight in one, and first scatters.
_ROUNDS, _LARGEST_STEP, _FIRST_NOISE, _FIRST_PIXEL_SD = 12, 0.5, 0.04, 0.4
#: Smallest slope: a force that does not rise with the reading would blind a guard.
_LEAST_SLOPE = 0.1
#: Smallest scatter of ln force, and of weak forces in newtons.
_LEAST_NOISE, _LEAST_FLOOR_N = 0.03, 0.05
#: Fewest contacts for errors of held-out ones.
_FEWEST_CONTACTS = 3
#: Mean and standard deviation of ln force of grips, in newtons. It matters only where the force is
#: very uncertain.
_GRIPS_LOG_N, _GRIPS_SD = float(np.log(3.0)), 1.0
#: Largest half-width of an interval of ln force.
_MOST_HALF_WIDTH = 3.0
#: Limits of the exponent of a force.
_SMALLEST_LOG_N, _LARGEST_LOG_N = -20.0, 12.0
#: Prior without data: slope, creep of each time constant, and their standard deviations. The two
#: fastest copies are faster than most frames.
_SLOPE, _CREEP = 0.75, 0.05
_CONSTANT_SD, _SLOPE_SD, _CURVE_SD, _FAST_SD, _CREEP_SD = 1.0, 0.25, 0.05, 0.02, 0.1
_FAST_LAGS = 2
#: Prior standard deviation of the plays, the unloading of real sensors (`force_population.json`: a
#: fall of the reading by .1, .4 and 1.5 lowers ln force by .12, .24 and .38), and their mean as a
#: fraction of it. A calibration that only closes tells nothing about them. Staircases of 12 sheets
#: at `lab` and 8 of the second generator, RMS: fraction 0 .54, .87 N; 1/3 .54, .82 N; 1 .68, .79 N.
_PLAYS, _PLAYS_MEAN = np.array([0.08, 0.11, 0.19]), 1.0 / 3.0


class SheetForce(NamedTuple):
    """Forces by the law of a sheet, each of shape (n,)."""

    #: Force, newtons.
    force_n: FloatArray
    #: Standard deviation of ln force: of the law, the contact and the scatter.
    log_sd: FloatArray
    #: Whether a pixel reads more than in the calibration.
    is_beyond: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetLaw:
    """The force law of a calibrated sheet in a new contact.

    Attributes
    ----------
    mean, covariance : ndarray, shape (weights,) and (weights, weights)
        Distribution of the weights of the sheet.
    contact : ndarray, shape (weights,)
        Variances of their deviation in a contact.
    reach : float
        Largest reading (ln) of the calibration.
    noise : float
        Scatter of ln force about the law, for firm forces.
    floor_n : float
        Scatter of weak forces, newtons.
    misfit : float
        Factor of the standard deviation of ln force, from contacts that a law of the others did
        not see.

    Examples
    --------
    A sheet of one pixel whose excess is proportional to the force:

    >>> from palpate.force.sheet_states import compute_states
    >>> time_s, force_n = np.arange(7.0), np.array([0.0, 1, 2, 4, 6, 8, 10])
    >>> law = SheetLaw.fit([(compute_states(time_s, force_n[:, None]), force_n)] * 3)
    >>> value, low, high = law.force_n(compute_states([0.0, 3.0], [[0.0], [5.0]]))
    >>> bool(low[1] < 5.0 < high[1])
    True
    """

    #: Name and version in calibration files.
    name: ClassVar[str] = "sheet"
    version: ClassVar[int] = 1

    mean: FloatArray
    covariance: FloatArray
    contact: FloatArray
    reach: float
    noise: float
    floor_n: float
    misfit: float = 1.0

    @classmethod
    def fit(
        cls,
        contacts: Sequence[tuple[States, FloatArray]],
        *,
        misfit: float | None = None,
        weak_n: float = _WEAK_N,
        pads: ArrayLike | None = None,
    ) -> SheetLaw:
        """Fit the law to a calibration: the states and the forces, newtons, of each contact.

        `weak_n`: scatter of weak forces, newtons; less for weights, which are known and at rest.
        `pads`, shape (pixels,): number of each pixel's pad, if each may have a gain of its own.
        `misfit`: by default measured with the contacts themselves, which then must be as many and
        as long as those of a load cell.

        Raises
        ------
        CalibrationError
            If no contact has readings with a force.
        """
        usable = [one for one in contacts if _select(*one).any()]
        if not usable:
            raise CalibrationError(
                "force calibration: no reading rises with the load; calibrate the force again"
            )
        law = cls._fit(usable, weak_n=weak_n, pads=pads)
        if misfit is not None:
            return replace(law, misfit=misfit)
        if len(usable) < _FEWEST_CONTACTS:
            return law
        return law._with_scatter(cls.fit_others(usable), usable)

    @classmethod
    def fit_others(cls, contacts: Sequence[tuple[States, FloatArray]]) -> list[SheetLaw]:
        """Return for each contact a law of all others, without its misfit."""
        return [cls._fit([*contacts[:k], *contacts[k + 1 :]]) for k in range(len(contacts))]

    def learn_creep(self, contacts: Sequence[tuple[States, FloatArray]]) -> SheetLaw:
        """Return the law with the creep that weights show.

        `contacts`: as in `fit`; in each, the rest, and the settled reading of one weight, possibly
            after an early one.
        """
        early, settled, error = list[FloatArray](), list[FloatArray](), list[float]()
        for states, force_n in contacts:
            if force_n.size < 3 or not _select(states, force_n)[1:].all():
                continue
            (_, early_n, settled_n), (_, *both), _ = evaluate(self.mean, states)
            early.append(both[0])
            settled.append(both[1])
            error.append(float(settled_n - early_n))
        if not error:
            return self
        mean, covariance = update_creep(
            self.mean,
            self.covariance,
            creep=slice(_STATIC, _STATIC + N_LAGS),
            early=np.array(early),
            settled=np.array(settled),
            error=np.array(error),
        )
        return replace(self, mean=mean, covariance=covariance)

    @classmethod
    def _fit(
        cls,
        usable: Sequence[tuple[States, FloatArray]],
        *,
        weak_n: float = _WEAK_N,
        pads: ArrayLike | None = None,
    ) -> SheetLaw:
        """Fit the weights, with the scatter within the contacts."""
        pixels = usable[0][0].log_x.shape[1]
        prior, covariance = _build_prior(pixels, pads)
        # The unit of force of a pixel has no prior: its size differs from sheet to sheet.
        prior[0] += np.median(np.concatenate([_errors(prior, *one) for one in usable]))
        used = [_select(*one) for one in usable]
        log_true = [np.log(force_n[mine]) for mine, (_, force_n) in zip(used, usable, strict=True)]
        log_force, repeats = np.concatenate(log_true), _count_repeats(log_true)
        weights, noise, pixel_sd = prior, _FIRST_NOISE, _FIRST_PIXEL_SD
        for _ in range(_ROUNDS):
            of_contact = np.r_[_COMMON**2, np.ones(pixels)] * pixel_sd**2
            scatter = repeats * (noise**2 + (weak_n / np.exp(log_force)) ** 2)
            rows, gains = list[FloatArray](), list[FloatArray]()
            left = log_force.copy()
            for mine, (states, _), at in zip(used, usable, _slices(log_true), strict=True):
                log_n, jacobian, share = evaluate(weights, states)
                left[at] -= log_n[mine]
                rows.append(jacobian[mine])
                gains.append(np.column_stack([np.ones(int(mine.sum())), share[mine]]))
            design = np.concatenate(rows)
            # Covariance of the readings about the sheet's law, with the gains of each contact.
            about = np.diag(scatter)
            error, found = left.copy(), _PRIOR_CONTACTS * _PIXEL_SD**2
            for own, at in zip(gains, _slices(log_true), strict=True):
                about[at, at] += (own * of_contact) @ own.T
                known = of_contact[:, None] * np.linalg.solve(about[at, at], own).T
                gain = known @ left[at]
                square = gain**2 + of_contact - (known * (own * of_contact).T).sum(axis=1)
                found += 0.5 * (square[0] / _COMMON**2 + square[1:].mean())
                error[at] -= own @ gain
            spread = design @ covariance @ design.T + about
            weight = np.linalg.solve(spread, design @ covariance).T
            step = prior + weight @ (left + design @ (weights - prior)) - weights
            weights = weights + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            weights[1] = max(weights[1], _LEAST_SLOPE)
            pixel_sd = min(np.sqrt(found / (len(usable) + _PRIOR_CONTACTS)), _MOST_PIXEL_SD)
            firm = error[log_force > np.log(_FIRM_N)]
            noise = max(float(np.sqrt(np.mean(firm**2))) if firm.size else 0.0, _LEAST_NOISE)
        # A scatter measured with few placements is itself uncertain (Student's t).
        freedom = max(len(usable) - 1, 3)
        deviation = np.r_[_COMMON**2, np.zeros(N_SHARED - 1), np.ones(pixels)]
        deviation *= pixel_sd**2 * freedom / (freedom - 2.0)
        weak = log_force < np.log(_FIRM_N)
        missed_n = np.abs(np.exp(log_force) * np.expm1(-error))[weak]
        floor_n = float(np.quantile(missed_n, 0.9)) / half_width_sds(0.9) if weak.any() else 0.1
        return cls(
            mean=weights,
            covariance=covariance - weight @ design @ covariance,
            contact=deviation,
            reach=max(
                float(states.log_x[mine].max())
                for mine, (states, _) in zip(used, usable, strict=True)
            ),
            noise=noise,
            floor_n=max(floor_n, _LEAST_FLOOR_N),
        )

    def _with_scatter(
        self, others: Sequence[SheetLaw], contacts: Sequence[tuple[States, FloatArray]]
    ) -> SheetLaw:
        """Return the law with the errors of each contact by the law of the others."""
        squares, errors_n = list[float](), list[FloatArray]()
        for other, (states, force_n) in zip(others, contacts, strict=True):
            used = _select(states, force_n)
            log_n, variance = (each[used] for each in other._predict(states))
            value_n, true_n = np.exp(log_n), force_n[used]
            firm = value_n > _FIRM_N
            if firm.any():
                # Readings of one contact err alike, so each contact counts once.
                squares.append(float(np.mean((np.log(true_n) - log_n)[firm] ** 2 / variance[firm])))
            errors_n.append((true_n - value_n)[~firm])
        error_n = np.concatenate(errors_n)
        floor_n = find_spread(error_n) if error_n.size else 0.0
        misfit = math.sqrt(np.mean(squares)) if squares else 1.0
        return replace(self, misfit=misfit, floor_n=max(floor_n, self.floor_n))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; the inverse of `from_dict`.

        Of the covariance, the lower triangle is enough.
        """
        rows, cols = np.tril_indices(len(self.mean))
        return {
            "law": self.name,
            "version": self.version,
            "mean": self.mean.tolist(),
            "covariance": self.covariance[rows, cols].tolist(),
            "contact": self.contact.tolist(),
            "reach": self.reach,
            "noise": self.noise,
            "floor_n": self.floor_n,
            "misfit": self.misfit,
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> SheetLaw:
        """Return the law from the output of `as_dict`.

        Raises `CalibrationError` for a missing or invalid value.
        """
        try:
            mean, contact = (np.array(stored[name], dtype=float) for name in ("mean", "contact"))
            covariance = np.zeros((mean.size, mean.size))
            rows, cols = np.tril_indices(mean.size)
            if len(stored["covariance"]) != rows.size:
                raise ValueError(f"{len(stored['covariance'])} covariances of {mean.size} weights")
            covariance[rows, cols] = stored["covariance"]
            covariance = np.tril(covariance, -1).T + covariance
            scalars = {
                name: float(stored[name]) for name in ("reach", "noise", "floor_n", "misfit")
            }
            numbers = np.concatenate([mean, contact, covariance.ravel(), list(scalars.values())])
            if mean.size <= N_SHARED or mean.shape != contact.shape:
                raise ValueError(f"{mean.size} weights and {contact.size} variances")
            if not np.isfinite(numbers).all():
                raise ValueError("a number is not finite")
        except (KeyError, TypeError, ValueError) as error:
            raise CalibrationError(f"force law: {error}; calibrate the force again") from error
        return cls(mean=mean, covariance=covariance, contact=contact, **scalars)

    @property
    def pixels(self) -> int:
        """Number of pixels of the calibration; 1 if it has their sum only."""
        return len(self.mean) - N_SHARED

    def read(self, states: States) -> SheetForce:
        """Return the force at each frame of a new contact."""
        log_n, variance = self._predict(states)
        trust = _GRIPS_SD**2 / (_GRIPS_SD**2 + variance)
        return SheetForce(
            force_n=np.exp(_GRIPS_LOG_N + trust * (log_n - _GRIPS_LOG_N)),
            log_sd=self.misfit * np.sqrt(trust * variance),
            is_beyond=states.log_x.max(axis=1) > self.reach,
        )

    def read_settled(self, excess: ArrayLike) -> SheetForce:
        """Return the force at settled readings, shape (n, rows, cols) or (n, pixels)."""
        frames = np.asarray(excess, dtype=float)
        return self.read(build_settled_states(self.select_pixels(frames.reshape(len(frames), -1))))

    def select_pixels(self, excess: FloatArray) -> FloatArray:
        """Return the readings that the law has weights for: of each pixel, or their sum.

        `excess`, shape (..., pixels); NaN counts as 0.
        """
        return np.nansum(excess, axis=-1, keepdims=True) if self.pixels == 1 else excess

    def interval_n(
        self, force_n: ArrayLike, *, log_sd: ArrayLike, level: float = 0.9
    ) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the intervals of forces with a standard deviation of ln force.

        The scatter of weak forces, in newtons, is added.
        """
        value, quantile = np.asarray(force_n, dtype=float), half_width_sds(level)
        half = np.minimum(quantile * np.asarray(log_sd, dtype=float), _MOST_HALF_WIDTH)
        floor_n = quantile * self.floor_n
        low = value - np.hypot(value * np.expm1(-half), floor_n)
        high = value + np.hypot(value * np.expm1(half), floor_n)
        return np.maximum(low, 0.0), high

    def force_n(
        self, states: States, *, level: float = 0.9
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return force, and the ends of its interval, newtons, each of shape (n,)."""
        found = self.read(states)
        return found.force_n, *self.interval_n(found.force_n, log_sd=found.log_sd, level=level)

    def settle(self, states: States, *, log_n: float = 0.0) -> FloatArray:
        """Return the excess of each pixel once its creep has ended, shape (n, pixels).

        The force stays, or changes by the factor exp(log_n): the reading l at which
        b l + q p(l) = b l_i + q p(l_i) + sum_k c_k r_i (v_i - v_ik) + log_n, with the slope at l_i.
        """
        inside = np.clip(states.log_x, 0.0, self.reach)
        slope = np.maximum(self.mean[1] + 2.0 * self.mean[2] * inside, _LEAST_SLOPE)
        creep = states.lag @ self.mean[_STATIC : _STATIC + N_LAGS]
        return np.asarray(np.exp(states.log_x + (creep + log_n) / slope) - CONTACT_EXCESS)

    def threshold_n(self, *, level: float = 0.9) -> float:
        """Return the detection threshold: a force this large would have touched a pixel.

        It is the largest upper end of the interval at a reading that is just a contact.
        """
        return _find_threshold_n(self, level)

    @property
    def weak_sd_n(self) -> float:
        """Standard deviation of a force that hardly touches a pixel, newtons."""
        return self.threshold_n() / half_width_sds(0.9)

    def parts_n(self, excess: ArrayLike) -> FloatArray:
        """Return the force of each pixel at a settled reading, in the shape of the readings."""
        grid = np.asarray(excess, dtype=float)
        if self.pixels == 1:
            return np.asarray(np.maximum(np.nan_to_num(grid), 0.0))
        states = build_settled_states(grid.ravel()[None])
        log_n, _, share = evaluate(self.mean, states, reach=self.reach)
        return np.asarray(np.exp(log_n[0]) * share[0]).reshape(grid.shape)

    def _predict(self, states: States) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of ln force."""
        log_n, jacobian, _ = evaluate(self.mean, states, reach=self.reach)
        spread = np.einsum("ni,ij,nj->n", jacobian, self.covariance, jacobian)
        return log_n, spread + jacobian**2 @ self.contact + self.noise**2


@lru_cache(maxsize=16)
def _find_threshold_n(law: SheetLaw, level: float) -> float:
    highest = 0.0
    for pixel in range(law.pixels):
        excess = np.zeros(law.pixels)
        excess[pixel] = CONTACT_EXCESS
        just = compute_states([0.0, 1.0], [np.zeros(law.pixels), excess])
        highest = max(highest, float(law.force_n(just, level=level)[2][1]))
    return highest


def evaluate(
    weights: FloatArray, states: States, *, reach: float = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln force (n,), its Jacobian (n, weights), and the pixels' shares of the force."""
    above = np.maximum(states.log_x, 0.0)
    inside = np.minimum(above, reach)
    curve = inside * (2.0 * above - inside)
    c, h = weights[_STATIC : _STATIC + N_LAGS], weights[_STATIC + N_LAGS : N_SHARED]
    log_f = weights[0] + weights[N_SHARED:] + weights[1] * states.log_x + states.lag @ c
    log_f += weights[2] * curve
    f = states.touch * np.exp(np.clip(log_f, _SMALLEST_LOG_N, _LARGEST_LOG_N))
    total = f.sum(axis=1)
    share = f / total[:, None]
    jacobian = np.column_stack(
        [
            np.ones(len(f)),
            (share * states.log_x).sum(axis=1),
            (share * curve).sum(axis=1),
            np.einsum("np,npk->nk", share, states.lag),
            -states.play,
            share,
        ]
    )
    return np.log(total) - states.play @ h, jacobian, share


def _build_prior(pixels: int, pads: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of the weights of a sheet before its calibration."""
    mean = np.r_[0.0, _SLOPE, 0.0, np.full(N_LAGS, _CREEP), _PLAYS_MEAN * _PLAYS, np.zeros(pixels)]
    sd = np.r_[
        _CONSTANT_SD, _SLOPE_SD, _CURVE_SD, np.full(_FAST_LAGS, _FAST_SD),
        np.full(N_LAGS - _FAST_LAGS, _CREEP_SD), _PLAYS,
        np.full(pixels, _SHEET_PIXEL_SD),
    ]  # fmt: skip
    covariance = np.diag(sd**2)
    if pixels > 1 and pads is not None:
        of_pixel = np.ravel(pads)
        same = of_pixel[:, None] == of_pixel
        if not same.all():
            covariance[N_SHARED:, N_SHARED:] += _SHEET_PIXEL_SD**2 * same
    return mean, covariance


def _select(states: States, force_n: FloatArray) -> NDArray[np.bool_]:
    """Return which readings have a force and a touch."""
    touched = states.log_x.max(axis=1) > np.log(CONTACT_EXCESS + ONSET_EXCESS)
    return np.asarray((force_n > LEAST_N) & touched)


def _slices(parts: Sequence[FloatArray]) -> list[slice]:
    """Return the place of each part among all."""
    ends = np.cumsum([part.size for part in parts]).tolist()
    return [slice(end - part.size, end) for end, part in zip(ends, parts, strict=True)]


def _count_repeats(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the factor of the variance of each reading, by the number in its contact."""
    return np.concatenate(
        [np.full(part.size, max(part.size / _MOST_READINGS, 1.0)) for part in parts]
    )


def _errors(weights: FloatArray, states: States, force_n: FloatArray) -> FloatArray:
    """Return the errors of ln force at the stronger half of the used readings."""
    used = _select(states, force_n)
    used = used & (force_n >= np.median(force_n[used]))
    return np.asarray(np.log(force_n[used]) - evaluate(weights, states)[0][used])
