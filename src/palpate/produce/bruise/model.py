"""The probability of a bruise, learned from sides known to be sound or bruised (`learn_bruises`).

A logistic regression on `bruise.shape.contrast`, one for each available set of references: the
class (sound items of the kind, on the same sensor), the item's other sides, and its own earlier
record. Its probabilities are for as many bruised as sound sides, and are moved to the share of
bruised ones that the user expects.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError, needing
from palpate.files import atomic_path, structure
from palpate.produce.bruise.shape import LoadShape, contrast, finger_contrast, slopes

#: What a side may be compared with, the most informative first.
REFERENCES = ("history", "class", "item")
FORMAT, VERSION = "palpate-bruise-model", 1
#: Inverse strength of the ridge on standardised contrasts (there are up to 51), the fewest sides of
#: each kind to learn from, and the number of parts that are left out in turn.
_RIDGE, _FEWEST, _FOLDS = 0.1, 10, 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where the middle of a bruise lies."""

    #: Which finger touches it, 0 or 1.
    finger: int
    #: On the surface, from the middle of the side that this finger faces.
    along_mm: float
    across_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """One side whose truth is known."""

    #: How it loaded the pixels.
    shape: LoadShape
    #: References by name in `REFERENCES`: those that there are.
    against: Mapping[str, LoadShape]
    #: The truth.
    bruised: bool
    #: Where the bruise was, if known.
    place: Place | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Logistic:
    """A logistic regression on standardised numbers."""

    centre: tuple[float, ...]
    scale: tuple[float, ...]
    weight: tuple[float, ...]
    intercept: float

    def log_odds(self, values: FloatArray) -> FloatArray:
        """Return the log odds of sets of numbers, shape (..., numbers) to (...)."""
        standard = (values - np.array(self.centre)) / np.array(self.scale)
        return np.asarray(standard @ np.array(self.weight) + self.intercept)


@dataclass(frozen=True, slots=True, kw_only=True)
class Locator:
    """Which finger touches a bruise, and where on it, against one reference."""

    finger: Logistic
    mm_per_slope: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseModel:
    """The learned model."""

    #: From what, in words; simulated where it was.
    learned_on: str
    #: How many sides it was learned from.
    bruised: int
    sound: int
    #: For each set of references, its names joined by ``+`` in the order of `REFERENCES`.
    judges: Mapping[str, Logistic]
    #: By the name of one reference; empty where no places were known.
    locators: Mapping[str, Locator] = field(default_factory=dict)

    def log_odds(self, shape: LoadShape, against: Mapping[str, LoadShape]) -> float:
        """Return the log odds that a side is bruised, as many being bruised as sound.

        Raises `InputError` if there is no reference, or the model knows no such set of them.
        """
        names = usable_references(against)
        judge = self.judges.get("+".join(names))
        if judge is None:
            raise InputError(
                f"no reference among {', '.join(REFERENCES)} that this model knows "
                f"({', '.join(self.judges)}); grasp another side, or sound items of the class"
            )
        values = [contrast(shape, against[name]) for name in names]
        return float(judge.log_odds(np.concatenate(values)))

    def save(self, path: Path) -> None:
        """Write it as JSON, whole or not at all."""
        document = {"format": FORMAT, "version": VERSION, **asdict(self)}
        with atomic_path(path) as partial:
            partial.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: Path) -> BruiseModel:
        """Read what `save` wrote.

        Raises `InputError` if it is something else.
        """
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
            head = {"format": FORMAT, "version": VERSION}
            if not isinstance(document, dict) or not head.items() <= document.items():
                raise InputError(f"its format is not {FORMAT} of version {VERSION}")
            return structure(cls, {k: v for k, v in document.items() if k not in head})
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from error
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: not a bruise model ({error}); learn one again") from error


def default_model() -> BruiseModel:
    """Return the model that comes with palpate; `learned_on` names its data."""
    return BruiseModel.load(Path(__file__).with_name("model.json"))


def at_share(log_odds: float, *, bruised_share: float) -> float:
    """Return a probability for a share of bruised sides other than one half.

    >>> round(at_share(0.0, bruised_share=0.5), 3), round(at_share(2.0, bruised_share=0.05), 3)
    (0.5, 0.28)
    """
    moved = log_odds + math.log(bruised_share / (1.0 - bruised_share))
    return 1.0 / (1.0 + math.exp(-min(max(moved, -500.0), 500.0)))


def usable_references(against: Mapping[str, LoadShape]) -> tuple[str, ...]:
    """Return the names of the references that there are, in their order."""
    return tuple(name for name in REFERENCES if name in against)


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
