"""An object's stiffness from several grasps of it to different forces.

While a hand closes the sheet lags and the object relaxes, and both bend the curve from which one
grasp tells a stiffness. Where the hand stood both have settled: the widths and settled forces at
which grasps of different strength ended are points of one curve, which nothing of the kind bends.
They are few, though, and each is off by its own contact. So the curve through the points and the
closing of the firmest grasp, which err for different reasons, are weighed together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from palpate.estimate.measurement import Measurement
from palpate.estimate.object_law import (
    GIVE_SD,
    SHAPES,
    SHARPEST_MM,
    SOFTEST_N_PER_MM,
    STIFFEST_N_PER_MM,
    FloatArray,
    weighted_quantiles,
)
from palpate.estimate.stiffness import Give

#: Fewer points, or a firmest force that is less than so many times the faintest, are no curve.
FEWEST_POINTS, LEAST_SPAN = 3, 1.5
#: By how much (ln force) contacts of one sheet differ from each other, each as likely as the
#: others; the rest of a force's doubt is the same for all contacts of the series.
_OWN_SDS = (0.02, 0.04, 0.08, 0.15)
#: What all contacts share is never known better (ln force).
_LEAST_COMMON_SD = 0.02
#: Newtons by which faint forces are off besides.
_FAINT_N = 0.05
#: Closing and points rest on one force law, one give and, where there is one, one servo's current:
#: of their errors, as shares of their intervals, so much is correlated (0.4 at `paper` and 0.6 at
#: `field` on development series of the twin).
_ALIKE = 0.5
_GAINS, _SCALES = 9, 240


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledPoint:
    """Where one grasp of a series ended.

    Attributes
    ----------
    opening_mm : float
        Final opening, zero taken out.
    force : Measurement
        Settled force there, newtons.
    stiffness : Measurement or None
        What the closing of this grasp alone said of the object, N/mm.
    """

    opening_mm: float
    force: Measurement
    stiffness: Measurement | None = None


def series_stiffness(points: Sequence[SettledPoint], *, give: Give) -> Measurement | None:
    """Return the secant stiffness at the firmest force; None if the points are no curve.

    Parameters
    ----------
    points : sequence of SettledPoint
        Grasps of one object, in any order.
    give : Give
        Of pads, fingers and servo.

    Examples
    --------
    A spring of 2 N/mm, 40 mm long, in a hand that gives way by 0.2 mm/N:

    >>> give = Give(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.02,
    ...     largest_force_n=15.0)
    >>> points = [
    ...     SettledPoint(opening_mm=40.0 - 0.7 * n, force=Measurement(
    ...         value=n, low=0.93 * n, high=1.07 * n, unit="n"))
    ...     for n in (2.0, 4.0, 6.0, 8.0, 10.0)
    ... ]
    >>> found = series_stiffness(points, give=give)
    >>> found.low < 2.0 < found.high, abs(found.value - 2.0) < 0.2
    (True, True)
    """
    told = [point for point in points if point.force.value > 0]
    force_n = [point.force.value for point in told]
    if len(told) < FEWEST_POINTS or max(force_n) < LEAST_SPAN * min(force_n):
        return None
    by_points = _through(told, give=give)
    firmest = max(told, key=lambda point: point.force.value)
    if firmest.stiffness is None:
        return by_points
    return _weighed(firmest.stiffness, by_points)


def _through(points: Sequence[SettledPoint], *, give: Give) -> Measurement:
    """Return what the curve through the settled points says."""
    firmest = max(points, key=lambda point: point.force.value).force
    places = [
        _evidence(points, give=give, own_sd=own_sd, shape=shape, common=common)
        for own_sd in _OWN_SDS
        for shape, common in SHAPES.items()
    ]
    found, likely = (np.concatenate(part) for part in zip(*places, strict=True))
    tail = (1 - firmest.level) / 2
    low, value, high = weighted_quantiles(
        found, np.exp(likely - likely.max()), [tail, 0.5, 1 - tail]
    )
    return replace(firmest, value=value, low=low, high=high, unit="n_per_mm")


def _evidence(
    points: Sequence[SettledPoint], *, give: Give, own_sd: float, shape: float, common: float
) -> tuple[FloatArray, FloatArray]:
    """Return stiffnesses on a grid of common gains and scales, and the log of how likely each is.

    At each place every point says where contact began; they agree but for their own doubts and for
    the share by which the hand gives more than on the block, which is solved for.
    """
    width_mm = np.array([point.opening_mm for point in points])
    read_n = np.array([point.force.value for point in points])
    middles = ndtri((np.arange(_GAINS) + 0.5) / _GAINS)
    gain = _common_sd(points, own_sd=own_sd) * middles / np.std(middles)
    force_n = read_n * np.exp(gain)[:, None, None]
    scales = np.geomspace(SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, _SCALES)[:, None]
    give_mm = give.give_mm(force_n)
    deformed_mm = (force_n / scales) ** (1.0 / shape)
    slope_mm = (give.give_mm(1.01 * force_n) - give_mm) / 0.01 + deformed_mm / shape
    doubt = own_sd**2 + (_FAINT_N / read_n) ** 2
    weight = 1.0 / (max(give.residual_mm, SHARPEST_MM) ** 2 + slope_mm**2 * doubt)
    began_mm = width_mm + give_mm + deformed_mm
    evidence = _agreement(began_mm, more_mm=np.broadcast_to(give_mm, weight.shape), weight=weight)
    firmest_n = read_n.max() * np.exp(gain)[:, None]
    stiffness = firmest_n / (firmest_n / scales[:, 0]) ** (1.0 / shape)
    return stiffness.ravel(), evidence.ravel() + np.log(common)


def _common_sd(points: Sequence[SettledPoint], *, own_sd: float) -> float:
    """Return what the contacts of the series share of the doubt of their forces (ln force)."""
    reach = float(ndtri(0.5 + points[0].force.level / 2))
    whole = [
        np.log(one.force.high / max(one.force.low, 0.05 * one.force.value)) / (2 * reach)
        for one in points
    ]
    return float(np.sqrt(max(np.median(whole) ** 2 - own_sd**2, _LEAST_COMMON_SD**2)))


def _agreement(began_mm: FloatArray, *, more_mm: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the log likelihood of the points at each place: size and further give solved for."""
    off_mm = began_mm - began_mm.mean()
    size, mixed, further = (
        weight.sum(axis=-1),
        -(weight * more_mm).sum(axis=-1),
        (weight * more_mm**2).sum(axis=-1) + GIVE_SD**-2.0,
    )
    moment, moment_more = (weight * off_mm).sum(axis=-1), -(weight * more_mm * off_mm).sum(axis=-1)
    volume = size * further - mixed**2
    explained = (
        further * moment**2 - 2 * mixed * moment * moment_more + size * moment_more**2
    ) / volume
    left = (weight * off_mm**2).sum(axis=-1) - explained
    return np.asarray(0.5 * (np.log(weight).sum(axis=-1) - np.log(volume) - left))


def _weighed(one: Measurement, other: Measurement) -> Measurement:
    """Return the mean of two witnesses (ln stiffness) by their variances, their errors alike."""
    reach = float(ndtri(0.5 + one.level / 2))
    logs = np.log([[m.low, m.value, m.high] for m in (one, other)])
    sd = np.maximum((logs[:, 2] - logs[:, 0]) / (2 * reach), 1e-3)
    weight = sd**-2.0 / np.sum(sd**-2.0)
    parts = weight * sd
    half = reach * float(np.sqrt(parts @ parts + 2 * _ALIKE * parts[0] * parts[1]))
    value = float(weight @ logs[:, 1])
    low, middle, high = np.exp([value - half, value, value + half]).tolist()
    return replace(one, value=middle, low=low, high=high)
