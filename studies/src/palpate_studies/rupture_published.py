"""The linear stiffness rule with the constants that were published for these fruits."""

from __future__ import annotations

import numpy as np

from palpate.estimate.damage_learning import FruitClosing
from palpate_studies.rupture_policies import Scored

#: Fruit -> mm by which the stiffness is multiplied, N that are added, and N that are given while
#: there are too few samples: the parameters of its authors' evaluation (github.com/SheepLiu712/
#: FruitRuptureEstimate).
PUBLISHED: dict[str, tuple[float, float, float]] = {
    "banana": (3.33, 0.254, 7.008),
    "kiwi": (2.78, 0.345, 3.652),
    "mango": (2.408, 1.666, 11.033),
}
#: Samples in the window that the stiffness is read from, by least squares: fewest and most.
_FEWEST, _MOST = 10, 60


def published_scores(closing: FruitClosing) -> Scored:
    """Return force as a share of what the published rule predicts, sample by sample.

    Raises
    ------
    KeyError
        For a fruit that it has no constants for.
    """
    slope_mm, offset_n, first_n = PUBLISHED[closing.fruit]
    closure_mm, force_n = closing.samples.T
    predicted_n = np.full(len(force_n), first_n)
    for count in range(_FEWEST, len(force_n) + 1):
        window = slice(max(0, count - _MOST), count)
        x = closure_mm[window] - closure_mm[window].mean()
        if power := float(x @ x):
            predicted_n[count - 1] = slope_mm * float(x @ force_n[window]) / power + offset_n
    return Scored(force_n, force_n / np.maximum(predicted_n, 0.1))
