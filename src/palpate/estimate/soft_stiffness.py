"""An object's stiffness from a grasp by fingers that give way more than it does.

Soft fingers give way by millimetres per newton, so what the object gives is a small difference of
two large ways: how far the fingers would have closed beyond the first touch, and how far they bent
back under the force. The curve in between tells little more, because a sheet's error of exponent
bends it as an object would. So only both ends are used, and what they leave open is said: often no
more than that the object is not softer than so much.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from palpate.estimate.closing_steps import ClosingCurve, FloatArray
from palpate.estimate.measurement import Measurement
from palpate.estimate.stiffness import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Give
from palpate.settling.result import Status

#: Beyond its gain, a sheet reads the first force that it feels in a contact wrong by so much (ln
#: force): that force is the nearest to its threshold, and spread over unknown pixels.
_FIRST_SD = 0.3
#: The millimetres of a pressure are known to this share of the way.
_WAY_SHARE = 0.01
_STIFFNESSES, _FORCES = 120, 61
#: Something rigid that is this likely, against the likeliest stiffness, can't be excluded: the
#: ratio of likelihoods that a 90 % interval of a normal error leaves.
_RIGID_RATIO = 0.26


def soft_stiffness(
    curve: ClosingCurve, *, give: Give, opening_mm: float, force: Measurement
) -> Measurement | None:
    """Return the object's secant stiffness at the settled force; None if too little was felt.

    Parameters
    ----------
    curve : ClosingCurve
        The closing; widths are those that the fingers would have with nothing between them.
    give : Give
        Of the fingers.
    opening_mm : float
        Final width of that kind.
    force : Measurement
        Settled force there, newtons.

    Returns
    -------
    Measurement or None
        Its status is `saturated` where the object may be as stiff as you like.

    Examples
    --------
    Fingers that give way by 3.5 mm/N, touching at 40 mm, on 0.5 N/mm and on something rigid:

    >>> give = Give(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.1,
    ...     largest_force_n=15.0)
    >>> held = Measurement(value=4.0, low=3.6, high=4.4, unit="n", level=0.9)
    >>> force_n = np.array([0.0, 0.5, 2.0, 4.0])
    >>> for own_mm_per_n in (2.0, 0.0):
    ...     width_mm = 40.0 - (3.5 + own_mm_per_n) * force_n
    ...     curve = ClosingCurve(width_mm=width_mm, force_n=force_n, gain_sd=0.05,
    ...         law_sd=0.1, floor_n=0.02)
    ...     found = soft_stiffness(curve, give=give, opening_mm=float(width_mm[-1]), force=held)
    ...     print(found.low < 0.5 < found.high, found.status)
    True ok
    False saturated
    """
    if not curve.felt.any() or force.value <= 0:
        return None
    stiffness = np.geomspace(SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, _STIFFNESSES)
    tail = (1 - force.level) / 2
    log_sd = np.log(force.high / max(force.low, 1e-3 * force.value)) / (2 * norm.ppf(1 - tail))
    middles = norm.ppf((np.arange(_FORCES) + 0.5) / _FORCES)
    force_n = force.value * np.exp(log_sd * middles)
    # Where contact began, if the object is so stiff and the force so large.
    began_mm = opening_mm + give.give_mm(force_n) + force_n / stiffness[:, None]
    way_mm = began_mm - opening_mm
    likely = _began(curve, give, stiffness, began_mm, way_mm).mean(axis=1)
    # Before the grasp all softness (mm/N) that this hand can tell apart is equally likely. It can't
    # tell less apart than its give times the doubt of the force.
    blind_mm_per_n = log_sd * float(give.give_mm(force.value)) / force.value
    weight = likely / (1.0 + blind_mm_per_n * stiffness)
    if not weight.sum() > 0:
        return None
    reached = np.cumsum(weight) - 0.5 * weight
    low, value, high = np.exp(
        np.interp([tail, 0.5, 1 - tail], reached / weight.sum(), np.log(stiffness))
    )
    open_above = likely[-1] > _RIGID_RATIO * likely.max()
    return Measurement(
        value=float(value),
        low=float(low),
        high=STIFFEST_N_PER_MM if open_above else float(high),
        unit="n_per_mm",
        level=force.level,
        status=Status.SATURATED if open_above else force.status,
    )


def _began(
    curve: ClosingCurve,
    give: Give,
    stiffness: FloatArray,
    began_mm: FloatArray,
    way_mm: FloatArray,
) -> FloatArray:
    """Return how likely contact began there by the first touch, shape (stiffnesses, forces)."""
    first = int(np.argmax(curve.felt))
    touched_mm, first_n = float(curve.width_mm[first]), float(curve.force_n[first])
    per_n = float(give.give_mm(1.0)) + 1.0 / stiffness[:, None]
    by_force_mm = touched_mm + float(give.give_mm(first_n)) + first_n / stiffness[:, None]
    first_sd = np.hypot(np.hypot(curve.gain_sd, _FIRST_SD) * first_n, curve.floor_n)
    sharp_mm = np.hypot(give.residual_mm, _WAY_SHARE * way_mm)
    sd_mm = np.hypot(first_sd * per_n, sharp_mm)
    likely = norm.pdf(began_mm, by_force_mm, sd_mm) * norm.cdf((began_mm - touched_mm) / sharp_mm)
    if first > 0:
        # Nothing was felt one step before: no more than a faint force can have been there.
        furthest_mm = float(curve.width_mm[first - 1]) + curve.faint_n * per_n
        likely = likely * norm.cdf((furthest_mm - began_mm) / np.hypot(sharp_mm, 0.5 * sd_mm))
    return np.asarray(likely)
