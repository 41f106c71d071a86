"""Ripeness of a batch: stage and expected date of each item.

    python examples/batch_ripeness.py items.sqlite Monday

reads a store written by `palpate grasp --item`. Without arguments it first creates the simulated
store of `palpate demo packhouse`: a batch on three mornings, and twelve labelled fruits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from palpate_station.demo_packhouse import write_packhouse
from palpate_station.ripeness.history import firmness_history, judge_ripeness, learn_rule
from palpate_station.ripeness.stages import RIPE, STAGES
from palpate_station.store import Store


def main(arguments: list[str]) -> None:
    """Judge a batch of a store."""
    path = Path(arguments[0] if arguments else "demo-packhouse/palpate-items.sqlite")
    batch = arguments[1] if len(arguments) > 1 else "Monday"
    if not arguments and not path.exists():
        write_packhouse(path.parent)
    with Store.open(path, create=False) as store:
        rule = learn_rule(store, kind="avocado", drive="width", stages=STAGES)
        fruits = [
            firmness_history(store.grasps_of(item.item_id), item_id=item.item_id, drive="width")
            for item in store.items_of_batch(batch)
        ]
    judged = [judge_ripeness(fruit, rule=rule, ripe=RIPE) for fruit in fruits]
    simulated = any(grasp.is_simulated for fruit in fruits for grasp in fruit.grasps)
    print(f"{batch}{' (simulated)' if simulated else ''}: {len(fruits)} fruits")
    for fruit, verdict in zip(fruits, judged, strict=True):
        wait = verdict.days_to_ripe
        when = f"ripe in {max(wait.value, 0):.1f} days ({max(wait.low, 0):.1f} to {wait.high:.1f})"
        if wait.value <= 0:
            when = "it is or was ripe"
        percent = 100 * verdict.probabilities[verdict.stage]
        print(f"  {fruit.item_id}: {verdict.stage} ({percent:.0f} %), {when}")
    plot(fruits, rule, Path("batch.png"))


def plot(fruits: list, rule: object, path: Path) -> None:
    """Draw the firmness of every fruit and the stage boundaries."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for fruit in fruits:
        days = [day.day for day in fruit.days]
        axes.plot(days, [np.exp(day.firmness) for day in fruit.days], "o-", label=fruit.item_id)
    for stage in STAGES[1:]:
        begins = np.exp(rule.find_boundary(stage))
        axes.axhline(begins, color="#8A8A8A", lw=0.8, ls="--")
        axes.annotate(f"{stage} below", (2.5, begins), fontsize=7, va="top")
    axes.set(xlabel="days since the first grasp", ylabel="stiffness at 5 N, N/mm", yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.legend(fontsize=7, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 0.02))
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
