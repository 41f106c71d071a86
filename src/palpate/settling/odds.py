"""Prior log odds of deviations and curves, as ordered in `shapes`.

Learned, not written: `palpate study settling-families --odds` regenerates this file.
"""

from __future__ import annotations

import numpy as np

_DEVIATIONS = """
-0.23 0.17 1.33 1.73 -0.13 -0.45 -1.71
"""
_CURVES = """
0.32 1.11 1.38 1.11 0.95 -0.32 -0.20 1.70 0.29 0.64 -0.33 -0.60 -1.17 -1.17
-0.31 0.46 0.98 -0.57 -0.39 -0.50 -0.60 -0.66 -0.27 0.88 0.82 -0.65 -0.62 -0.48
0.53 0.04 -0.87 0.48 1.14 -1.16 -0.26 -0.67 -0.36 -0.66 -0.29 -0.58 -0.21 -0.59
-0.47 0.26 -0.46 1.94 2.53 0.61 2.78 5.11 -1.87 0.41 -1.40 -0.86 -0.74 -0.86
0.43 -0.61 -0.82 -1.23 -1.66 -1.45 -1.78
"""
#: Of a component: a deviation around a curve, shape (n_deviations, n_curves).
LOG_ODDS = np.add.outer(*(np.array(t.split(), dtype=float) for t in (_DEVIATIONS, _CURVES)))
LOG_ODDS.setflags(write=False)
