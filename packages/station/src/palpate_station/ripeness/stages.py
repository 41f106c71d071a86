"""Stages of ripeness and their probabilities at a given firmness."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from palpate.arrays import FloatArray

#: Stages, firmest first, and the target stage.
STAGES, RIPE = ("hard", "conditioned", "ripe", "overripe"), "ripe"
#: Limits of the later stages as fractions of the stiffness on the item's first day. They apply
#: without labels, to fingers driven by width, and assume that the item was hard on that day.
#: Penetrometers measure about 200 N on hard avocados, 80 N on conditioned, 19 N on nearly ripe and
#: 5 N on overripe ones. The force between fingers is proportional to about the 0.7th power of the
#: penetrometer force, and the stiffness at a fixed force to the 2/3rd power of the force between
#: fingers (Hertz).
FIRST_DAY_FRACTIONS = (0.65, 0.33, 0.18)
#: Width of the transition between two stages, in ln stiffness (assumed).
_TRANSITION_WIDTH = 0.1


def first_day_probabilities(firmness: float, *, first_firmness: float) -> FloatArray:
    """Return the probability of each of `STAGES` relative to the first day, shape (4,).

    `firmness`, `first_firmness`: ln of the stiffness in N/mm now and on the first day.

    >>> first_day_probabilities(0.0, first_firmness=0.0).round(2).tolist()
    [0.99, 0.01, 0.0, 0.0]
    """
    limits = first_firmness + np.log(FIRST_DAY_FRACTIONS)
    at_least = np.concatenate([[1.0], expit((limits - firmness) / _TRANSITION_WIDTH), [0.0]])
    return np.asarray(-np.diff(at_least))
