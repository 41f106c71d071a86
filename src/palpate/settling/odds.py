"""Prior log odds of deviations and curves, as ordered in `shapes`.

Learned, not written: `palpate_studies.settling_odds` regenerates this file.
"""

from __future__ import annotations

import numpy as np

_DEVIATIONS = np.array(
    [
        -1.08,
        0.03,
        -0.87,
        1.11,
        0.68,
        1.13,
        -0.60,
        0.57,
        0.75,
        1.09,
        -0.28,
        -0.18,
        -0.82,
        -1.59,
        -0.62,
        -0.01,
        0.43,
        1.13,
    ]
)
_CURVES = np.array(
    [
        0.01,
        0.96,
        2.45,
        2.08,
        1.21,
        0.10,
        -0.73,
        -0.63,
        -0.75,
        -0.30,
        0.96,
        0.90,
        -0.45,
        -0.31,
        -1.18,
        -1.26,
        -0.68,
        -0.63,
        -0.20,
        0.93,
        1.62,
        -0.06,
        -0.17,
        -0.54,
        -0.68,
        -0.69,
        -0.66,
        -0.58,
        -0.69,
        -0.03,
        -0.81,
        -0.54,
        0.71,
        0.67,
        -0.12,
        -0.98,
        -1.10,
        0.18,
        -0.03,
        -0.71,
        0.10,
        0.84,
        1.98,
        0.33,
        -0.90,
        0.44,
        5.33,
        -1.10,
        -0.14,
        -0.34,
        0.23,
        -0.56,
        0.42,
        -0.81,
        -1.17,
        -0.64,
        -0.77,
        -1.23,
        -1.21,
    ]
)
#: Of a component: a deviation around a curve, shape (n_deviations, n_curves).
LOG_ODDS = _DEVIATIONS[:, None] + _CURVES
LOG_ODDS.setflags(write=False)
