"""Probability of a bruise, learned from labelled sides.

A side is compared with one reference. A logistic regression on the contrasts
(`bruise.shape.contrast`) of labelled sides to the same reference estimates the probability. If
several references are available, only the most informative one is used, because a second reference
adds nothing on simulated apples (study bruise).
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
from palpate_station.bruise.shape import LoadShape, contrast
from palpate_station.learning import LabelLearner, LabelledTable

#: References of a side, the most informative first: earlier grasps of the side, sound items of the
#: same kind on the same sensor, other sides of the item.
REFERENCES = ("history", "class", "item")
#: Labels of an item, given with `palpate items A17 --say bruise=sound`.
BRUISED, SOUND = "bruised", "sound"
#: Pipeline in `palpate_station.learning.METHODS`; no other is more accurate (study bruise).
METHODS = ("logistic",)
#: Minimum number of sides of each label in the training set.
_FEWEST_SIDES = 10
_SIMULATED = Path(__file__).with_name("simulated.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Load distribution of one grasp of a side, and its references."""

    shape: LoadShape
    #: Available references by their names in `REFERENCES`.
    against: Mapping[str, LoadShape]


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseModel:
    """Classifier of bruises, learned from labelled sides."""

    #: Description of the training sides, with a note if they are simulated.
    learned_on: str
    #: Classifier for each reference.
    learners: Mapping[str, LabelLearner]

    @classmethod
    def learn(cls, known: Mapping[str, LabelledTable], *, learned_on: str) -> BruiseModel:
        """Learn from labelled sides.

        `known`: table for each reference, see `build_contrast_tables`; references with fewer than
            ten bruised or ten sound sides are skipped.
        `learned_on`: description of the sides.
        Raises `InputError` if no reference remains; `MissingExtraError` if scikit-learn is not
        installed.
        """
        counts = {name: Counter(table.labels) for name, table in known.items()}
        learners = {
            name: table.learn(methods=METHODS)
            for name, table in known.items()
            if min(counts[name][BRUISED], counts[name][SOUND]) >= _FEWEST_SIDES
        }
        if not learners:
            most = max(counts.values(), key=lambda one: one.total(), default=Counter[str]())
            raise InputError(
                f"{most[BRUISED]} bruised and {most[SOUND]} sound sides are labelled; training "
                f"requires {_FEWEST_SIDES} of each with the same reference"
            )
        return cls(learned_on=learned_on, learners=learners)

    def choose_reference(self, side: Side) -> str:
        """Return the most informative reference that the side and the model share.

        Raises `InputError` if there is none.
        """
        for name in REFERENCES:
            if name in side.against and name in self.learners:
                return name
        raise InputError(
            "the side has no reference that the model was trained on "
            f"({', '.join(self.learners)}); grasp another side, or sound items of the same kind"
        )

    def log_odds(self, side: Side) -> float:
        """Return the log odds that a side is bruised, at even prior odds.

        Raises `InputError` if the side and the model share no reference.
        """
        name = self.choose_reference(side)
        learner = self.learners[name]
        bruised, sound = np.log(
            learner.probabilities([contrast(side.shape, side.against[name])])[0] / learner.fractions
        )
        return float(bruised - sound)


def build_contrast_tables(sides: Sequence[tuple[str, bool, Side]]) -> dict[str, LabelledTable]:
    """Return the contrasts of labelled sides to each available reference.

    `sides`: item, whether the side is bruised, and the side.
    """
    found = {}
    for name in REFERENCES:
        comparable = [one for one in sides if name in one[2].against]
        if comparable:
            rows = [
                (contrast(side.shape, side.against[name]), BRUISED if bruised else SOUND, item)
                for item, bruised, side in comparable
            ]
            found[name] = _contrast_table(name, rows)
    return found


def _contrast_table(reference: str, rows: Sequence[tuple[FloatArray, str, str]]) -> LabelledTable:
    features = [f"{reference}_{number}" for number in range(len(rows[0][0]))]
    return LabelledTable.from_rows(features, rows)


def load_simulated_sides() -> tuple[str, dict[str, LabelledTable]]:
    """Return the built-in simulated sides: description, and a table for each reference."""
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
    """Return the model learned from the built-in simulated sides.

    Raises `MissingExtraError` if scikit-learn is not installed.
    """
    learned_on, known = load_simulated_sides()
    return BruiseModel.learn(known, learned_on=learned_on)
