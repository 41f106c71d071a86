"""One grasp as a point with a doubt: logarithms of what was measured, and their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement

#: What distinguishes kinds for fingers driven by width, and for those driven by pressure, which
#: know neither mm nor N/mm: the pressure at contact, and the force gained per kPa from there on.
WIDTH_FEATURES = ("size_mm", "stiffness_n_per_mm")
PRESSURE_FEATURES = ("contact_kpa", "gain_n_per_kpa")


@dataclass(frozen=True, slots=True, kw_only=True)
class FeaturePoint:
    """One grasp in feature space."""

    #: Shape (n_features,). Natural logarithm of each quantity: a doubling counts alike wherever it
    #: happens.
    value: FloatArray
    #: Shape (n_features,). Standard deviation of a normal error in the logarithm with an interval
    #: as wide.
    sd: FloatArray
    #: Which calibration it was read by: grasps that share one share its error.
    calibration: str


def touch_of(
    measured: Mapping[str, Measurement], *, features: Sequence[str], calibration: str
) -> FeaturePoint | None:
    """Return a grasp as a point; None if a feature was not measured.

    >>> size = Measurement(value=40.0, low=39.0, high=41.0, unit="mm")
    >>> touch = touch_of({"size_mm": size}, features=["size_mm"], calibration="monday")
    >>> touch.value.round(2).tolist(), touch.sd.round(3).tolist()
    ([3.69], [0.015])
    """
    found = [measured.get(name) for name in features]
    given = [one for one in found if one is not None and 0 < one.low <= one.middle <= one.high]
    if len(given) < len(features):
        return None
    return FeaturePoint(
        value=np.log([one.middle for one in given]),
        sd=np.array([_log_sd(one) for one in given]),
        calibration=calibration,
    )


def put_together(measured: Sequence[Measurement], *, own_share: float) -> Measurement:
    """Average one quantity over grasps; only the errors of their own shrink.

    `measured`: the same quantity of one item, grasp by grasp.
    `own_share`: share of the variance that differs from grasp to grasp; above 1 where sides differ
        more than measurements err.

    >>> sizes = [Measurement(value=v, low=v - 1, high=v + 1, unit="mm") for v in (39.0, 41.0)]
    >>> both = put_together(sizes, own_share=0.5)
    >>> both.value, round(both.high - both.value, 3)
    (40.0, 0.866)
    """
    count = len(measured)
    left = math.sqrt(own_share / count + max(1.0 - own_share, 0.0))
    value = float(np.mean([one.middle for one in measured]))
    down = float(np.sqrt(np.mean([(one.middle - one.low) ** 2 for one in measured])))
    up = float(np.sqrt(np.mean([(one.high - one.middle) ** 2 for one in measured])))
    return replace(measured[0], value=value, low=value - left * down, high=value + left * up)


def _log_sd(one: Measurement) -> float:
    return float(np.log(one.high / one.low)) / (2.0 * NormalDist().inv_cdf(0.5 + one.level / 2))
