"""An object's size and stiffness from its closing curve, with the gripper's give taken out.

The curve leaves several unknowns open, and they are estimated together: where contact began, the
shape and scale of the object's law, this contact's gain against the sheet's law, and the gripper's
give here. They are correlated: a force read too high takes out too much give, and so makes the
object seem too stiff twice over. The answer's interval covers all of them. Shape and scale lie on a
grid; given both, every other unknown shifts each step's estimate of where contact began in
proportion, and is solved for (generalised least squares with priors).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtri

from palpate.arrays import FloatArray
from palpate.estimate.compliance import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Compliance
from palpate.estimate.measurement import Measurement
from palpate.settling.result import Status

#: Exponents of force over indentation and how common they are: 1 a flat or layered body, 1.5 a
#: round one (Hertz), 1.25 what is between, 2 pointed or stiffening.
_SHAPES = {1.0: 0.4, 1.25: 0.15, 1.5: 0.35, 2.0: 0.1}
#: Scatter of ln force from step to step within one closing, and how likely. Most contacts read
#: evenly, once their exponent and lag are known; some reseat themselves.
_SCATTERS = {0.007: 0.4, 0.02: 0.4, 0.08: 0.2}
#: An object off the middle, or another face than the block's: pads and fingers give a share more.
_COMPLIANCE_SD = 0.02
#: How far (in ln force) the object has relaxed at the horizon against its closing, and how
#: likely: springs and silicone hardly, fruit by a tenth to a third. At one closure no force rises.
_RELAXED = ((0.6, -0.03, 0.04), (0.4, -0.2, 0.1))
#: Sheet and current show no relaxation of a held object. For half of them, fruit, the force is
#: lower than estimated by this much (ln).
_FRUIT_FRACTION, _UNSEEN, _UNSEEN_SD = 0.5, -0.06, 0.04
#: A staircase is no clean step, and settling is known only for clean steps: its forecast has this
#: error (ln force) beyond its own interval.
_FORECAST_SD = 0.02
#: The gripper's zero was found on a block whose size is known to a tenth of a millimetre.
_BLOCK_SD_MM = 0.06
#: A width is never known better, mm (half an encoder step of the usual servo).
_SHARPEST_MM = 0.02
_GAINS, _SCALES, _DRAWS = 5, 40, 4000
#: Number of unknowns solved for: size, gain beyond that of the grid, exponent, lag, give.
_UNKNOWN = 5
#: Share of the uncertainty of the gain that each place of the grid solves for, so that what is not
#: proportional in a large uncertainty is evaluated at several places.
_SOLVED_FRACTION = 0.5

#: A step that raises the force at once is read low, because the sheet lags: by this fraction of the
#: rise (in ln force) that still lags. On development closings of the twin, compared with
#: the true forces, 0.16 on springs; 0.05 where half of the objects relax as fruit does meanwhile.
#: Relaxing bends a closing the other way: a stiffness estimated from the bend needs no correction
#: on average.
LAG, LAG_SD = 0.1, 0.08
#: The lag of a sheet after a rise falls by this fraction with each step of a closing.
_RECOVERY = 0.3
#: This contact's exponent against the law's, because the load spreads over the pixels as it grows
#: and a sheet near its end bends: scatter per unit of ln force, as a share of the law's own scatter
#: from placement to placement, and its least and most.
_TILT_FRACTION, _TILT_SDS = 0.5, (0.04, 0.4)
#: The servo's current gives the gain all along the closing, from this fraction of the force on and
#: with a weight that grows with it; the lag of the sheet is taken out there.
_GAIN_FROM = 0.3
#: A reading below this many standard deviations of faint forces may be drift before the contact:
#: such a step shows only that the force was no larger.
CONTACT_SD = 2.0
#: The data are readings at given widths, but the equations are of widths at given readings. This
#: power of the slopes between the two counts where a step before contact bounds the size (a bound
#: is needed: a deep contact has large slopes). On development closings of the twin 0 gave a size
#: RMS of 0.42 mm (`lab`) and 0.35 (`field`), 0.3 gave 0.38 and 0.30. More than 0.3 lowers the
#: certain stiffness so far that a firm object is not squeezed until its stiffness is known.
_SLOPE_POWER = 0.3
#: Fewest steps with force that show a curve.
_FEWEST = 2
#: Steps of a long closing that are used: neighbours carry the same information.
_MOST_STEPS = 14


class ClosingAnswer(NamedTuple):
    """Size and stiffness of an object, from its closing curve and the settled force."""

    size_mm: Measurement
    stiffness: Measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """The grid: gains x shapes x scales x scatters, and the values solved at each."""

    #: Shape (gains, shapes, scales, scatters). Probability of each place; sums to 1.
    weight: FloatArray
    #: Shape (gains, shapes, scales, scatters, 5). Of size, further gain, exponent, lag and give
    #: there.
    mean: FloatArray
    #: Shape (gains, shapes, scales, scatters, 5, 5). Inverse of their covariance.
    precision: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Posterior:
    """Draws of what the curve leaves open, arrays of shape (draws,)."""

    size_mm: FloatArray
    scale: FloatArray
    shape: FloatArray
    end_gain: FloatArray
    compliance_factor: FloatArray


def measure_closing(
    curve: ClosingSteps, *, compliance: Compliance, opening_mm: float, force: Measurement
) -> ClosingAnswer | None:
    """Return size, and secant stiffness at the settled force; None with few steps.

    `compliance`: of pads, fingers and servo.
    `opening_mm`: final opening, zero taken out.
    `force`: settled force there, newtons.

    A spring of 2 N/mm in a gripper with a compliance of 0.2 mm/N:

    >>> force_n = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 6.0])
    >>> compliance = Compliance(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0,
    ...     residual_mm=0.02, largest_force_n=15.0)
    >>> curve = ClosingSteps(width_mm=40.0 - 0.7 * force_n, force_n=force_n, gain_sd=0.03,
    ...     law_sd=0.05, floor_n=0.02)
    >>> held = Measurement(value=6.0, low=5.6, high=6.4, unit="n", level=0.9)
    >>> size_mm, stiffness = measure_closing(curve, compliance=compliance, opening_mm=35.8,
    ...     force=held)
    >>> stiffness.low < 2.0 < stiffness.high, abs(stiffness.value - 2.0) < 0.1
    (True, True)
    >>> size_mm
    Measurement(40 mm, 39.87 to 40.12, ok)
    """
    if np.count_nonzero(curve.is_certain) < _FEWEST or force.middle <= 0:
        return None
    tail = (1 - force.level) / 2
    log_sd = np.log(force.high / max(force.low, 1e-3 * force.middle)) / (2 * ndtri(1 - tail))
    # Settled, the force is known better than while closing, and the gain of the contact with it.
    curve = replace(curve, gain_sd=min(curve.gain_sd, float(log_sd)))
    # A fixed seed: the same touch gives the same answer.
    rng = np.random.default_rng(0)
    held = _posterior(curve, compliance=compliance, rng=rng)
    own_sd = float(np.sqrt(max(log_sd**2 - curve.gain_sd**2, 0.0) + _FORECAST_SD**2))
    log_force = np.log(force.middle) + own_sd * rng.standard_normal(_DRAWS)
    unseen = _UNSEEN + _UNSEEN_SD * rng.standard_normal(_DRAWS)
    log_force += held.end_gain + np.where(rng.random(_DRAWS) < _FRUIT_FRACTION, unseen, 0.0)
    force_n = np.exp(log_force)
    deformed = (
        held.size_mm - opening_mm - held.compliance_factor * compliance.deflection_mm(force_n)
    )
    possible = deformed > force_n / STIFFEST_N_PER_MM
    deformed = np.where(possible, deformed, force_n / STIFFEST_N_PER_MM)
    relaxed = log_force - np.log(held.scale) - held.shape * np.log(deformed)
    likely = sum(share * normal_density(relaxed, mean, sd) for share, mean, sd in _RELAXED)
    weight = np.where(possible, likely, 0.0)
    rigid = weight.sum() < 1e-3 * _DRAWS
    weight = np.ones_like(weight) if rigid else weight
    low, value, high = _quantiles(held.size_mm, weight, [tail, 0.5, 1 - tail])
    zero_mm = float(ndtri(1 - tail)) * math.hypot(compliance.residual_mm, _BLOCK_SD_MM)
    size_mm = Measurement(
        value=value,
        low=value - math.hypot(value - low, zero_mm),
        high=value + math.hypot(high - value, zero_mm),
        unit="mm",
        level=force.level,
    )
    stiffness = np.clip(force_n / deformed, SOFTEST_N_PER_MM, STIFFEST_N_PER_MM)
    low, value, high = _quantiles(stiffness, weight, [tail, 0.5, 1 - tail])
    return ClosingAnswer(
        size_mm,
        Measurement(
            value=value,
            low=low,
            high=high,
            unit="n_per_mm",
            level=force.level,
            status=Status.SATURATED if rigid else force.status,
        ),
    )


def _quantiles(values: FloatArray, weight: FloatArray, at: list[float]) -> tuple[float, ...]:
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return tuple(np.interp(at, reached / weight.sum(), values[order]).tolist())


def _posterior(
    curve: ClosingSteps, *, compliance: Compliance, rng: np.random.Generator
) -> _Posterior:
    """Weigh the grid twice, the second time around the scale found, and draw from it."""
    scales = np.geomspace(0.02, STIFFEST_N_PER_MM, _SCALES)
    seen = scales[_weigh(curve, compliance, scales).weight.sum(axis=(0, 1, 3)) > 1e-5]
    step = scales[1] / scales[0]
    scales = np.geomspace(seen[0] / step, seen[-1] * step, _SCALES)
    grid = _weigh(curve, compliance, scales)
    places = np.searchsorted(np.cumsum(grid.weight), (np.arange(_DRAWS) + 0.5) / _DRAWS)
    places = rng.permutation(np.minimum(places, grid.weight.size - 1))
    gain, shape, scale, _ = np.unravel_index(places, grid.weight.shape)
    drawn, of_draw = np.unique(places, return_inverse=True)
    precision = grid.precision.reshape(-1, _UNKNOWN, _UNKNOWN)[drawn]
    spread = np.linalg.cholesky(np.linalg.inv(precision))[of_draw]
    free = rng.standard_normal((_DRAWS, _UNKNOWN, 1))
    solved = grid.mean.reshape(-1, _UNKNOWN)[places] + (spread @ free)[..., 0]
    size_mm, further, tilt, _, more = solved.T
    return _Posterior(
        size_mm=size_mm,
        scale=scales[scale],
        shape=np.array(list(_SHAPES))[shape],
        end_gain=_gains(curve)[gain] + further + tilt * curve.samples.above[-1],
        compliance_factor=1.0 + more,
    )


def _gains(curve: ClosingSteps) -> FloatArray:
    """Return equally likely gains, of ln force; the other uncertainty is solved for each."""
    middles = ndtri((np.arange(_GAINS) + 0.5) / _GAINS)
    kept = np.sqrt(1 - _SOLVED_FRACTION**2) / np.std(middles)
    return np.asarray(curve.own_gain_sd * kept * middles)


def _weigh(curve: ClosingSteps, compliance: Compliance, scales: FloatArray) -> _Grid:
    """Weigh each place of the grid by the scatter of its contact over the steps."""
    touch_mm, design = _contact_equations(curve, compliance, scales)
    scatters = np.array(list(_SCATTERS))
    doubt = scatters[:, None] ** 2 + (curve.floor_n / curve.samples.read_n) ** 2
    sharp_mm = max(compliance.residual_mm, _SHARPEST_MM)
    weight = 1.0 / (sharp_mm**2 + design[..., None, :, 1] ** 2 * doubt)
    gain_sd = max(_SOLVED_FRACTION * curve.own_gain_sd, 1e-3)
    known = np.array([np.inf, gain_sd, tilt_sd(curve.law_sd), LAG_SD, _COMPLIANCE_SD])
    # From the middle: sums of squares of whole widths would lose the digits that count.
    middle_mm = float(touch_mm.mean())
    off_mm = touch_mm - middle_mm
    products = (design[..., :, None] * design[..., None, :]).reshape(*design.shape[:-1], -1)
    precision = (weight @ products).reshape(*weight.shape[:-1], _UNKNOWN, _UNKNOWN)
    precision += np.diag(known**-2.0)
    moment = weight @ (design * off_mm[..., None])
    mean = np.asarray(np.linalg.solve(precision, moment[..., None])[..., 0], dtype=float)
    left = (weight @ (off_mm**2)[..., None])[..., 0] - (moment * mean).sum(axis=-1)
    volume = np.log(weight).sum(axis=-1) - np.linalg.slogdet(precision)[1]
    evidence = 0.5 * (volume - left)
    mean[..., 0] += middle_mm
    if not curve.is_certain[0]:
        variance = np.linalg.inv(precision)[..., 0, 0] + sharp_mm**2
        evidence += _bound_size(curve, compliance, scales, mean[..., 0], np.sqrt(variance))
        evidence += _SLOPE_POWER * np.log(-design[..., 1]).sum(axis=-1)[..., None]
    evidence += np.log(list(_SHAPES.values()))[:, None, None] + np.log(list(_SCATTERS.values()))
    likely = np.exp(evidence - evidence.max())
    return _Grid(weight=likely / likely.sum(), mean=mean, precision=precision)


def _contact_equations(
    curve: ClosingSteps, compliance: Compliance, scales: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where contact began by each step, and what moves that.

    Shapes (gains, shapes, scales, steps) and with a last axis of 5: each step's width, the give and
    the deformation under its force add up to the size, but for gain, exponent, lag and give.
    """
    samples = curve.samples
    log_n = np.log(samples.read_n) + _gains(curve)[:, None]
    deflection_mm = compliance.deflection_mm(np.exp(log_n))
    deflection_slope = (compliance.deflection_mm(1.01 * np.exp(log_n)) - deflection_mm) / 0.01
    log_n, deflection_mm, deflection_slope = (
        a[:, None, None] for a in (log_n, deflection_mm, deflection_slope)
    )
    power = 1.0 / np.array(list(_SHAPES))[:, None, None]
    deformed = np.exp(power * (log_n - np.log(scales)[:, None]))
    slope_mm = deflection_slope + power * deformed
    moved = (-slope_mm, -slope_mm * samples.above, -slope_mm * samples.lagging, -deflection_mm)
    design = np.stack(np.broadcast_arrays(np.ones_like(slope_mm), *moved), axis=-1)
    return samples.width_mm + deflection_mm + deformed, design


def _bound_size(
    curve: ClosingSteps,
    compliance: Compliance,
    scales: FloatArray,
    size_mm: FloatArray,
    sd_mm: FloatArray,
) -> FloatArray:
    """Return the log likelihood of the steps before the first with force.

    The object began no further out than a faint force would reach. A later step that reads nothing
    shows pixels that cancel each other.
    """
    power = 1.0 / np.array(list(_SHAPES))[:, None, None]
    faint_mm = (curve.faint_n / scales[:, None]) ** power + float(
        compliance.deflection_mm(curve.faint_n)
    )
    beyond_mm = float(curve.width_mm[: np.argmax(curve.is_certain)].min()) + faint_mm
    return np.asarray(log_ndtr((beyond_mm - size_mm) / sd_mm))


def compute_lag(force_n: FloatArray, *, faint_n: float) -> FloatArray:
    """Return the rise of ln force at each step that still lags in the sheet.

    `force_n`, shape (n_steps,): forces of a closing, newtons; below `faint_n` they count as that.

    >>> compute_lag(np.array([0.1, 0.2, 0.2]), faint_n=0.1).round(3).tolist()
    [0.0, 0.485, 0.34]
    """
    recovered, found = float(np.log(faint_n)), []
    for now in np.log(np.maximum(force_n, faint_n)):
        recovered += _RECOVERY * (now - recovered)
        found.append(now - recovered)
    return np.array(found)


def tilt_sd(law_sd: float) -> float:
    """Return the scatter of a contact's exponent, from the scatter of the law."""
    return float(np.clip(_TILT_FRACTION * law_sd, *_TILT_SDS))


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSamples:
    """The steps in use, arrays of shape (n,)."""

    #: Force read, and opening.
    read_n: FloatArray
    width_mm: FloatArray
    #: ln force, relative to where the gain was estimated.
    above: FloatArray
    #: Its rise that still lags, beyond that of the last step.
    lagging: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingSteps:
    """The steps of one closing, read as the grasp went."""

    #: Shape (n_steps,). Opening at each step, zero taken out.
    width_mm: FloatArray
    #: Shape (n_steps,). Force read there, newtons; 0 without contact.
    force_n: FloatArray
    #: Scatter of ln force from one contact to another.
    gain_sd: float
    #: Scatter of ln force that the sheet's law shows from placement to placement.
    law_sd: float
    #: Scatter of faint forces, newtons.
    floor_n: float

    @property
    def faint_n(self) -> float:
        """Force below which a reading shows only that it is small."""
        return CONTACT_SD * self.floor_n

    @property
    def is_certain(self) -> NDArray[np.bool_]:
        """Return the steps with a force above drift, or all with force if too few."""
        sure = self.force_n > self.faint_n
        return sure if np.count_nonzero(sure) >= _FEWEST else self.force_n > 0

    @property
    def rising(self) -> FloatArray:
        """Rise of ln force at each step with force that still lags in the sheet."""
        return compute_lag(self.force_n[self.is_certain], faint_n=self.faint_n)

    @property
    def used_steps(self) -> NDArray[np.int64]:
        """Indices of the steps in use: at most `_MOST_STEPS`, evenly spread."""
        felt = int(np.count_nonzero(self.is_certain))
        return np.unique(np.linspace(0, felt - 1, min(felt, _MOST_STEPS)).round().astype(int))

    @property
    def samples(self) -> CurveSamples:
        """The steps that are used."""
        read_n = self.force_n[self.is_certain][self.used_steps]
        share = read_n / read_n.max()
        weight = np.where(share > _GAIN_FROM, share**2, 0.0)
        above, lagging = np.log(read_n), self.rising[self.used_steps]
        return CurveSamples(
            read_n=read_n,
            width_mm=self.width_mm[self.is_certain][self.used_steps],
            above=above - np.average(above, weights=weight),
            lagging=lagging - lagging[-1],
        )

    @property
    def own_gain_sd(self) -> float:
        """Uncertainty of the gain without the exponent's part, which is solved for."""
        tilted = tilt_sd(self.law_sd) * self.samples.above[-1]
        return float(np.sqrt(max(self.gain_sd**2 - tilted**2, (0.5 * self.gain_sd) ** 2)))


def normal_density(x: ArrayLike, mean: float, sd: float) -> FloatArray:
    """Return the normal density at `x`, of any shape.

    The distributions of `scipy.stats` take longer to load.

    >>> normal_density([0.0, 1.0], 0.0, 1.0).round(4).tolist()
    [0.3989, 0.242]
    """
    z = (np.asarray(x, dtype=float) - mean) / sd
    return np.asarray(np.exp(-(z**2) / 2.0) / math.sqrt(2.0 * math.pi) / sd)
