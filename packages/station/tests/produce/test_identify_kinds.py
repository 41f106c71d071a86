"""Identification of items: probabilities of kinds, and unknown items."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_station.identify.identifier import Identifier
from palpate_station.learning import UNKNOWN, LabelLearner

#: ln of size and stiffness of two kinds that differ in size, and one that differs in stiffness.
KINDS = {"small": (3.2, 1.0), "large": (4.1, 1.0), "hard": (4.1, 2.5)}
SPREAD = 0.08


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def grasps(rng: np.random.Generator, kind: str) -> list[FloatArray]:
    true = np.array(KINDS[kind]) + SPREAD * rng.standard_normal(2)
    return [true + 0.03 * rng.standard_normal(2) for _ in range(2)]


def labelled(rng: np.random.Generator, *, items: int = 20) -> list[tuple[str, list[FloatArray]]]:
    return [(kind, grasps(rng, kind)) for kind in KINDS for _ in range(items)]


@pytest.mark.slow
def test_identify_known_kinds_are_named_and_rarely_rejected(rng: np.random.Generator) -> None:
    known = Identifier(labelled(rng))
    found = [(kind, known.identify(grasps(rng, kind))) for kind in KINDS for _ in range(100)]
    assert np.mean([identity.best_guess == kind for kind, identity in found]) > 0.97
    assert np.mean([identity.rejected for _, identity in found]) <= 0.09


def test_identify_rejects_an_untrained_kind_if_there_are_enough_items(
    rng: np.random.Generator,
) -> None:
    identity = Identifier(labelled(rng)).identify([np.array((5.5, -1.0))])
    assert identity.rejected
    assert identity.kind == UNKNOWN
    assert identity.usual <= 0.05
    assert identity.confidence == pytest.approx(1 - identity.usual)
    few = Identifier(labelled(rng, items=5))
    assert few.learner.items_missing == 4
    assert not few.identify([np.array((9.0, -5.0))]).rejected
    assert Identifier(labelled(rng, items=7)).learner.items_missing == 0


def test_identifier_kind_with_too_few_items_raises(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="found rare 1; label more"):
        Identifier([*labelled(rng), ("rare", grasps(rng, "hard"))])
    with pytest.raises(InputError, match="found none"):
        Identifier([])


@pytest.mark.slow
def test_learner_splits_keep_rows_of_an_item_together(rng: np.random.Generator) -> None:
    # Items are random points, and rows of an item are nearly equal: only a split within an item
    # makes the labels predictable.
    rows = [point + 1e-6 * k for point in rng.standard_normal((40, 2)) for k in range(2)]
    labels, items = 20 * ["a", "a", "b", "b"], [str(number // 2) for number in range(80)]
    by_item = LabelLearner(allow_unknown=False, methods=("trees",)).fit(rows, labels, items=items)
    by_row = LabelLearner(allow_unknown=False, methods=("trees",)).fit(rows, labels)
    assert by_item.score().right < 0.7 < by_row.score().right


def test_learner_depends_neither_on_the_order_of_rows_nor_on_names(
    rng: np.random.Generator,
) -> None:
    labels = [*(6 * ["egg"]), *(6 * ["grape"])]
    table = rng.normal(0.0, 1.0, (12, 2)) + (np.array(labels) == "egg")[:, None]
    items = [f"i{row // 2}" for row in range(12)]
    renamed = [f"n{(5 * (row // 2)) % 6}" for row in range(12)]
    order = rng.permutation(12)
    one = LabelLearner(allow_unknown=False, methods=("discriminant",)).fit(
        table, labels, items=items
    )
    other = LabelLearner(allow_unknown=False, methods=("discriminant",)).fit(
        table[order], [labels[k] for k in order], items=[renamed[k] for k in order]
    )
    assert other.score() == one.score()
    assert np.array_equal(other.probabilities(table), one.probabilities(table))
