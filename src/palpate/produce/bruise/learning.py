"""Learning to detect bruises: a judge for each set of references, and where the bruise is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError, needing
from palpate.produce.bruise.model import REFERENCES, BruiseModel, Example, Locator, Logistic, Place
from palpate.produce.bruise.shape import LoadShape, contrast, finger_contrast, slopes

#: Inverse strength of the ridge on standardised contrasts (there are up to 51), the fewest sides of
#: each kind to learn from, and the number of parts that are left out in turn.
_RIDGE, _FEWEST, _FOLDS = 0.1, 10, 5


def learn_bruises(examples: Sequence[Example], *, learned_on: str) -> BruiseModel:
    """Learn from known sides.

    `examples`: at least ten bruised and ten sound. Each set of references that as many have is
        learned.
    `learned_on`: what they are, in words.
    Raises `InputError` if there are too few; `MissingExtraError` if scikit-learn is not installed.
    """
    judges, locators = {}, {}
    felt = [
        {name: contrast(one.shape, reference) for name, reference in one.against.items()}
        for one in examples
    ]
    for size in range(1, len(REFERENCES) + 1):
        for names in combinations(REFERENCES, size):
            having = [index for index, one in enumerate(felt) if set(names) <= set(one)]
            truth = [examples[index].bruised for index in having]
            if _enough(truth):
                values = [np.concatenate([felt[i][name] for name in names]) for i in having]
                judges["+".join(names)] = _fit(np.array(values), truth)
    for name in REFERENCES:
        known = [
            (one.place, one.shape, one.against[name])
            for one in examples
            if one.place is not None and name in one.against
        ]
        if _enough([place.finger == 1 for place, _, _ in known]):
            locators[name] = _fit_locator(known)
    bruised = sum(one.bruised for one in examples)
    if not judges:
        raise InputError(
            f"{bruised} bruised and {len(examples) - bruised} sound sides are known; learning "
            f"takes {_FEWEST} of each that have a reference in common"
        )
    return BruiseModel(
        judges=judges,
        learned_on=learned_on,
        bruised=bruised,
        sound=len(examples) - bruised,
        locators=locators,
    )


def _enough(truth: Sequence[bool]) -> bool:
    return min(sum(truth), len(truth) - sum(truth)) >= _FEWEST


def _fit(values: FloatArray, truth: Sequence[bool], *, even: bool = True) -> Logistic:
    """Fit with equal weight to both answers; without `even`, answers swap signs: no intercept."""
    with needing("learning about bruises", extra="produce"):
        from sklearn.linear_model import LogisticRegression
        from sklearn.model_selection import StratifiedKFold, cross_val_predict
    centre = values.mean(axis=0) if even else np.zeros(values.shape[1])
    scale = np.sqrt(np.mean((values - centre) ** 2, axis=0))
    scale[scale == 0] = 1.0
    standard, answer = (values - centre) / scale, np.asarray(truth, dtype=int)
    options = {"max_iter": 5000, "class_weight": "balanced", "fit_intercept": even}
    judge = LogisticRegression(C=_RIDGE, **options)
    # The ridge shrinks the odds: they are scaled to fit sides left out.
    left_out = cross_val_predict(
        judge, standard, answer, cv=StratifiedKFold(_FOLDS), method="decision_function"
    )
    worth = LogisticRegression(C=np.inf, **options).fit(left_out[:, None], answer)
    stretch, shift = float(worth.coef_[0, 0]), float(worth.intercept_[0]) if even else 0.0
    judge.fit(standard, answer)
    return Logistic(
        centre=tuple(map(float, centre)),
        scale=tuple(map(float, scale)),
        weight=tuple(stretch * float(weight) for weight in judge.coef_[0]),
        intercept=stretch * float(judge.intercept_[0]) + shift if even else 0.0,
    )


def _fit_locator(known: Sequence[tuple[Place, LoadShape, LoadShape]]) -> Locator:
    """Fit to places, shapes, and their references."""
    values = np.array([finger_contrast(shape, reference) for _, shape, reference in known])
    # On the bruised finger load slopes away from the bruise.
    slope = np.array(
        [(1 - 2 * place.finger) * slopes(shape, reference) for place, shape, reference in known]
    )
    place_mm = np.array([(place.along_mm, place.across_mm) for place, _, _ in known])
    along, across = np.sum(slope * place_mm, axis=0) / np.sum(slope**2, axis=0)
    return Locator(
        finger=_fit(values, [place.finger == 1 for place, _, _ in known], even=False),
        mm_per_slope=(float(along), float(across)),
    )
