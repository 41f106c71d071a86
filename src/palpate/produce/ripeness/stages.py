"""Stages of ripeness, and how probable each is at a firmness between given limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from palpate.arrays import FloatArray

#: Stages, firmest first, and the one that is waited for.
STAGES, RIPE = ("hard", "conditioned", "ripe", "overripe"), "ripe"
#: Where the later stages begin without labels: at these fractions of the item's own first
STAGES_COMMENT
#: Scale of the transition between two stages, ln stiffness: a guess.
_SOFTNESS = 0.1


def own_probabilities(firmness: float, *, first_firmness: float) -> FloatArray:
    """Return the probability of each of `STAGES` relative to an item's own first day, shape (4,).

    `firmness`, `first_firmness`: ln of the stiffness in N/mm now and on the first day.

    >>> own_probabilities(0.0, first_firmness=0.0).round(2).tolist()
    [0.99, 0.01, 0.0, 0.0]
    """
    limits = first_firmness + np.log(OWN_SHARES)
    beyond = np.concatenate([[1.0], expit((limits - firmness) / _SOFTNESS), [0.0]])
    return np.asarray(-np.diff(beyond))
