"""A packhouse to try: a store with a week of avocados and a rubber ball, and rules to sort them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.files import atomic_path
from palpate.grasp.result import Outcome
from palpate.produce.records import About, Grasp, Item, Source, Verdict
from palpate.produce.ripeness.stages import STAGES
from palpate.produce.store import Store

_FIRST = datetime(2026, 5, 4, 8, tzinfo=UTC)
_DAYS, _GRASPS_A_DAY = 4, 3
#: Stiffness below which a person calls the fruit by the next stage, N/mm.
_BOUNDARIES_N_PER_MM = (4.5, 2.8, 1.7)
#: The sheet reads less of the same force from day to day.
_KEPT_A_DAY = 0.98

_RULES = """\
# Where things go. The first rule that is sure enough of an item wins.

default = "by hand"     # whatever no rule is sure of
confidence = 0.8        # how sure a rule must be that all its conditions hold

[[rule]]
bin = "sell today"
ripeness = "ripe"

[[rule]]
bin = "guacamole"
ripeness = "overripe"

[[rule]]
bin = "ripening room"
ripeness = ["hard", "conditioned"]
"""
_SIZES = """\
# By size alone: two bins for a simulated crate.

default = "by hand"
confidence = 0.8
most_grasps = 2         # how often an item is grasped before it goes to the default bin

[[rule]]
bin = "small"
size_mm = [0, 45]       # from 0 up to, and without, 45

[[rule]]
bin = "large"
size_mm = [45, 80]
"""


def write_packhouse(folder: Path) -> list[Path]:
    """Write a store and two files of rules; the grasps are made-up numbers, labelled simulated.

    `folder`: made where it does not exist.
    Writes `palpate-items.sqlite`: six avocados that a person labelled ("labelled"), eight to judge
    ("Monday"), on four mornings, and a ball that does not ripen. `rules.toml`: by ripeness.
    `by-size.toml`: by size. Raises `InputError` if the folder has such a store already: nothing is
    added to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "palpate-items.sqlite"
    if path.exists():
        raise InputError(f"{path}: is there already; name another folder, or remove it")
    with Store.open(path) as store:
        fill(store, seed=11)
    written = [path]
    for name, text in (("rules.toml", _RULES), ("by-size.toml", _SIZES)):
        with atomic_path(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
        written.append(folder / name)
    return written


def fill(store: Store, *, seed: int) -> None:
    """Add made-up grasps: stiffness falls from 6 to 1.2 N/mm, the sensor loses 2 % a day."""
    chance = np.random.default_rng(seed)
    for week, (batch, name, count) in enumerate(
        (("labelled", "taught", 6), ("Monday", "fruit", 8))
    ):
        for day in range(_DAYS):
            store.add_grasps(_grasps("ball", 4.0, day=day, week=week, scatter=0.02, chance=chance))
        for number in range(count):
            item = Item(item_id=f"{name}-{number}", kind="avocado", batch=batch)
            store.add_item(item)
            _follow(store, item.item_id, week=week, labelled=batch == "labelled", chance=chance)


def _follow(
    store: Store, item_id: str, *, week: int, labelled: bool, chance: np.random.Generator
) -> None:
    """Grasp a fruit on four mornings; where it is labelled, a person names its stage each day."""
    halfway = float(chance.uniform(-0.5, 3.0)) + week
    for day in range(_DAYS):
        stiffness = 1.2 + 4.8 / (1 + np.exp((day - halfway) / 0.6))
        # Fruit is not the same wherever it is touched.
        store.add_grasps(
            _grasps(item_id, stiffness, day=day, week=week, scatter=0.08, chance=chance)
        )
        if labelled:
            stage = STAGES[sum(stiffness < bound for bound in _BOUNDARIES_N_PER_MM)]
            given_at = _FIRST + timedelta(weeks=week, days=day, hours=2)
            store.add_verdict(
                Verdict(
                    item_id=item_id,
                    about=About.RIPENESS,
                    text=stage,
                    given_at=given_at,
                    source=Source.PERSON,
                )
            )


def _grasps(
    item_id: str,
    stiffness_n_per_mm: float,
    *,
    day: int,
    week: int,
    scatter: float,
    chance: np.random.Generator,
) -> list[Grasp]:
    """Return one morning's grasps of an item, as this sensor would read them."""
    # What is read as 5 N is more and more: it presses deeper, and a round fruit (Hertz) looks
    # softer by two thirds of that.
    read_over_true = _KEPT_A_DAY ** (7 * week + day)
    found = []
    for minute in range(_GRASPS_A_DAY):
        value = stiffness_n_per_mm * float(np.exp(scatter * chance.standard_normal()))
        pressed_mm = 5.0 / value / read_over_true ** (2 / 3)
        measured = {
            "stiffness_n_per_mm": (5.0 / pressed_mm, 1.0 / pressed_mm, "n_per_mm"),
            "force_n": (5.0, 0.5, "n"),
            "size_mm": (62.0, 0.4, "mm"),
            "width_mm": (62.0 - pressed_mm, 0.05, "mm"),
            "settled_percent": (-45.0, 3.0, "percent"),
        }
        found.append(
            Grasp(
                item_id=item_id,
                taken_at=_FIRST + timedelta(weeks=week, days=day, minutes=minute),
                rig="made-up",
                drive="width",
                origin="twin",
                outcome=Outcome.HELD,
                measurements={
                    name: Measurement(value=value, low=value - half, high=value + half, unit=unit)
                    for name, (value, half, unit) in measured.items()
                },
            )
        )
    return found
