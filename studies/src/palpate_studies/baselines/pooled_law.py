"""One power law through the loads of all other sensors: no weight on the sensor itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_studies.protocol.method import Answer, Case


class PooledLaw:
    """ln load = a + b ln excess conductance, pooled; or its exponent alone, with the gain given."""

    def __init__(self, *, own_gain: bool) -> None:
        self._own_gain = own_gain
        self.name = "pooled power law, gain told" if own_gain else "pooled power law, no weight"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Pool every load of the other sensors."""
        sensors = {case.specimen: case.whole for case in (*training, *choosing)}
        x, y = np.log(np.concatenate(list(sensors.values()))).T
        slope, offset = np.polyfit(x, y, 1)
        if not self._own_gain:
            return lambda asked: float(np.exp(offset + slope * np.log(asked.asked)))
        return lambda asked: float(
            np.exp(
                np.mean(np.log(asked.curve[:, 1]) - slope * np.log(asked.curve[:, 0]))
                + slope * np.log(asked.asked)
            )
        )
