"""No sensor at all: a constant, learned from the training part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_studies.protocol.method import Answer, Case


class Constant:
    """The best constant multiple of what was read last, or the best constant, per kind."""

    def __init__(self, *, of_scale: bool) -> None:
        self._of_scale = of_scale
        self.name = "best multiple of the last reading" if of_scale else "best constant, no sensor"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Learn the median logarithm of each kind; a kind never seen gets that of all."""
        known = [*training, *choosing]
        logs = {case.question.kind: list[float]() for case in known} | {"": list[float]()}
        for case in known:
            value = case.truth / (case.question.scale if self._of_scale else 1.0)
            logs[case.question.kind].append(np.log(value))
            logs[""].append(np.log(value))
        medians = {kind: float(np.exp(np.median(found))) for kind, found in logs.items()}
        return lambda asked: (
            medians.get(asked.kind, medians[""]) * (asked.scale if self._of_scale else 1.0)
        )
