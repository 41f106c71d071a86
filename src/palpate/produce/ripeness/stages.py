"""Stages of ripeness, and how probable each is at a firmness between given limits."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from palpate.arrays import FloatArray

#: Stages, firmest first, and the one that is waited for.
STAGES, RIPE = ("hard", "conditioned", "ripe", "overripe"), "ripe"
#: Without labels, fingers driven by width judge an item by its own first day, taken as hard: the
#: later stages begin at these fractions of its first stiffness. Penetrometers find some 200 N in
#: hard avocados, 80 N in conditioned, 19 N in nearly ripe and 5 N in overripe ones; force between
#: fingers goes with about the 0.7th power of that, stiffness at one force with the 2/3rd power of
#: that force (Hertz).
OWN_SHARES = (0.65, 0.33, 0.18)
#: Scale of the transition between two stages, ln stiffness: a guess.
_SOFTNESS = 0.1


def own_probabilities(firmness: float, *, first_firmness: float) -> FloatArray:
    """Return the probability of each of `STAGES` from an item's own first day, shape (4,).

    `firmness`, `first_firmness`: ln of the stiffness in N/mm now and on the first day.

    >>> own_probabilities(0.0, first_firmness=0.0).round(2).tolist()
    [0.99, 0.01, 0.0, 0.0]
    """
    limits = first_firmness + np.log(OWN_SHARES)
    beyond = np.concatenate([[1.0], expit((limits - firmness) / _SOFTNESS), [0.0]])
    return np.asarray(-np.diff(beyond))
