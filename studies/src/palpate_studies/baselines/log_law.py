"""a + b ln(t + t0) through the first seconds of a hold; t0 and the start are chosen beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from palpate_studies.protocol.method import Answer, Case, Question, log_error

#: Shifts and starts tried on the holds that are not tested, s.
_SHIFTS_S, _STARTS_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6), (0.0, 0.1, 0.3, 0.5)


class TunedLogLaw:
    """The log law with the shift and start that were best on other specimens."""

    name = "log law, tuned on other specimens"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Choose shift and start; nothing else is learned."""
        known = [*training, *choosing]

        def loss(setting: tuple[float, float]) -> float:
            return float(
                np.median([log_error(_answer(c.question, *setting), c.truth) for c in known])
            )

        shift_s, start_s = min(product(_SHIFTS_S, _STARTS_S), key=loss)
        return lambda asked: _answer(asked, shift_s, start_s)


def _answer(asked: Question, shift_s: float, start_s: float) -> float:
    time_s, value = asked.curve.T
    used = time_s >= start_s
    if used.sum() < 2:
        return asked.scale
    slope, offset = np.polyfit(np.log(np.maximum(time_s[used], 0.0) + shift_s), value[used], 1)
    predicted = float(offset + slope * np.log(asked.asked + shift_s))
    return predicted if predicted > 0 else asked.scale
