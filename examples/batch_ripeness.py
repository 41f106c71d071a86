"""Ripeness of a batch: who is ripe today, who will be when, as a table and a picture.

    python examples/batch_ripeness.py items.sqlite Monday

reads a store that `palpate grasp --item` filled. Without arguments it makes one first,
`batch.sqlite`: made-up numbers of a batch on four mornings (simulated, and said so), of six
fruits that a person labelled, and of a rubber ball that shows how the sensor drifts.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import About, Grasp, Item, Source, Verdict
from palpate.produce.ripeness_stages import RIPE, STAGES
from palpate.produce.ripeness_store import drift_of, history_of, judge, learn_rule
from palpate.produce.store import Store

FIRST = datetime(2026, 5, 4, 8, tzinfo=UTC)
DAYS, GRASPS = 4, 3


def make_store(path: Path) -> None:
    """Write made-up grasps: stiffness falls from 6 to 1.2 N/mm; the sensor loses 2 % a day."""
    chance = np.random.default_rng(11)

    def grasps(item_id: str, day: int, stiffness: float, *, week: int) -> list[Grasp]:
        # What is read as 5 N is more and more: it presses deeper, and a round fruit (Hertz) looks
        # softer by two thirds of that.
        read_over_true = 0.98 ** (7 * week + day)
        # A ball is the same wherever it is touched; fruit is not.
        scatter = 0.02 if item_id == "ball" else 0.08
        found = []
        for minute in range(GRASPS):
            value = stiffness * float(np.exp(scatter * chance.standard_normal()))
            pressed_mm = 5.0 / value / read_over_true ** (2 / 3)
            felt = {
                "stiffness_n_per_mm": (5.0 / pressed_mm, "n_per_mm"),
                "force_n": (5.0, "n"),
                "width_mm": (62.0 - pressed_mm, "mm"),
                "settled_percent": (-45.0, "percent"),
            }
            found.append(
                Grasp(
                    item_id=item_id,
                    taken_at=FIRST + timedelta(weeks=week, days=day, minutes=minute),
                    rig="made-up",
                    drive="width",
                    origin="twin",
                    outcome=Outcome.HELD,
                    measurements={
                        name: Measurement(value=v, low=v - abs(v) / 5, high=v + abs(v) / 5, unit=u)
                        for name, (v, u) in felt.items()
                    },
                )
            )
        return found

    with Store.open(path) as store:
        for week, count in ((0, 6), (1, 8)):
            for day in range(DAYS):
                store.add_grasps(grasps("ball", day, 4.0, week=week))
            for number in range(count):
                name = f"{'taught' if week == 0 else 'fruit'}-{number}"
                batch = "Monday" if week else "labelled"
                store.add_item(Item(item_id=name, kind="avocado", batch=batch))
                halfway = float(chance.uniform(-0.5, 3.0)) + week
                for day in range(DAYS):
                    stiffness = 1.2 + 4.8 / (1 + np.exp((day - halfway) / 0.6))
                    store.add_grasps(grasps(name, day, stiffness, week=week))
                    if week == 0:
                        said = STAGES[sum(stiffness < bound for bound in (4.5, 2.8, 1.7))]
                        store.add_verdict(
                            Verdict(
                                item_id=name,
                                about=About.RIPENESS,
                                text=said,
                                given_at=FIRST + timedelta(days=day, hours=2),
                                source=Source.PERSON,
                            )
                        )


def main(arguments: list[str]) -> None:
    """Judge a batch of a store."""
    path = Path(arguments[0] if arguments else "batch.sqlite")
    batch = arguments[1] if len(arguments) > 1 else "Monday"
    if not arguments and not path.exists():
        make_store(path)
    with Store.open(path, create=False) as store:
        drift = drift_of(store, "ball", drive="width")
        rule = learn_rule(store, kind="avocado", drive="width", stages=STAGES, drift=drift)
        fruits = [
            history_of(
                store.grasps_of(item.item_id), item_id=item.item_id, drive="width", drift=drift
            )
            for item in store.of_batch(batch)
        ]
    judged = [judge(fruit, rule=rule, ripe=RIPE) for fruit in fruits]
    simulated = any(grasp.simulated for fruit in fruits for grasp in fruit.grasps)
    print(f"{batch}{' (simulated)' if simulated else ''}: {len(fruits)} fruits")
    for fruit, said in zip(fruits, judged, strict=True):
        wait = said.days_to_ripe
        when = f"ripe in {max(wait.value, 0):.1f} days ({max(wait.low, 0):.1f} to {wait.high:.1f})"
        if wait.value <= 0:
            when = "it is or was ripe"
        chance = 100 * said.probabilities[said.stage]
        print(f"  {fruit.item_id}: {said.stage} ({chance:.0f} %), {when}")
    print(f"the ball reads {100 * np.expm1(drift.moved[-1]):+.0f} % since the first day")
    plot(fruits, rule, Path("batch.png"))


def plot(fruits: list, rule: object, path: Path) -> None:
    """Draw every fruit's days, free of the sensor's drift, and where the stages begin."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for fruit in fruits:
        days = [day.day for day in fruit.days]
        axes.plot(days, [np.exp(day.firmness) for day in fruit.days], "o-", label=fruit.item_id)
    for stage, firmness in zip(STAGES[1:], rule.boundaries.firmness, strict=True):
        axes.axhline(np.exp(firmness), color="#8A8A8A", lw=0.8, ls="--")
        axes.annotate(f"{stage} below", (2.5, np.exp(firmness)), fontsize=7, va="top")
    axes.set(xlabel="days since the first grasp", ylabel="stiffness at 5 N, N/mm", yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.legend(fontsize=7, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 0.02))
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
