"""An object's own stiffness from the curve of its closing, the gripper's give taken out.

Everything that the curve leaves open is open together: where contact began, the shape of the
object's law, its scale, and the gain and exponent by which this contact reads away from the sheet's
law. A force read too high takes too much give out and makes the object too stiff in one go, so
these doubts are weighed on one grid, and the answer's interval comes from all of them at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri
from scipy.stats import norm

from palpate.estimate.measurement import Measurement
from palpate.estimate.stiffness import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Give
from palpate.settling.result import Status

FloatArray: TypeAlias = NDArray[np.float64]

#: Exponents of force over indentation and how common they are: 1 a flat or layered body, 1.5 a
#: round one (Hertz), 1.25 what is between, 2 pointed or stiffening.
_SHAPES = {1.0: 0.4, 1.25: 0.15, 1.5: 0.35, 2.0: 0.1}
#: Scatter of ln force from step to step within one closing, and how likely.
_SCATTERS = {0.02: 0.4, 0.05: 0.4, 0.12: 0.2}
#: This contact's exponent against the law's, because the load spreads over the pixels as it grows:
#: scatter per unit of ln force, about the middle of the forces.
_TILT_SD, _MIDDLE_N = 0.05, 3.0
#: A step that raises the force at one go is read low, because the sheet lags: by so much of the
#: rise (in ln force) that is not yet forgotten, of which a share is forgotten with each step.
_LAGS, _FORGOTTEN = (0.0, 0.12, 0.24), 0.3
#: By how much (in ln force) the object has relaxed at the horizon against its closing, and how
#: likely: springs and silicone hardly, fruit by a tenth to a third. At one closure no force rises.
_RELAXED = ((0.6, -0.03, 0.04), (0.4, -0.2, 0.1))
#: A staircase is no clean step, of which alone the settling is known: its forecast is off (ln
#: force) by so much beyond its own interval.
_FORECAST_SD = 0.05
#: The doubts above are not independent, and so too many: nine tenths of 334 development grasps lay
#: within so much of the interval that they make together.
_TOO_WIDE = 0.75
#: A reading below so many scatters of faint forces may be drift before the contact: such a step
#: says only that the force was no larger.
_FELT = 2.0
#: A width is never known better, mm (half an encoder step of the usual servo).
_SHARPEST_MM = 0.02
#: Steps of a long closing that are looked at: neighbours say the same.
_MOST_STEPS = 14
_GAINS, _TILTS, _SCALES, _DRAWS = 9, 3, 36, 4000


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingCurve:
    """The steps of one closing, read as the grasp went.

    Attributes
    ----------
    width_mm : ndarray, shape (n_steps,)
        Opening at each step, zero taken out.
    force_n : ndarray, shape (n_steps,)
        Force read there, newtons; 0 where nothing was felt.
    gain_sd : float
        Scatter of ln force from one contact to another.
    floor_n : float
        Scatter of faint forces, newtons.
    """

    width_mm: FloatArray
    force_n: FloatArray
    gain_sd: float
    floor_n: float

    @property
    def faint_n(self) -> float:
        """Force below which a reading tells no more than that it is small."""
        return _FELT * self.floor_n

    @property
    def felt(self) -> NDArray[np.bool_]:
        """Steps whose force can't be drift."""
        return self.force_n > self.faint_n

    @property
    def rising(self) -> FloatArray:
        """Rise of ln force at each felt step that the sheet has not forgotten yet."""
        log_force = np.log(self.force_n[self.felt])
        remembered, found = float(np.log(self.faint_n)), []
        for now in log_force:
            remembered += _FORGOTTEN * (now - remembered)
            found.append(now - remembered)
        return np.array(found)

    @property
    def looked_at(self) -> NDArray[np.int64]:
        """Which of the felt steps are looked at: at most so many, evenly spread."""
        felt = int(np.count_nonzero(self.felt))
        return np.unique(np.linspace(0, felt - 1, min(felt, _MOST_STEPS)).round().astype(int))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Posterior:
    """Draws of what the curve leaves open, arrays of shape (draws,)."""

    size_mm: FloatArray
    scale: FloatArray
    shape: FloatArray
    gain: FloatArray
    tilt: FloatArray


def object_stiffness(
    curve: ClosingCurve, *, give: Give, opening_mm: float, force: Measurement
) -> Measurement | None:
    """Return the object's secant stiffness at the settled force; None if too little was felt.

    Parameters
    ----------
    curve : ClosingCurve
        The closing.
    give : Give
        Of pads, fingers and servo.
    opening_mm : float
        Final opening, zero taken out.
    force : Measurement
        Settled force there, newtons.

    Examples
    --------
    A spring of 2 N/mm in a gripper that gives way by 0.2 mm/N:

    >>> force_n = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 6.0])
    >>> give = Give(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.02,
    ...     largest_force_n=15.0)
    >>> curve = ClosingCurve(width_mm=40.0 - 0.7 * force_n, force_n=force_n, gain_sd=0.03,
    ...     floor_n=0.02)
    >>> held = Measurement(value=6.0, low=5.6, high=6.4, unit="n", level=0.9)
    >>> found = object_stiffness(curve, give=give, opening_mm=35.8, force=held)
    >>> found.low < 2.0 < found.high, abs(found.value - 2.0) < 0.1
    (True, True)
    """
    if np.count_nonzero(curve.felt) < 2 or force.value <= 0:
        return None
    # A fixed seed: the same touch gives the same answer.
    rng = np.random.default_rng(0)
    held = _posterior(curve, give=give, rng=rng)
    tail = (1 - force.level) / 2
    log_sd = np.log(force.high / max(force.low, 1e-3 * force.value)) / (2 * ndtri(1 - tail))
    own_sd = float(np.sqrt(max(log_sd**2 - curve.gain_sd**2, 0.0) + _FORECAST_SD**2))
    log_force = np.log(force.value) + own_sd * rng.standard_normal(_DRAWS)
    log_force += held.gain + held.tilt * np.log(force.value / _MIDDLE_N)
    force_n = np.exp(log_force)
    deformed = held.size_mm - opening_mm - give.give_mm(force_n)
    possible = deformed > force_n / STIFFEST_N_PER_MM
    deformed = np.where(possible, deformed, force_n / STIFFEST_N_PER_MM)
    relaxed = log_force - np.log(held.scale) - held.shape * np.log(deformed)
    likely = sum(share * norm.pdf(relaxed, mean, sd) for share, mean, sd in _RELAXED)
    weight = np.where(possible, likely, 0.0)
    rigid = weight.sum() < 1e-3 * _DRAWS
    stiffness = np.clip(force_n / deformed, SOFTEST_N_PER_MM, STIFFEST_N_PER_MM)
    low, value, high = _quantiles(
        stiffness, np.ones_like(weight) if rigid else weight, [tail, 0.5, 1 - tail]
    )
    return Measurement(
        value=value,
        low=value * (low / value) ** _TOO_WIDE,
        high=value * (high / value) ** _TOO_WIDE,
        unit="n_per_mm",
        level=force.level,
        status=Status.SATURATED if rigid else force.status,
    )


def _quantiles(values: FloatArray, weight: FloatArray, at: list[float]) -> tuple[float, ...]:
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return tuple(np.interp(at, reached / weight.sum(), values[order]).tolist())


def _posterior(curve: ClosingCurve, *, give: Give, rng: np.random.Generator) -> _Posterior:
    """Weigh the grid twice, the second time where the scale was found, and draw from it."""
    scales = np.geomspace(0.02, STIFFEST_N_PER_MM, _SCALES)
    weight = _weighed(curve, give, scales)[0]
    seen = scales[weight.sum(axis=(0, 1, 2, 3, 5)) > 1e-5]
    step = scales[1] / scales[0]
    scales = np.geomspace(seen[0] / step, seen[-1] * step, _SCALES)
    weight, size_mm, size_sd = _weighed(curve, give, scales)
    places = np.searchsorted(np.cumsum(weight), (np.arange(_DRAWS) + 0.5) / _DRAWS)
    places = rng.permutation(np.minimum(places, weight.size - 1))
    gain, tilt, _, shape, scale, _ = np.unravel_index(places, weight.shape)
    sizes = size_mm.ravel()[places] + size_sd.ravel()[places] * rng.standard_normal(_DRAWS)
    return _Posterior(
        size_mm=sizes,
        scale=scales[scale],
        shape=np.array(list(_SHAPES))[shape],
        gain=_gains(curve)[gain],
        tilt=_tilts()[tilt],
    )


def _gains(curve: ClosingCurve) -> FloatArray:
    """Return equally likely gains, of ln force."""
    middles = (np.arange(_GAINS) + 0.5) / _GAINS
    return np.asarray(curve.gain_sd * ndtri(middles))


def _tilts() -> FloatArray:
    """Return equally likely errors of the exponent."""
    return np.asarray(_TILT_SD * ndtri((np.arange(_TILTS) + 0.5) / _TILTS))


def _weighed(
    curve: ClosingCurve, give: Give, scales: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weights, sizes and their scatter.

    Shape (gains, tilts, lags, shapes, scales, scatters). Given the rest, each step says where
    contact began: its width, the give, and the deformation under its force. The weighted mean of
    that is the size; what is left over is the evidence.
    """
    felt, chosen = curve.felt, curve.looked_at
    read_n, width_mm = curve.force_n[felt][chosen], curve.width_mm[felt][chosen]
    shapes, scatters = np.array(list(_SHAPES)), np.array(list(_SCATTERS))
    log_read = np.log(read_n)
    log_n = log_read + _gains(curve)[:, None, None, None]
    log_n = log_n + _tilts()[:, None, None] * (log_read - np.log(_MIDDLE_N))
    log_n = log_n + np.array(_LAGS)[:, None] * curve.rising[chosen]
    force_n = np.exp(log_n)
    give_mm = give.give_mm(force_n)
    give_slope = (give.give_mm(1.01 * force_n) - give_mm) / 0.01
    log_n, give_mm, give_slope = (a[..., None, None, :] for a in (log_n, give_mm, give_slope))
    power = 1.0 / shapes[:, None, None]
    deformed = np.exp(power * (log_n - np.log(scales)[:, None]))
    touch_mm = width_mm + give_mm + deformed
    slope_mm = give_slope + power * deformed
    doubt = scatters[:, None] ** 2 + (curve.floor_n / read_n) ** 2
    sharp_mm = max(give.residual_mm, _SHARPEST_MM)
    total, size_mm, evidence = _pooled(touch_mm, slope_mm**2, doubt, sharp_mm**2)
    size_sd = 1.0 / np.sqrt(total)
    if not felt.all():
        # Nothing felt there: the object began no further out than a faint force would reach.
        faint_mm = (curve.faint_n / scales) ** power[:, :, 0] + float(give.give_mm(curve.faint_n))
        beyond = float(curve.width_mm[~felt].min()) + faint_mm[:, :, None]
        evidence += log_ndtr((beyond - size_mm) / np.hypot(size_sd, sharp_mm))
    evidence += np.log(list(_SHAPES.values()))[:, None, None] + np.log(list(_SCATTERS.values()))
    weight = np.exp(evidence - evidence.max())
    return weight / weight.sum(), size_mm, size_sd


def _pooled(
    touch_mm: FloatArray, slope_2: FloatArray, doubt: FloatArray, sharp_2: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return total precision, weighted mean and log evidence over the steps, the last axis.

    Step by step, so that the sums stay in the cache: half a million numbers do not.
    """
    middle_mm = float(touch_mm.mean())
    total = np.zeros((*touch_mm.shape[:-1], len(doubt)))
    first, second, product = np.zeros_like(total), np.zeros_like(total), np.ones_like(total)
    for step in range(touch_mm.shape[-1]):
        precision = 1.0 / (sharp_2 + slope_2[..., step, None] * doubt[:, step])
        total += precision
        product *= precision
        # From the middle: sums of squares of whole widths would lose the digits that count.
        off_mm = touch_mm[..., step, None] - middle_mm
        precision *= off_mm
        first += precision
        precision *= off_mm
        second += precision
    mean_mm = first / total
    evidence = 0.5 * (np.log(product / total) - (second - first * mean_mm))
    return total, middle_mm + mean_mm, evidence
