"""The sensor's own settled holds, shrunk to the general prior.

Every past hold, cut to the window of the hold to predict, is evidence for the components that
predict the value it settled to. The odds become a mixture of the general ones and the mean of
those; the error that remains is modelled as a share of the change ahead, shrunk towards zero. Both
weigh more with more holds, so a few holds, or holds unlike each other, change little. It is for the
same sensor, read the same way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.holds import Hold
from palpate.settling.mixture import Mixture
from palpate.settling.percent import without_percent
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate
from palpate.settling.scoring import settled_value

#: The general odds count as this many of the sensor's own holds, and for a tenth at least.
GENERAL_HOLDS, MOST = 4.0, 0.9
#: Holds needed to see a common error; a slope below this many times its variance is none.
FEWEST = 4
#: Cut-offs that are remembered.
REMEMBERED = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnRelaxation:
    """`Relaxation` with odds learned from settled holds of the same sensor.

    Attributes
    ----------
    holds : tuple of Hold
        Past holds; those that reach the horizon teach, none of them is to be predicted.
    general : Relaxation
        What is known without them; its interval calibration is kept.

    Raises
    ------
    CalibrationError
        If there is no hold.

    Examples
    --------
    Holds that all lose 5 % between 2 s and 20 s:

    >>> time_s = np.arange(1, 301) / 15
    >>> shape = 1 + 0.1 * np.exp(-time_s / 3)
    >>> holds = tuple(Hold(hold_id=str(k), channel=None, time_s=time_s, values=k * shape)
    ...     for k in range(20, 30))
    >>> method = OwnRelaxation(holds=holds)
    >>> found = method.predict(time_s[:30], 24.5 * shape[None, :30], horizon_s=20.0, level=0.9)
    >>> round(float(found.value[0]), 1)
    24.5
    """

    holds: tuple[Hold, ...]
    general: Relaxation = field(default_factory=Relaxation)
    _learned: dict[tuple[float, float], Relaxation] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not self.holds:
            raise CalibrationError(
                "no hold to learn from; `palpate calibrate settling` cuts them from recordings"
            )

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.general.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`."""
        method = self._at(float(time_s[-1]), horizon_s=horizon_s)
        return method.predict(time_s, values, horizon_s=horizon_s, level=level)

    def calibrated_on(self, holds: Iterable[Hold], *, horizon_s: float = 20.0) -> OwnRelaxation:
        """Return the method with intervals as wide as the general one's residuals call for."""
        scale = self.general.calibrated_on(holds, horizon_s=horizon_s).scale
        return OwnRelaxation(holds=self.holds, general=replace(self.general, scale=scale))

    def _at(self, cutoff_s: float, *, horizon_s: float) -> Relaxation:
        """Return the method for holds seen up to a cut-off; recalled, since learning takes time."""
        key = (cutoff_s, horizon_s)
        if key not in self._learned:
            if len(self._learned) >= REMEMBERED:
                self._learned.clear()
            self._learned[key] = self._learn(cutoff_s, horizon_s=horizon_s)
        return self._learned[key]

    def _learn(self, cutoff_s: float, *, horizon_s: float) -> Relaxation:
        known = [
            past
            for hold in map(without_percent, self.holds)
            if (past := _past(self.general, hold, cutoff_s=cutoff_s, horizon_s=horizon_s))
        ]
        if not known:
            return self.general
        general = self.general.log_odds
        shares = [
            given_truth(found, truth=truth, components=general.size) for found, _, truth in known
        ]
        log_odds = own_log_odds(general, shares)
        gain = (log_odds - general).ravel()
        missing, seen = [], []
        for found, change, truth in known:
            weight = found.weight * np.exp(gain[found.component] - gain.max())
            missing.append(truth - weight @ found.forecast / weight.sum())
            seen.append(change)
        further = shrunk_slope(np.array(missing), np.array(seen))
        return replace(self.general, log_odds=log_odds, further=further)


def _past(
    general: Relaxation, hold: Hold, *, cutoff_s: float, horizon_s: float
) -> tuple[Mixture, float, float] | None:
    """Return forecasts of a past hold from its samples up to the cut-off, its change, its truth."""
    settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
    seen = hold.time_s <= cutoff_s
    if np.isnan(settled) or not seen.any():
        return None
    values = hold.values[seen]
    positive = bool((values > 0).all())
    known = general.components(hold.time_s[seen], values, horizon_s=horizon_s)
    if known is None or (positive and settled <= 0):
        return None
    found, binned = known
    truth = (np.log(settled) if positive else settled) - binned[-1]
    return found, float(binned[-1] - binned[0]), float(truth)


def shrunk_slope(missing: FloatArray, seen: FloatArray) -> float:
    """Return the slope of what is missing over the change seen, drawn towards nothing.

    Empirical Bayes (James and Stein): the share of the squared slope that its own error explains is
    taken off, so a slope within its error is none.

    >>> shrunk_slope(np.array([1.0, -1.0, 0.5]), np.array([2.0, 2.0, 2.0]))
    0.0
    """
    power = float(seen @ seen)
    slope = float(seen @ missing) / power if power > 0 else 0.0
    if slope == 0.0 or seen.size < FEWEST:
        return 0.0
    left = missing - slope * seen
    variance = float(left @ left) / (seen.size - 1) / power
    return slope * max(0.0, 1.0 - FEWEST * variance / slope**2)


def given_truth(found: Mixture, *, truth: float, components: int) -> FloatArray:
    """Return the posterior of all components of one hold given the change that was ahead."""
    off = (truth - found.forecast) / found.deviation
    # Heavy tails: where no component forecast the truth, the least wrong must not take all weight.
    likely = found.weight / found.deviation * (1 + off**2 / 4) ** -2.5
    share = np.bincount(found.component, weights=likely, minlength=components)
    return np.asarray(share / share.sum(), np.float64)


def own_log_odds(general: FloatArray, shares: list[FloatArray]) -> FloatArray:
    """Return log odds between the general ones and the mean of those that past holds bear out."""
    trust = MOST * len(shares) / (len(shares) + GENERAL_HOLDS)
    odds = np.exp(general - general.max()).ravel()
    mixed = (1 - trust) * odds / odds.sum() + trust * np.mean(shares, axis=0)
    return np.asarray(np.log(mixed).reshape(general.shape))
