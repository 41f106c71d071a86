"""Bruises of stored items: references, training with labels, and messages."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from packages.station.tests.factories import make_grasp

from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate_station.bruise.examination import (
    ItemBruise,
    examine_item,
    learn_bruise_model,
    usable_grasps,
)
from palpate_station.bruise.model import BRUISED, SOUND, BruiseModel, default_model
from palpate_station.records import About, Grasp, Item, Source, Verdict
from palpate_station.store import Store

MONDAY = datetime(2026, 5, 4, 8, tzinfo=UTC)
TUESDAY = MONDAY + timedelta(days=1)
RNG = np.random.default_rng(8)


def pixels(*, soft: tuple[int, int] | None = None, spread: float = 2.0) -> np.ndarray:
    """Return the changes of a sound side, or with one pixel of low load."""
    change = -50.0 + spread * RNG.standard_normal((4, 2))
    if soft is not None:
        change[soft] = -15.0
    return change


def grasp(
    item: str, change: np.ndarray, *, at: datetime = MONDAY, side: float = 0.0, size: float = 66.0
) -> Grasp:
    size_mm = Measurement(value=size, low=size - 0.5, high=size + 0.5, unit="mm")
    return make_grasp(
        item,
        taken_at=at,
        rig="bench",
        measurements={"size_mm": size_mm},
        pixel_settled_percent=tuple(map(tuple, change.tolist())),
        angle_deg=side,
    )


def labelled_store() -> Store:
    """Return a store with twelve sound and twelve bruised apples, grasped on Monday."""
    made, minute = Store.open("sqlite://"), timedelta(minutes=1)
    for number in range(12):
        for text, soft in ((SOUND, None), (BRUISED, (number % 4, number % 2))):
            item = f"{text}-{number}"
            made.add_item(Item(item_id=item, kind="apple"))
            made.add_grasp(grasp(item, pixels(), side=90.0))
            made.add_grasp(grasp(item, pixels(soft=soft), at=MONDAY + minute))
            given = {"given_at": MONDAY + 2 * minute, "source": Source.PERSON}
            made.add_verdict(Verdict(item_id=item, about=About.BRUISE, text=text, **given))
    made.add_item(Item(item_id="A17", kind="apple"))
    return made


@pytest.fixture
def store() -> Store:
    return labelled_store()


@pytest.fixture(scope="module")
def model() -> BruiseModel:
    return learn_bruise_model(labelled_store(), kind="apple")


def judge(store: Store, model: BruiseModel, item: str = "A17", **options: float) -> ItemBruise:
    return examine_item(store, item, model=model, given_at=TUESDAY, **options)


def test_examine_item_distinguishes_bruised_and_sound_side(
    store: Store, model: BruiseModel
) -> None:
    store.add_grasp(grasp("A17", pixels(), side=90.0))
    store.add_grasp(grasp("A17", pixels(soft=(1, 0)), at=MONDAY + timedelta(seconds=20)))
    found = judge(store, model)
    assert found.is_bruised
    assert [side.angle_deg for side in found.sides] == [0.0, 90.0]
    assert found.sides[0].against == "class"
    assert found.probability > 0.9 > 0.5 > found.sides[1].probability
    assert model.learned_on == "24 labelled items of kind apple of the store"
    (kept,) = store.verdicts_of("A17", about=About.BRUISE, source=Source.PALPATE)
    assert (kept.text, kept.probability) == (BRUISED, found.probability)


def test_probability_follows_the_prior_and_ignores_a_repeated_grasp(
    store: Store, model: BruiseModel
) -> None:
    change = pixels(soft=(1, 0))
    store.add_grasp(grasp("A17", change))
    once, rare = judge(store, model), judge(store, model, bruised_fraction=0.01)
    odds = [one.probability / (1 - one.probability) for one in (once, rare)]
    assert odds[0] / odds[1] == pytest.approx(99.0)
    store.add_grasp(grasp("A17", change, at=MONDAY + timedelta(minutes=1), side=5.0))
    twice = judge(store, model)
    assert [side.grasps for side in twice.sides] == [2]
    assert twice.probability == pytest.approx(once.probability)


def test_examine_item_compares_with_the_first_visit_of_the_side(store: Store) -> None:
    model = default_model()
    assert "simulated" in model.learned_on
    before = pixels(spread=0.0)
    store.add_grasp(grasp("A17", before, side=3.0, size=67.0))
    store.add_grasp(grasp("A17", pixels(soft=(1, 0), spread=0.0), at=TUESDAY, size=65.5))
    found = judge(store, model)
    assert found.sides[0].against == "history"
    assert found.sides[0].pixels == ((1, 0),)
    assert found.sides[0].pixels_percent == pytest.approx(-15.0)
    assert found.before_percent == pytest.approx(before.mean())
    assert found.sides[0].mean_percent > found.before_percent
    assert found.is_bruised


def test_examine_item_without_pixels_or_reference_raises_with_remedy(
    store: Store, model: BruiseModel
) -> None:
    store.add_item(Item(item_id="B1", kind="pear"))
    with pytest.raises(InputError, match=r"'B1': no completed grasp .* has pixel data"):
        judge(store, model, "B1")
    store.add_grasp(grasp("B1", pixels()))
    with pytest.raises(InputError, match=r"no reference to compare with.*--angle-deg 90"):
        judge(store, model, "B1")
    store.add_grasp(grasp("A20", pixels()))
    store.add_grasp(grasp("A20", pixels(), at=TUESDAY))
    with pytest.raises(InputError, match="has no reference that the model was trained on"):
        judge(store, model, "A20")
    with pytest.raises(InputError, match="0 bruised and 0 sound sides"):
        learn_bruise_model(store, kind="pear")


def test_slips_and_grasps_without_pixels_are_not_used() -> None:
    complete = grasp("A17", pixels())
    slipped = replace(complete, outcome=Outcome.SLIPPED)
    without_pixels = replace(complete, pixel_settled_percent=None)
    assert usable_grasps([slipped, complete, without_pixels]) == (complete,)
