"""Pull strength of a grip, for harvesting: the stem must tear before the object slips."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from palpate.measurement import Measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class PullVerdict:
    """Verdict on whether friction withstands a pull along the pads.

    Attributes
    ----------
    pull_n, friction : float
        Inputs: the pull, including the weight, and the friction coefficient of pads and object.
    holds_low_n, holds_high_n : float or None
        Interval of the largest pull that both fingers hold; None if the grip force is unknown.
    verdict : str
        ``secure to pull``, ``would slip`` or ``not sure``.
    """

    pull_n: float
    friction: float
    holds_low_n: float | None
    holds_high_n: float | None
    verdict: Literal["secure to pull", "would slip", "not sure"]

    def to_dict(self) -> dict[str, object]:
        """Return the JSON form."""
        return {name: getattr(self, name) for name in self.__slots__}


def judge_pull(force: Measurement | None, *, pull_n: float, friction: float) -> PullVerdict:
    """Compare a pull with the friction force of the measured grip.

    Both fingers hold the object: it slips at twice the friction coefficient times the grip force.
    The verdict uses both bounds of the force interval.

    Parameters
    ----------
    force : Measurement or None
        Settled grip force of each finger; None if unknown.
    pull_n : float
        Pull along the pads, including the weight, newtons.
    friction : float
        Friction coefficient; a low value is conservative.

    Raises
    ------
    ValueError
        If the pull or the friction is not positive.

    Examples
    --------
    >>> force = Measurement(value=4.0, low=3.0, high=5.0, unit="n")
    >>> [judge_pull(force, pull_n=pull_n, friction=0.5).verdict for pull_n in (2.0, 4.0, 8.0)]
    ['secure to pull', 'not sure', 'would slip']
    """
    for name, value in (("pull", pull_n), ("friction", friction)):
        if not 0 < value < math.inf:
            raise ValueError(f"the {name} must be positive, not {value:g}")
    if force is None:
        return PullVerdict(
            pull_n=pull_n,
            friction=friction,
            holds_low_n=None,
            holds_high_n=None,
            verdict="not sure",
        )
    held = force.scaled(2.0 * friction, unit="n")
    low_n, high_n = held.low, held.high
    verdict: Literal["secure to pull", "would slip", "not sure"] = "not sure"
    if pull_n <= low_n:
        verdict = "secure to pull"
    elif pull_n > high_n:
        verdict = "would slip"
    return PullVerdict(
        pull_n=pull_n,
        friction=friction,
        holds_low_n=low_n,
        holds_high_n=high_n,
        verdict=verdict,
    )
