"""Size between the closing steps: where the force-closure curve begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr

from palpate.arrays import FloatArray

#: Exponents of force over indentation and how common they are: 1 a flat or layered body, 1.5 a
#: round one (Hertz).
_EXPONENTS = {1.0: 0.6, 1.5: 0.4}
#: The curve is read through a force law whose own exponent has an error of this log sd, and is
#: always a little low: a grasp loads the sheet in a few large steps, the bench in many small ones,
#: so that high forces have crept less here. Without it the exponent could only be too large, and
#: with it the size.
_LAW_LOG_SD, _LAW_LOG_MEAN = 0.2, -0.08
_NODES, _SHARES = np.polynomial.hermite_e.hermegauss(5)
#: Relative scatter of the force from step to step within one closing, and how likely: the readings
#: of one closing share its place on the sheet, so they scatter far less than those of several.
_SCATTER = {0.03: 0.6, 0.1: 0.4}
#: The force at which a touch is first felt differs from place to place like the sheet's gain, by
#: this log sd (robot presses against a load cell).
_PLACE_LOG_SD = 0.6
#: The gripper's zero was found on a block whose size is known to a tenth of a millimetre.
_BLOCK_SD_MM = 0.06
_GRID_MM = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactPoint:
    """Where contact began, as a distribution."""

    #: Shape (n_grid,). Candidates: the opening at which both fingers just touch.
    size_mm: FloatArray
    #: Shape (n_grid,). Their probabilities.
    weight: FloatArray

    @classmethod
    def mixture(cls, points: Sequence[ContactPoint], *, weights: Sequence[float]) -> ContactPoint:
        """Return one distribution out of several, each with the probability that it holds."""
        size_mm = np.concatenate([point.size_mm for point in points])
        parts = zip(points, weights, strict=True)
        weight = np.concatenate([share * point.weight for point, share in parts])
        order = np.argsort(size_mm, kind="stable")
        return cls(size_mm=size_mm[order], weight=weight[order] / weight.sum())

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return quantiles, linear between candidates, mm."""
        reached = np.cumsum(self.weight) - 0.5 * self.weight
        return np.asarray(np.interp(np.asarray(probability), reached, self.size_mm))


def contact_point(
    width_mm: ArrayLike,
    *,
    force_n: ArrayLike,
    give_mm: ArrayLike,
    floor_n: float,
) -> ContactPoint:
    """Extrapolate the force-closure curve back to no force.

    Each step is one reading. For each candidate size and exponent n, force = K * (size - width -
    give)**n with K free; the posterior is summed over n and over the scatter of the readings, so
    a curve that several shapes explain gives a wide answer. A common error of the force's gain
    goes into K and hardly moves the contact point; one of its exponent goes into n.

    `width_mm`, shape (n_steps,): opening at each step, steps without force included: they bound the
        size from above.
    `force_n`, shape (n_steps,): grip force read there; 0 where nothing was felt.
    `give_mm`, shape (n_steps,): how far pads, fingers and servo give way under that force.
    `floor_n`: force below which readings can't be distinguished: those near it count little, and
        steps without force may have had up to this much.
    Raises `ValueError` if no step has a force.

    >>> width = np.array([31.0, 30.0, 29.5, 29.0, 28.5])
    >>> force = 2.0 * np.maximum(30.4 - width, 0)
    >>> found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.05)
    >>> float(found.quantile(0.5).round(1))
    30.4
    """
    width, force, give = (np.asarray(a, dtype=float) for a in (width_mm, force_n, give_mm))
    felt = force > 0
    if not felt.any():
        raise ValueError("no step of the curve has a force; there is no contact point to look for")
    inner = width[felt] + give[felt]
    beyond = width[~felt]
    highest = max(float(beyond.min()) if beyond.size else -np.inf, float(inner.max())) + 2.0
    size = np.arange(float(inner.max()) + _GRID_MM, highest, _GRID_MM)
    # At small forces the gripper gives way at least as easily as at the smallest one that was felt.
    give_mm_per_n = float(np.max(give[felt] / force[felt]))
    # Steps wider than any candidate could not have felt it, and carry no information.
    beyond = beyond[beyond < size[-1]]
    log_weight = _log_evidence(
        np.log(size[:, None] - inner),
        np.log(force[felt]),
        np.maximum(size[:, None] - beyond, 1e-9),
        floor_n=floor_n,
        give_mm_per_n=give_mm_per_n,
    )
    return _blur(size, np.exp(log_weight - log_weight.max()).sum(axis=(0, 1)))


def _list_exponents() -> list[tuple[float, float]]:
    """Return exponents of the curve as it is read, and how common they are."""
    seen = np.exp(_LAW_LOG_MEAN + _LAW_LOG_SD * _NODES)
    return [
        (exponent * float(factor), share * float(likely))
        for exponent, share in _EXPONENTS.items()
        for factor, likely in zip(seen, _SHARES / _SHARES.sum(), strict=True)
    ]


def _blur(size_mm: FloatArray, weight: FloatArray) -> ContactPoint:
    """Return the distribution with the doubt about the gripper's zero in it."""
    reach = np.arange(-3 * _BLOCK_SD_MM, 3 * _BLOCK_SD_MM + _GRID_MM / 2, _GRID_MM)
    blur = np.exp(-0.5 * (reach / _BLOCK_SD_MM) ** 2)
    wide = np.convolve(weight, blur)
    first = size_mm[0] + reach[0]
    return ContactPoint(size_mm=first + _GRID_MM * np.arange(wide.size), weight=wide / wide.sum())


def _log_evidence(
    log_depth: FloatArray,
    log_force: FloatArray,
    closed: FloatArray,
    *,
    floor_n: float,
    give_mm_per_n: float,
) -> FloatArray:
    """Return the log evidence with ln K integrated out, shape (exponents, scatters, n_sizes).

    `closed`, shape (n_sizes, n_unfelt), is how far the unfelt steps reach into each size.
    """
    exponent, common = (np.array(each) for each in zip(*_list_exponents(), strict=True))
    scatter, likely = np.array(list(_SCATTER)), np.array(list(_SCATTER.values()))
    precision = 1.0 / (scatter[:, None] ** 2 + (0.5 * floor_n / np.exp(log_force)) ** 2)
    share = (precision / precision.sum(axis=-1, keepdims=True)).T
    left = log_force - exponent[:, None, None] * log_depth
    log_k = left @ share
    spread = (left[..., None] - log_k[..., None, :]) ** 2
    fit = -0.5 * np.einsum("esnk,kn->esk", spread, precision)
    fit += 0.5 * (np.log(precision).sum(axis=-1) - np.log(precision.sum(axis=-1)))
    # Where nothing was felt, object and gripper shared the closure: however stiff the object, the
    # gripper's give bounds the force. Exact for exponent 1.
    alone = np.exp(log_k[..., None, :] + (exponent[:, None, None] * np.log(closed))[..., None])
    unfelt = alone / (1.0 + give_mm_per_n * alone / closed[..., None])
    unseen = log_ndtr(-np.log(np.maximum(unfelt, 1e-9) / floor_n) / _PLACE_LOG_SD)
    fit += unseen.sum(axis=-2) + np.log(common)[:, None, None] + np.log(likely)
    return np.asarray(np.moveaxis(fit, -1, 1))
