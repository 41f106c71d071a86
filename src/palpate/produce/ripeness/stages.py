"""Where one stage of ripeness ends and the next begins, learned from items that a person labelled.

Stages are in order, firmest first. A boundary is a firmness at which both neighbours are equally
likely; all boundaries share one softness of the transition, which is how well people and grasps
agree (an ordered logistic model with a weak prior).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.special import expit

from palpate.arrays import FloatArray
from palpate.errors import InputError

#: The default stages, firmest first, and which of them one waits for.
STAGES, RIPE = ("hard", "conditioned", "ripe", "overripe"), "ripe"
#: Without labels, fingers driven by width judge an item by its own first day, taken as hard: shares
#: of its first stiffness. Penetrometers find some 200 N in hard avocados, 80 N in conditioned, 19 N
#: in nearly ripe and 5 N in overripe ones; force between fingers goes with about the 0.7th power
#: of that, stiffness at one force with the 2/3rd power of that force (Hertz).
OWN_SHARES = (0.65, 0.33, 0.18)
#: Prior of the transition's softness: a twentieth of the range of firmness, within a factor of e.
_SOFTNESS_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Boundaries:
    """Stages and the firmness at their boundaries.

    >>> rule = Boundaries(stages=("hard", "ripe"), firmness=(1.0,), softness=0.1)
    >>> rule.probabilities([1.0, 0.0]).round(2).tolist()
    [[0.5, 0.5], [0.0, 1.0]]
    """

    #: In order, firmest first.
    stages: tuple[str, ...]
    #: Falling: below the first of them the second stage begins.
    firmness: tuple[float, ...]
    #: Scale of the logistic transition.
    softness: float

    @classmethod
    def learn(
        cls, firmness: ArrayLike, labels: Sequence[str], *, stages: Sequence[str] = STAGES
    ) -> Boundaries:
        """Learn from labelled days.

        `firmness`, shape (n,): of the item on the day of the label.
        `labels`: stage that a person gave.
        `stages`: all stages in order, firmest first.
        Raises `InputError` if a label is no stage, or a stage has no label.
        """
        felt = np.asarray(firmness, dtype=float)
        unknown = sorted(set(labels) - set(stages))
        if unknown:
            raise InputError(
                f"label {unknown[0]!r} is no stage of ripeness; there are: {', '.join(stages)}"
            )
        missing = [stage for stage in stages if stage not in labels]
        if missing:
            raise InputError(
                f"no item was ever labelled {missing[0]!r}; label at least one item of each stage "
                f"({', '.join(stages)})"
            )
        rank = np.array([stages.index(label) for label in labels])
        fall = max(float(np.ptp(felt)), 1e-6)
        middle = [float(np.median(felt[rank == k])) for k in range(len(stages))]
        start = [0.5 * (a + b) for a, b in pairwise(middle)]
        usual = _SOFTNESS_SHARE * fall

        def loss(x: FloatArray) -> float:
            rule = cls._of(x, start, fall=fall, usual=usual, stages=tuple(stages))
            seen = rule.probabilities(felt)[np.arange(rank.size), rank]
            return float(-np.log(np.maximum(seen, 1e-12)).sum() + 0.5 * x @ x)

        best = minimize(loss, np.zeros(len(stages)), method="Nelder-Mead")
        return cls._of(best.x, start, fall=fall, usual=usual, stages=tuple(stages))

    @classmethod
    def _of(
        cls,
        x: FloatArray,
        start: Sequence[float],
        *,
        fall: float,
        usual: float,
        stages: tuple[str, ...],
    ) -> Boundaries:
        moved = np.sort(np.asarray(start) + 0.25 * fall * x[:-1])[::-1]
        return cls(
            stages=stages,
            firmness=tuple(moved.tolist()),
            softness=usual * float(np.exp(x[-1])),
        )

    @classmethod
    def own(cls, first_firmness: float) -> Boundaries:
        """Return boundaries relative to the item's own first day (width-driven fingers only)."""
        return cls(
            stages=STAGES,
            firmness=tuple(first_firmness + math.log(share) for share in OWN_SHARES),
            softness=0.1,
        )

    def probabilities(self, firmness: ArrayLike) -> FloatArray:
        """Return the probability of each stage at each firmness, shape (..., stages)."""
        felt = np.asarray(firmness, dtype=float)[..., None]
        beyond = expit((np.array(self.firmness) - felt) / self.softness)
        ones, zeros = np.ones(felt.shape), np.zeros(felt.shape)
        steps = np.concatenate([ones, beyond, zeros], axis=-1)
        return np.asarray(steps[..., :-1] - steps[..., 1:])

    def begins(self, stage: str) -> float:
        """Return the firmness below which a stage begins.

        Raises `InputError` if it is the first stage or none of them.
        """
        if stage not in self.stages[1:]:
            raise InputError(
                f"{stage!r} does not begin at any boundary; one can wait for: "
                f"{', '.join(self.stages[1:])}"
            )
        return self.firmness[self.stages.index(stage) - 1]
