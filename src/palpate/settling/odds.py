"""Prior odds of the curves and deviations: learned, see `docs/prediction.md`."""

import numpy as np
CURVE_LOG_ODDS = np.zeros(71)
DEVIATION_LOG_ODDS = np.zeros(32)
LOG_ODDS = DEVIATION_LOG_ODDS[:, None] + CURVE_LOG_ODDS
