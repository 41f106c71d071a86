"""Size and stiffness of an object from its closing curve, corrected for gripper compliance.

Object and gripper are springs in series. At the opening w a force F deforms both, and together they
take up the difference between the object's size s and the opening:

    s - w = C(F) + (F / k)^(1/n)                                                              (1)

C is the gripper's deflection, calibrated on a rigid block. The object's force law is F = k d^n:
n is 1 for a flat face, and 1.5 for a round one (Hertz). Equation 1 gives the force F(w) at each
step. The sheet reads it as

    ln f = ln F(w) + g + t a + l b - c C(F) / e + noise                                       (2)

with the gain g of this contact, an error t of the law's exponent (a: ln force relative to the last
one), the sheet's lag l (b: the lagging rise of ln force), and a relative error c of the compliance
(e: change of w per ln force). The present force is the last reading. The last step before contact
bounds F(w) from above.

The object then relaxes: k exp(r) in place of k (`palpate.object.relaxation`). The secant stiffness
of the settled object, at its settled force or another, follows from k, n and r.

The posterior is evaluated on a grid of n, k and F at the final opening, which gives the size. The
other unknowns are normal and linear in equation 2: they add to the covariance of the readings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtri

from palpate.arrays import FloatArray
from palpate.measurement import Measurement
from palpate.object.compliance import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Compliance
from palpate.object.relaxation import RELAXED, RELAXED_SD

#: Exponents of force over indentation, equally likely: the 1/6, 1/2 and 5/6 quantiles of 162 real
#: closings on bananas, kiwis and mangos (`fruit_rupture`, to 60 % of the rupture), each kind
#: counting alike. A flat body has 1, and a round one 1.5 (Hertz).
_EXPONENTS = (1.0, 1.25, 1.65)
#: Prior of ln k, mean and standard deviation: from foam to wood, around 5 N/mm.
_LOG_SCALE, _LOG_SCALE_SD = 1.6, 2.0
#: Prior of the travel from contact to the first reading, exponential: its mean. A hand that closes
#: at speed stops within about this travel.
_OVERRUN_MM = 2.0
#: Scatter of ln force between steps of one closing, and of weak forces as a fraction of the law's,
#: which includes the gain of each contact. On 240 development closings of the twin and 150 on its
#: named fruit a scatter of 0.03 covers .87 of the sizes, 0.06 covers .94, and 0.08 has wider ends.
_SCATTER, _FLOOR_FRACTION = 0.06, 0.5
#: The lag of the sheet is this fraction of the lagging rise. Relaxation of the object bends the
#: curve in the opposite direction, so a stiffness needs no correction on average.
_LAG_SD = 0.08
#: Fraction of a sheet's lag that disappears with each closing step.
_RECOVERY = 0.3
#: Relative change of compliance for an object off the middle, or with another face than the block.
_COMPLIANCE_SD = 0.02
#: Uncertainty of the gripper's zero, from a block with a size tolerance of 0.1 mm.
_BLOCK_SD_MM = 0.06
#: Smallest uncertainty of a width, mm (half an encoder step of a typical servo).
_SHARPEST_MM = 0.02
#: Scatter of a contact's exponent relative to the law's, per unit of ln force. It has two causes:
#: a growing load spreads over more pixels, and the sheet saturates. Given as a fraction of the
#: law's scatter between placements, with its smallest and largest value.
_TILT_FRACTION, _TILT_SDS = 0.5, (0.08, 0.4)
#: A force below this many standard deviations of weak forces may be drift before contact.
CONTACT_SD = 2.0
#: Most steps used of a long closing, because adjacent steps carry the same information.
_MOST_STEPS = 14
#: The grid: scales, errors of the final force in standard deviations, and changes of ln force by
#: relaxation, equally likely; the forces at which equation 1 is tabulated, newtons.
_SCALES = np.geomspace(SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, 100)
_FINAL_SDS = np.linspace(-3.5, 3.5, 41)
_RELAXATIONS = RELAXED + RELAXED_SD * ndtri((np.arange(7) + 0.5) / 7)
_FORCES_N = np.geomspace(1e-3, 300.0, 400)
#: Weight of a grid point, relative to the largest, below which it is ignored.
_LEAST_WEIGHT = 1e-6


class ClosingAnswer(NamedTuple):
    """Size and secant stiffness of an object, at the settled force and at a reference force.

    `closing` is the stiffness over the upper half of the present force, before the object relaxes:
    that of `ClosingState`, from which a damage model predicts the rupture force.
    """

    #: None if the hand does not know its opening in millimetres.
    size_mm: Measurement | None
    stiffness: Measurement
    reference: Measurement
    closing: Measurement


class _Grid(NamedTuple):
    """Posterior for one exponent, shape (scales, final forces)."""

    log_weight: FloatArray
    size_mm: FloatArray
    #: ln stiffness of the settled object at its force and at the reference force, for each of
    #: `_RELAXATIONS`, and over the upper half of the closing; shape (scales, final forces,
    #: relaxations).
    log_stiffness: FloatArray
    log_reference: FloatArray
    log_closing: FloatArray


def measure_closing(
    curve: ClosingSteps,
    *,
    compliance: Compliance,
    opening_mm: float,
    force: Measurement,
    reference_n: float = 2.0,
) -> ClosingAnswer | None:
    """Estimate size and secant stiffness; None without a force.

    `compliance`: compliance of pads, fingers and servo.
    `opening_mm`: final opening, corrected for the zero.
    `force`: present force at that opening, newtons; the stiffnesses are those of the object that
    has relaxed.
    `reference_n`: force of a stiffness that can be compared between grasps.

    A spring of 2 N/mm in a gripper with a compliance of 0.2 mm/N:

    >>> force_n = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 6.0])
    >>> compliance = Compliance(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0,
    ...     residual_mm=0.02, largest_force_n=15.0)
    >>> curve = ClosingSteps(width_mm=40.0 - 0.7 * force_n, force_n=force_n, gain_sd=0.03,
    ...     law_sd=0.05, floor_n=0.02, weak_n=0.04)
    >>> held = Measurement(value=6.0, low=5.6, high=6.4, unit="n", level=0.9)
    >>> size_mm, stiffness, reference, closing = measure_closing(curve, compliance=compliance,
    ...     opening_mm=35.8, force=held)
    >>> stiffness.low < 2.0 < stiffness.high, abs(stiffness.value - 2.0) < 0.2
    (True, True)
    >>> size_mm
    Measurement(40 mm, 39.86 to 40.12, ok)
    """
    if force.middle <= 0:
        return None
    readings = _read_closing(curve, compliance, opening_mm=opening_mm, force=force)
    grids = [_evaluate(exponent, readings, compliance, reference_n) for exponent in _EXPONENTS]
    log_weight, size_mm, *log_stiffnesses = (np.array(part) for part in zip(*grids, strict=True))
    log_weight -= log_weight.max()
    likely = log_weight > math.log(_LEAST_WEIGHT)
    weight = np.exp(log_weight[likely])
    size = Measurement.from_samples(size_mm[likely], weight=weight, unit="mm", level=force.level)
    repeated = np.repeat(weight, _RELAXATIONS.size)
    at_force, at_reference, closing = (
        Measurement.from_samples(
            np.clip(np.exp(found[likely]), SOFTEST_N_PER_MM, STIFFEST_N_PER_MM).ravel(),
            weight=repeated,
            unit="n_per_mm",
            level=force.level,
            status=force.status,
        )
        for found in log_stiffnesses
    )
    zero_sd_mm = math.hypot(compliance.residual_mm, _BLOCK_SD_MM)
    return ClosingAnswer(size.widened(sd=zero_sd_mm), at_force, at_reference, closing)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Readings:
    """Readings of the steps, and of the present force as the last; arrays of shape (n,)."""

    force_n: FloatArray
    width_mm: FloatArray
    #: Deflection of the gripper, and its change per ln force.
    deflection_mm: FloatArray
    deflection_slope_mm: FloatArray
    #: Mean error of ln force, and variance of its independent part without that of the width.
    log_error: FloatArray
    log_variance: FloatArray
    #: Shape (n, 3). Effect on ln force of one standard deviation of gain, exponent and lag.
    effects: FloatArray
    #: Uncertainty of a width.
    width_sd_mm: float
    #: Force below which a reading is compared in newtons, and above which in ln force.
    floor_n: float
    #: Opening before contact, and the largest force there.
    free_mm: float
    free_n: float


def _read_closing(
    curve: ClosingSteps, compliance: Compliance, *, opening_mm: float, force: Measurement
) -> _Readings:
    """Return the readings in use, at most `_MOST_STEPS` evenly spread steps."""
    certain = np.flatnonzero(curve.is_certain)
    count = min(certain.size, _MOST_STEPS)
    used = np.linspace(0, certain.size - 1, count).round().astype(int)
    lagging = compute_lag(curve.force_n[certain], weak_n=curve.weak_n)
    force_n = np.append(curve.force_n[certain][used], force.middle)
    log_ratio = np.log(force_n / force_n[-1])
    # Readings that scatter about a regression flatten it. On development sheets of the twin the
    # exponent was too small by 0.17 at a scatter of 0.43, and by 0 at 0.1.
    log_error = -(curve.law_sd**2) * log_ratio
    # The present force shares the gain of the contact; the rest of its error is its own.
    gain_sd = min(curve.gain_sd, force.log_sd)
    own = force.log_sd**2 - gain_sd**2 + _SCATTER**2
    floor_n = _FLOOR_FRACTION * curve.floor_n
    effects = [
        np.full(force_n.size, gain_sd),
        tilt_sd(curve.law_sd) * log_ratio,
        _LAG_SD * np.append((lagging - lagging[-1:])[used], 0.0),
    ]
    deflection_mm = compliance.deflection_mm(force_n)
    return _Readings(
        force_n=force_n,
        width_mm=np.append(curve.width_mm[certain][used], opening_mm),
        deflection_mm=deflection_mm,
        deflection_slope_mm=(compliance.deflection_mm(1.01 * force_n) - deflection_mm) / 0.01,
        log_error=log_error,
        log_variance=np.append(_SCATTER**2 + (floor_n / force_n[:-1]) ** 2, own),
        effects=np.stack(effects, axis=-1),
        width_sd_mm=max(compliance.residual_mm, _SHARPEST_MM),
        floor_n=floor_n,
        free_mm=curve.free_mm,
        free_n=min(curve.weak_n, float(force_n[0])),
    )


def _evaluate(
    exponent: float, readings: _Readings, compliance: Compliance, reference_n: float
) -> _Grid:
    """Return the posterior for one exponent."""
    scale = _SCALES[:, None]
    # Change of the width per ln force at each reading, shape (scales, n), and the object's part.
    object_mm = (readings.force_n / scale) ** (1.0 / exponent) / exponent
    slope_mm = readings.deflection_slope_mm + object_mm
    effects = [
        *np.broadcast_to(readings.effects.T[:, None], (3, *slope_mm.shape)),
        _COMPLIANCE_SD * readings.deflection_mm / slope_mm,
    ]
    design = np.stack(effects, axis=-1)
    covariance = design @ design.swapaxes(1, 2)
    variance = readings.log_variance + (readings.width_sd_mm / slope_mm) ** 2
    covariance += variance[..., None] * np.eye(readings.force_n.size)
    # A force near 0 has no useful logarithm: the grid ends at a factor of exp(7) to either side.
    final_sd = np.minimum(np.sqrt(covariance[:, -1, -1, None]), 2.0)
    # Weak forces have normal errors in newtons: asinh is linear there, and logarithmic above.
    per_log = readings.force_n / np.hypot(readings.force_n, readings.floor_n)
    covariance *= per_log[:, None] * per_log
    precision = np.linalg.inv(covariance)

    final_n = readings.force_n[-1] * np.exp(final_sd * _FINAL_SDS)
    deformed_mm = (final_n / scale) ** (1.0 / exponent)
    size_mm = readings.width_mm[-1] + compliance.deflection_mm(final_n) + deformed_mm
    widths_mm = np.append(readings.width_mm, readings.free_mm)
    table_mm = compliance.deflection_mm(_FORCES_N) + (_FORCES_N / scale) ** (1.0 / exponent)
    force_n = np.array(
        [
            np.interp(size[:, None] - widths_mm, table, _FORCES_N, left=0.0)
            for size, table in zip(size_mm, table_mm, strict=True)
        ]
    )
    error = np.arcsinh(readings.force_n / readings.floor_n) - per_log * readings.log_error
    error = error - np.arcsinh(force_n[..., :-1] / readings.floor_n)
    log_weight = -0.5 * ((error @ precision) * error).sum(axis=-1)
    log_weight += 0.5 * np.linalg.slogdet(precision)[1][:, None]
    log_weight += log_ndtr(CONTACT_SD * (1.0 - force_n[..., -1] / readings.free_n))
    log_weight -= 0.5 * ((np.log(scale) - _LOG_SCALE) / _LOG_SCALE_SD) ** 2
    log_weight -= (size_mm - readings.width_mm[0]) / _OVERRUN_MM
    # The spacing of the grid in size.
    log_weight += np.log(np.gradient(size_mm, axis=1))

    # ln (F / d), with F = k exp(r) d^n. The hand follows, so that F falls by the object's share.
    share = (object_mm / slope_mm)[:, -1:, None]
    settled_log_n = np.log(final_n)[..., None] + share * _RELAXATIONS
    log_scale = np.log(scale)[..., None] + _RELAXATIONS
    log_stiffness, log_reference = (
        log_n - (log_n - log_scale) / exponent
        for log_n in (settled_log_n, np.full_like(settled_log_n, math.log(reference_n)))
    )
    # ln ((F / 2) / (d(F) - d(F / 2))).
    upper_half_mm = (1.0 - 0.5 ** (1.0 / exponent)) * deformed_mm
    log_closing = np.log(0.5 * final_n / upper_half_mm)[..., None] + np.zeros(_RELAXATIONS.size)
    return _Grid(log_weight, size_mm, log_stiffness, log_reference, log_closing)


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
    #: Force below which a reading may be drift.
    weak_n: float

    @property
    def is_certain(self) -> NDArray[np.bool_]:
        """Steps with a force above drift, or with any force if there are fewer than two."""
        certain = self.force_n > self.weak_n
        return certain if np.count_nonzero(certain) > 1 else self.force_n > 0

    @property
    def free_mm(self) -> float:
        """Opening of the last step before contact; infinite without one."""
        return float(self.width_mm[np.cumsum(self.force_n) == 0].min(initial=np.inf))


def normal_density(x: ArrayLike, mean: float, sd: float) -> FloatArray:
    """Return the normal density at `x`, of any shape.

    `scipy.stats` is avoided because of its import time.

    >>> normal_density([0.0, 1.0], 0.0, 1.0).round(4).tolist()
    [0.3989, 0.242]
    """
    z = (np.asarray(x, dtype=float) - mean) / sd
    return np.asarray(np.exp(-(z**2) / 2.0) / math.sqrt(2.0 * math.pi) / sd)
