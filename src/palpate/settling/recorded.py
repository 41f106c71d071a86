"""The value at the cut-off: what waiting alone gives, and every method's last resort."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.arrays import FloatArray
from palpate.settling.result import SettledEstimate, Status


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """The last sample as it is (paper, Table 1: "recorded resistance").

    It has no interval: one sample shows nothing of the change still to come.

    Examples
    --------
    >>> hold = Recorded().predict(
    ...     np.array([0.0, 1.0]), np.array([[5.0, 3.0]]), horizon_s=20.0, level=0.9
    ... )
    >>> float(hold.value[0]), hold.status[0].value
    (3.0, 'ok')
    """

    name: ClassVar[str] = "recorded"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return the last sample of each hold; see `SettlingMethod.predict`."""
        return SettledEstimate.without_interval(
            values[:, -1].copy(),
            horizon_s=horizon_s,
            level=level,
            method=self.name,
            window_s=np.zeros(len(values)),
            status=np.array([Status.OK] * len(values), dtype=object),
        )
