"""Ours in the three challenges, through the same interface as everybody's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimate.damage_learning import FruitClosing, follow_closing, learn_damage
from palpate.estimate.strength import ClosingCurve
from palpate.settling.predict import predict_settled
from palpate_studies.force_model import ForceModel
from palpate_studies.ladder_models import LANDMARKS
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
    """The force model of the other sensors, adapted to the loads of the curve."""

    name = "ours (force model)"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit the model to the sensors that are not tested."""
        sensors = {case.specimen: case.whole for case in (*training, *choosing)}
        whole = np.concatenate(list(sensors.values()))
        model = ForceModel.fit(
            np.log(whole[:, :1]),
            target=np.log(whole[:, 1]),
            group=[name for name, each in sensors.items() for _ in each],
            landmarks=LANDMARKS,
        )

        def answer(asked: Question) -> float:
            own = model.adapted(np.log(asked.curve[:, :1]), target=np.log(asked.curve[:, 1]))
            value, _ = own.predict(np.log([[asked.asked]]), level=0.9)
            return float(np.exp(np.asarray(value)[0]))

        return answer


class OurDamageLimit:
    """The damage model's prediction, from the last state of the curve."""

    name = "ours (damage model)"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit the model to whole curves with their rupture forces."""
        model = learn_damage([_closing(case) for case in (*training, *choosing)])

        def answer(asked: Question) -> float:
            curve, predicted_n = ClosingCurve(), asked.scale
            for closure_mm, force_n in asked.curve.tolist():
                for state in curve.push(closure_mm, force_n=force_n):
                    limit = model.limit(state, kind=asked.kind, stop_score=np.inf)
                    predicted_n = limit.predicted_n
            return float(predicted_n)

        return answer


def _closing(case: Case) -> FruitClosing:
    closure_mm, force_n = case.whole.T
    return follow_closing(
        case.name,
        fruit=case.question.kind,
        rupture_force_n=case.truth,
        closure_mm=closure_mm,
        force_n=force_n,
    )
