"""A line from the stiffness during closing to the rupture force, for each fruit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_studies.protocol.method import Answer, Case, Question


class StiffnessLine:
    """ln rupture force = a + b ln stiffness, a line for each kind."""

    name = "line in the stiffness, per kind"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit a line to all fruit that is not tested."""
        cases = [*training, *choosing]
        lines = {}
        for kind in {case.question.kind for case in cases}:
            mine = [case for case in cases if case.question.kind == kind]
            x = [_log_stiffness(case.question) for case in mine]
            lines[kind] = np.polyfit(x, [np.log(case.truth) for case in mine], 1)
        return lambda asked: float(np.exp(np.polyval(lines[asked.kind], _log_stiffness(asked))))


def _log_stiffness(asked: Question) -> float:
    """Return ln of the least-squares slope over the upper half of the force."""
    upper = asked.curve[asked.curve[:, 1] >= 0.3 * asked.scale]
    x = upper[:, 0] - upper[:, 0].mean()
    slope = float(x @ upper[:, 1] / max(x @ x, 1e-9))
    return float(np.log(max(slope, 0.05)))
