"""The probability of a bruise, learned from sides known to be sound or bruised.

A side is compared with one reference, and its contrast (`bruise.shape.contrast`) is judged by a
logistic regression on contrasts of known sides to the same reference. Of several references the
most informative is used: on simulated apples a second one adds nothing (study bruise).
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.produce.bruise.shape import LoadShape, contrast
from palpate.produce.learning import LabelLearner, LabelledTable

#: What a side may be compared with, the most informative first: its own earlier record, sound items
#: of its kind on the same sensor, the item's other sides.
REFERENCES = ("history", "class", "item")
#: What people call an item, for others to be learned from: `palpate items A17 --say bruise=sound`.
BRUISED, SOUND = "bruised", "sound"
#: The pipeline that learns: none names more (study bruise).
METHODS = ("logistic",)
#: Fewest sides of each label to learn from.
_FEWEST = 10
_SIMULATED = Path(__file__).with_name("simulated.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """The load of one grasp of a side on the pixels, and its references."""

    shape: LoadShape
    #: By their names in `REFERENCES`: those that there are.
    against: Mapping[str, LoadShape]


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseModel:
    """The judge of bruises, learned from labelled sides."""

    #: Which sides, in words; simulated where they were.
    learned_on: str
    #: By the name of a reference.
    learners: Mapping[str, LabelLearner]

    @classmethod
    def learn(cls, known: Mapping[str, LabelledTable], *, learned_on: str) -> BruiseModel:
        """Learn from known sides.

        `known`: by reference, see `table_sides`; references with fewer than ten bruised or ten
            sound sides are left out.
        `learned_on`: what they are, in words.
        Raises `InputError` if no reference is left; `MissingExtraError` if scikit-learn is not
        installed.
        """
        counts = {name: Counter(table.labels) for name, table in known.items()}
        learners = {
            name: table.learn(methods=METHODS)
            for name, table in known.items()
            if min(counts[name][BRUISED], counts[name][SOUND]) >= _FEWEST
        }
        if not learners:
            most = max(counts.values(), key=lambda one: one.total(), default=Counter[str]())
            raise InputError(
                f"{most[BRUISED]} bruised and {most[SOUND]} sound sides are labelled; learning "
                f"needs {_FEWEST} of each with a reference in common"
            )
        return cls(learned_on=learned_on, learners=learners)

    def choose_reference(self, side: Side) -> str:
        """Return the reference that a side is compared with.

        Raises `InputError` if it has none of this model's.
        """
        for name in REFERENCES:
            if name in side.against and name in self.learners:
                return name
        raise InputError(
            f"none of the references that the model was learned for ({', '.join(self.learners)}); "
            "grasp another side, or sound items of the class"
        )

    def log_odds(self, side: Side) -> float:
        """Return the log odds that a side is bruised, at even prior odds.

        Raises `InputError` if it has no reference of this model.
        """
        name = self.choose_reference(side)
        learner = self.learners[name]
        bruised, sound = np.log(
            learner.probabilities([contrast(side.shape, side.against[name])])[0] / learner.fractions
        )
        return float(bruised - sound)


def table_sides(sides: Sequence[tuple[str, bool, Side]]) -> dict[str, LabelledTable]:
    """Return the contrasts of labelled sides to each available reference.

    `sides`: of each its item, whether it is bruised, and its grasp.
    """
    found = {}
    for name in REFERENCES:
        having = [one for one in sides if name in one[2].against]
        if having:
            rows = [
                (contrast(side.shape, side.against[name]), BRUISED if bruised else SOUND, item)
                for item, bruised, side in having
            ]
            found[name] = _contrast_table(name, rows)
    return found


def _contrast_table(reference: str, rows: Sequence[tuple[FloatArray, str, str]]) -> LabelledTable:
    features = [f"{reference}_{number}" for number in range(len(rows[0][0]))]
    return LabelledTable.of(features, rows)


def load_simulated_sides() -> tuple[str, dict[str, LabelledTable]]:
    """Return the labels and the simulated sides that ship with palpate, by reference."""
    document = json.loads(_SIMULATED.read_text())
    return document["learned_on"], {
        name: _contrast_table(
            name,
            [
                (contrasts, label, str(number))
                for number, (contrasts, label) in enumerate(
                    zip(sides["contrasts"], sides["labels"], strict=True)
                )
            ],
        )
        for name, sides in document["sides"].items()
    }


@lru_cache(maxsize=1)
def default_model() -> BruiseModel:
    """Return the model learned from the simulated sides that ship with palpate.

    Raises `MissingExtraError` if scikit-learn is not installed.
    """
    learned_on, known = load_simulated_sides()
    return BruiseModel.learn(known, learned_on=learned_on)
