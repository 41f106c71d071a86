"""Prior log odds of deviations and curves, in the order of `shapes`; see `docs/prediction.md`.

Learned, not written: `python -m palpate_studies.settling_odds` regenerates this file.
"""

from __future__ import annotations

import numpy as np

_DEVIATIONS = np.array(
    [
        -0.81, -0.04, -0.47, 0.26, 0.21, 1.05, -0.61, 1.01, 0.26, -0.29, 0.28, -0.05,
        0.10, -0.69, -0.42, 0.23, 0.54, 0.45,
    ]
)
_CURVES = np.array(
    [
        -0.02, 1.74, 3.33, 2.45, 1.11, -0.10, -1.09, -0.58, -0.64, -0.35, 0.27, 0.95,
        -0.73, -0.46, -1.19, -1.05, -0.41, -0.08, -0.53, 1.01, 1.49, -0.23, -0.42, -0.76,
        -0.58, -0.69, -0.71, -0.48, -0.90, 0.12, -0.95, -0.55, 0.95, 0.88, 0.23, -1.08,
        -0.99, 0.20, -0.13, -0.53, -0.01, 0.65, 2.34, 0.31, -1.22, -0.35, 3.65, -0.99,
        0.00, -0.24, 0.65, -0.52, 0.28, -0.91, -0.62, -0.15, -0.45, -0.96, -1.09,
    ]
)
#: Of a component: a deviation around a curve, shape (n_deviations, n_curves).
LOG_ODDS = _DEVIATIONS[:, None] + _CURVES
LOG_ODDS.setflags(write=False)
