"""Size and stiffness of an object from its closing curve, corrected for gripper compliance.

The unknowns are estimated together: the contact position, the shape and scale of the object's force
law, the gain of this contact relative to the sheet's law, and the gripper's compliance here. They
are correlated: a force read too high also overestimates the gripper's deflection, so the object
seems too stiff for two reasons. The intervals include all unknowns. Shape and scale are on a grid.
For each pair, the other unknowns change the contact position of each step linearly, and are
solved for (generalised least squares with priors).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtri

from palpate.arrays import FloatArray
from palpate.measurement import Measurement, Status
from palpate.object.compliance import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Compliance

#: Exponents of force over indentation, with prior probabilities: 1 for a flat or layered body, 1.5
#: for a round one (Hertz), 1.25 for intermediate shapes, 2 for a pointed or stiffening body.
_SHAPES = {1.0: 0.4, 1.25: 0.15, 1.5: 0.35, 2.0: 0.1}
#: Scatter of ln force between steps of one closing, with prior probabilities. Most contacts read
#: evenly after correction of exponent and lag; in some the object shifts.
_SCATTERS = {0.007: 0.4, 0.02: 0.4, 0.08: 0.2}
#: Relative change of compliance for an object off the middle, or with another face than the block.
_COMPLIANCE_SD = 0.02
#: Relaxation (ln force) of the object between closing and horizon: probability, mean and standard
#: deviation. Springs and silicone hardly relax, fruit by a tenth to a third. The force never rises
#: at constant closure.
_RELAXED = ((0.6, -0.03, 0.04), (0.4, -0.2, 0.1))
#: Neither sheet nor current shows the relaxation of a held object. In half of the objects, fruit,
#: the force is lower than estimated by this amount (ln).
_FRUIT_FRACTION, _UNSEEN, _UNSEEN_SD = 0.5, -0.06, 0.04
#: Additional error (ln force) of a forecast after several steps, because the settling model is
#: known only for single steps.
_FORECAST_SD = 0.02
#: Uncertainty of the gripper's zero, from a block with a size tolerance of 0.1 mm.
_BLOCK_SD_MM = 0.06
#: Smallest uncertainty of a width, mm (half an encoder step of a typical servo).
_SHARPEST_MM = 0.02
_GAINS, _SCALES, _DRAWS = 5, 40, 4000
#: Number of solved unknowns: size, gain relative to the grid's, exponent, lag, compliance.
_UNKNOWN = 5
#: Fraction of the gain's uncertainty that is solved linearly at each grid point. The rest is
#: covered by the grid of gains, because large changes of gain have nonlinear effects.
_SOLVED_FRACTION = 0.5

#: A reading just after a step is low, because the sheet lags: by this fraction of the lagging rise
#: (ln force). On development closings of the twin, compared with the true forces, 0.16 on springs;
#: 0.05 if half of the objects relax like fruit. Relaxation bends the curve in the opposite
#: direction, so a stiffness estimated from the bend needs no correction on average.
LAG, LAG_SD = 0.1, 0.08
#: Fraction of a sheet's lag that disappears with each closing step.
_RECOVERY = 0.3
#: Scatter of a contact's exponent relative to the law's, per unit of ln force. It has two causes:
#: a growing load spreads over more pixels, and the sheet saturates. Given as a fraction of the
#: law's scatter between placements, with its smallest and largest value.
_TILT_FRACTION, _TILT_SDS = 0.5, (0.04, 0.4)
#: The servo current determines the gain from this fraction of the final force on, with a weight
#: that grows with force, and with the sheet's lag corrected.
_GAIN_FROM = 0.3
#: A force below this many standard deviations of weak forces may be drift before contact. Such a
#: step only gives an upper bound of the force.
CONTACT_SD = 2.0
#: The data are readings at given widths, but the equations give widths at given readings. The
#: evidence includes this power of the slopes that convert between the two, if a step before contact
#: bounds the size (the bound is needed because a deep contact has large slopes). On development
#: closings of the twin, a power of 0 gave a size RMS of 0.42 mm (`lab`) and 0.35 mm (`field`), and
#: 0.3 gave 0.38 and 0.30 mm. Above 0.3 the lower bound of the stiffness becomes so small that firm
#: objects are not squeezed until their stiffness is known.
_SLOPE_POWER = 0.3
#: Fewest steps with force in a curve.
_FEWEST = 2
#: Most steps used of a long closing, because adjacent steps carry the same information.
_MOST_STEPS = 14


class ClosingAnswer(NamedTuple):
    """Size and stiffness of an object, from its closing curve and the settled force."""

    size_mm: Measurement
    stiffness: Measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """Grid of gains, shapes, scales and scatter levels, with the solution at each point."""

    #: Shape (gains, shapes, scales, scatters). Probability of each grid point; sums to 1.
    weight: FloatArray
    #: Shape (gains, shapes, scales, scatters, 5). Mean of size, further gain, exponent, lag and
    #: compliance.
    mean: FloatArray
    #: Shape (gains, shapes, scales, scatters, 5, 5). Inverse of their covariance.
    precision: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Posterior:
    """Samples of the posterior, arrays of shape (draws,)."""

    size_mm: FloatArray
    scale: FloatArray
    shape: FloatArray
    end_gain: FloatArray
    compliance_factor: FloatArray


def measure_closing(
    curve: ClosingSteps, *, compliance: Compliance, opening_mm: float, force: Measurement
) -> ClosingAnswer | None:
    """Estimate size, and secant stiffness at the settled force; None with few steps.

    `compliance`: compliance of pads, fingers and servo.
    `opening_mm`: final opening, corrected for the zero.
    `force`: settled force at that opening, newtons.

    A spring of 2 N/mm in a gripper with a compliance of 0.2 mm/N:

    >>> force_n = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 6.0])
    >>> compliance = Compliance(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0,
    ...     residual_mm=0.02, largest_force_n=15.0)
    >>> curve = ClosingSteps(width_mm=40.0 - 0.7 * force_n, force_n=force_n, gain_sd=0.03,
    ...     law_sd=0.05, floor_n=0.02, weak_n=0.04)
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
    log_sd = force.log_sd
    # The settled force also reduces the uncertainty of the contact's gain.
    curve = replace(curve, gain_sd=min(curve.gain_sd, log_sd))
    # A fixed seed, for reproducible results.
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
    likely = sum(fraction * normal_density(relaxed, mean, sd) for fraction, mean, sd in _RELAXED)
    weight = np.where(possible, likely, 0.0)
    rigid = weight.sum() < 1e-3 * _DRAWS
    weight = np.ones_like(weight) if rigid else weight
    size_mm = Measurement.from_samples(held.size_mm, weight=weight, unit="mm", level=force.level)
    stiffness = Measurement.from_samples(
        np.clip(force_n / deformed, SOFTEST_N_PER_MM, STIFFEST_N_PER_MM),
        weight=weight,
        unit="n_per_mm",
        level=force.level,
        status=Status.SATURATED if rigid else force.status,
    )
    zero_sd_mm = math.hypot(compliance.residual_mm, _BLOCK_SD_MM)
    return ClosingAnswer(size_mm.widened(sd=zero_sd_mm), stiffness)


def _posterior(
    curve: ClosingSteps, *, compliance: Compliance, rng: np.random.Generator
) -> _Posterior:
    """Evaluate the grid twice, the second time near the estimated scale, and draw samples."""
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
    """Return equally likely gains (ln force); each has the solved uncertainty in addition."""
    middles = ndtri((np.arange(_GAINS) + 0.5) / _GAINS)
    scale = np.sqrt(1 - _SOLVED_FRACTION**2) / np.std(middles)
    return np.asarray(curve.gain_sd_without_exponent * scale * middles)


def _weigh(curve: ClosingSteps, compliance: Compliance, scales: FloatArray) -> _Grid:
    """Solve each grid point, weighted by the agreement of contact positions over the steps."""
    touch_mm, design = _contact_equations(curve, compliance, scales)
    scatters = np.array(list(_SCATTERS))
    relative = scatters[:, None] ** 2 + (curve.floor_n / curve.samples.read_n) ** 2
    sharp_mm = max(compliance.residual_mm, _SHARPEST_MM)
    weight = 1.0 / (sharp_mm**2 + design[..., None, :, 1] ** 2 * relative)
    gain_sd = max(_SOLVED_FRACTION * curve.gain_sd_without_exponent, 1e-3)
    known = np.array([np.inf, gain_sd, tilt_sd(curve.law_sd), LAG_SD, _COMPLIANCE_SD])
    # Subtract the mean, because squares of full widths would lose precision.
    middle_mm = float(touch_mm.mean())
    off_mm = touch_mm - middle_mm
    products = (design[..., :, None] * design[..., None, :]).reshape(*design.shape[:-1], -1)
    precision = (weight @ products).reshape(*weight.shape[:-1], _UNKNOWN, _UNKNOWN)
    precision += np.diag(known**-2.0)
    moment = weight @ (design * off_mm[..., None])
    mean = np.asarray(np.linalg.solve(precision, moment[..., None])[..., 0], dtype=float)
    residual = (weight @ (off_mm**2)[..., None])[..., 0] - (moment * mean).sum(axis=-1)
    volume = np.log(weight).sum(axis=-1) - np.linalg.slogdet(precision)[1]
    evidence = 0.5 * (volume - residual)
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
    """Return the contact position at each step and the design matrix of the unknowns.

    Shapes: (gains, shapes, scales, steps); the design matrix has an additional last axis of length
    5. At each step, width, gripper deflection and deformation add up to the size. The columns of
    the design matrix belong to size, gain, exponent, lag and compliance.
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
    """Return the log likelihood of the steps before the first step with force.

    These steps bound the size, because their force was at most weak. Later steps without a reading
    are ignored, because changes of pixels may cancel.
    """
    power = 1.0 / np.array(list(_SHAPES))[:, None, None]
    weak_mm = (curve.weak_n / scales[:, None]) ** power + float(
        compliance.deflection_mm(curve.weak_n)
    )
    limit_mm = float(curve.width_mm[: np.argmax(curve.is_certain)].min()) + weak_mm
    return np.asarray(log_ndtr((limit_mm - size_mm) / sd_mm))


def compute_lag(force_n: FloatArray, *, weak_n: float) -> FloatArray:
    """Return the lagging rise of ln force at each step, which the sheet underestimates.

    `force_n`, shape (n_steps,): forces of a closing, newtons; at least `weak_n` is used.

    >>> compute_lag(np.array([0.1, 0.2, 0.2]), weak_n=0.1).round(3).tolist()
    [0.0, 0.485, 0.34]
    """
    recovered, found = float(np.log(weak_n)), []
    for now in np.log(np.maximum(force_n, weak_n)):
        recovered += _RECOVERY * (now - recovered)
        found.append(now - recovered)
    return np.array(found)


def tilt_sd(law_sd: float) -> float:
    """Return the scatter of a contact's exponent, from the scatter of the law."""
    return float(np.clip(_TILT_FRACTION * law_sd, *_TILT_SDS))


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSamples:
    """The steps in use; arrays have shape (n,)."""

    #: Force read, and opening.
    read_n: FloatArray
    width_mm: FloatArray
    #: ln force, relative to where the gain was estimated.
    above: FloatArray
    #: Lagging rise, minus that of the last step.
    lagging: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingSteps:
    """Steps of one closing, read during the grasp."""

    #: Shape (n_steps,). Opening at each step, corrected for the zero.
    width_mm: FloatArray
    #: Shape (n_steps,). Measured force at each step, newtons; 0 without contact.
    force_n: FloatArray
    #: Scatter of ln force from one contact to another.
    gain_sd: float
    #: Scatter of ln force between placements, from the sheet's law.
    law_sd: float
    #: Scatter of weak forces, newtons.
    floor_n: float
    #: Force below which a reading is only an upper bound.
    weak_n: float

    @property
    def is_certain(self) -> NDArray[np.bool_]:
        """Steps with a force above drift, or with any force if too few."""
        certain = self.force_n > self.weak_n
        return certain if np.count_nonzero(certain) >= _FEWEST else self.force_n > 0

    @property
    def rising(self) -> FloatArray:
        """Lagging rise of ln force at each certain step."""
        return compute_lag(self.force_n[self.is_certain], weak_n=self.weak_n)

    @property
    def used_steps(self) -> NDArray[np.int64]:
        """Indices of the steps in use: at most `_MOST_STEPS`, evenly spread."""
        count = int(np.count_nonzero(self.is_certain))
        return np.unique(np.linspace(0, count - 1, min(count, _MOST_STEPS)).round().astype(int))

    @property
    def samples(self) -> CurveSamples:
        """Samples of the steps in use."""
        read_n = self.force_n[self.is_certain][self.used_steps]
        fraction = read_n / read_n.max()
        weight = np.where(fraction > _GAIN_FROM, fraction**2, 0.0)
        above, lagging = np.log(read_n), self.rising[self.used_steps]
        return CurveSamples(
            read_n=read_n,
            width_mm=self.width_mm[self.is_certain][self.used_steps],
            above=above - np.average(above, weights=weight),
            lagging=lagging - lagging[-1],
        )

    @property
    def gain_sd_without_exponent(self) -> float:
        """Uncertainty of the gain without the contribution of the exponent."""
        tilted = tilt_sd(self.law_sd) * self.samples.above[-1]
        return float(np.sqrt(max(self.gain_sd**2 - tilted**2, (0.5 * self.gain_sd) ** 2)))


def normal_density(x: ArrayLike, mean: float, sd: float) -> FloatArray:
    """Return the normal density at `x`, of any shape.

    `scipy.stats` is avoided because of its import time.

    >>> normal_density([0.0, 1.0], 0.0, 1.0).round(4).tolist()
    [0.3989, 0.242]
    """
    z = (np.asarray(x, dtype=float) - mean) / sd
    return np.asarray(np.exp(-(z**2) / 2.0) / math.sqrt(2.0 * math.pi) / sd)
