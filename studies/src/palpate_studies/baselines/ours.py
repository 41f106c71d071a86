"""Ours in the three challenges, through the same interface as everybody's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimate.closing import ClosingCurve
from palpate.estimate.damage_learning import learn
from palpate.estimate.fruit_closings import FruitClosing, follow
from palpate.estimate.population_law import PopulationForceLaw
from palpate.settling.predict import predict_settled
from palpate_studies.protocol.method import Answer, Case, Question


class OurSettling:
    """`palpate.predict_settled` as it comes: nothing is learned from these holds."""

    name = "ours (relaxation)"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Return the default method."""

        def answer(asked: Question) -> float:
            time_s, value = asked.curve.T
            found = predict_settled(
                time_s, value, cutoff_s=float(time_s[-1]), horizon_s=asked.asked
            )
            return max(float(found.value), 1e-6)

        return answer


class OurForceLaw:
    """A law drawn from the population of the other sensors, told the loads of the curve."""

    name = "ours (population law)"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit the population."""
        sensors = {case.specimen: case.whole for case in (*training, *choosing)}.values()
        population = PopulationForceLaw.fit(
            [whole[:, 0] for whole in sensors], forces_n=[whole[:, 1] for whole in sensors]
        )

        def answer(asked: Question) -> float:
            law = population.calibrate(asked.curve[:, 0], force_n=asked.curve[:, 1])
            return float(law.force_n(np.array([asked.asked])).value[0])

        return answer


class OurDamageLimit:
    """The damage model's prediction, from the last state of the curve."""

    name = "ours (damage model)"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit the model to whole curves with their rupture forces."""
        model = learn([_closing(case) for case in (*training, *choosing)])

        def answer(asked: Question) -> float:
            curve, said_n = ClosingCurve(), asked.scale
            for closure_mm, force_n in asked.curve.tolist():
                for state in curve.push(closure_mm, force_n=force_n):
                    limit = model.limit(state, kind=asked.kind, stop_score=np.inf)
                    said_n = limit.predicted_n
            return float(said_n)

        return answer


def _closing(case: Case) -> FruitClosing:
    closure_mm, force_n = case.whole.T
    return follow(
        case.name,
        fruit=case.question.kind,
        rupture_force_n=case.truth,
        closure_mm=closure_mm,
        force_n=force_n,
    )
