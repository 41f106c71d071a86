"""Sorting a mixed crate by rules: purity and throughput, with and without grasping again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import Identifier, label_identity
from palpate.produce.sorting.conditions import Evidence, OneOf, Within
from palpate.produce.sorting.hand import TimedGrasp
from palpate.produce.sorting.rules import Rule, RuleBook, decide
from palpate.produce.sorting.run import sort_item
from palpate.produce.sorting.score import (
    CARRY_S,
    TURN_S,
    Placed,
    Score,
    score_sorting,
    true_bin,
)
from palpate_studies.identify import (
    NEAREST_MEAN,
    CratesOption,
    Guess,
    ItemsOption,
    SensorsOption,
    against_learners,
    answers,
    crates_of,
    identifiers,
    learn_nearest_mean,
    summed,
)
from palpate_studies.identify_data import (
    SORTED_GRASPS,
    CrateItemGrasps,
    write_crates,
)
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _bin_of(kind: str, *sizes: Within, bin_name: str | None = None) -> Rule:
    return Rule(bin=bin_name or kind, conditions=(OneOf("class", frozenset({kind})), *sizes))


#: The rules of the study: one bin per kind, kiwis by size, strangers apart.
BOOK = RuleBook(
    rules=(
        _bin_of("unknown", bin_name="strangers"),
        _bin_of("egg"),
        _bin_of("cherry-tomato"),
        _bin_of("strawberry"),
        _bin_of("lime"),
        _bin_of("kiwi", Within("size_mm", 0.0, 50.0), bin_name="kiwi, small"),
        _bin_of("kiwi", Within("size_mm", 50.0, 100.0), bin_name="kiwi, large"),
        _bin_of("tomato"),
        _bin_of("peach"),
        _bin_of("avocado"),
        _bin_of("apple"),
    ),
    default_bin="by hand",
    most_grasps=SORTED_GRASPS,
)


def report(
    *,
    sensors: SensorsOption = 1,
    items: ItemsOption = 2,
    crates: CratesOption = None,
) -> StudyReport:
    """Sort mixed crates with strangers among them; purity and items per hour of each way.

    Example: palpate study sorting --out reports
    """
    return judge(crates_of(crates, sensors=sensors, items=items))


command = as_command(report)


def sort_crates(
    crates: Sequence[CrateItemGrasps], *, book: RuleBook
) -> dict[tuple[str, str], Score]:
    """Sort every crate in every way; level and method -> score."""
    placed: dict[tuple[str, str], list[Placed]] = {}
    for key, mine in group(crates, "level", "sensor"):
        for method, done in _sorted_by_all(mine, book=book).items():
            placed.setdefault((key["level"], method), []).extend(done)
    return {key: score_sorting(done, book=book) for key, done in placed.items()}


def _sorted_by_all(crate: Sequence[CrateItemGrasps], *, book: RuleBook) -> dict[str, list[Placed]]:
    teaching = [item for item in crate if item.teaches]
    sorting = [item for item in crate if not item.teaches]
    done = {NEAREST_MEAN: _by_guess(sorting, learn_nearest_mean(teaching), book=book)}
    for name, known in identifiers(teaching).items():
        for most in range(1, book.most_grasps + 1):
            method = f"{name}, " + ("one grasp" if most == 1 else f"up to {most} grasps")
            tried = replace(book, most_grasps=most)
            done[method] = [_placed(item, known=known, book=tried) for item in sorting]
    return done


def _placed(item: CrateItemGrasps, *, known: Identifier, book: RuleBook) -> Placed:
    """Sort one item with the grasps that were made of it, as far as they are asked for."""

    def grasp(number: int, size: Measurement | None) -> TimedGrasp:
        return item.grasps[number]

    done = sort_item(item.item_id, book=book, identifier=known, grasp=grasp)
    return Placed(
        bin=done.decision.bin,
        belongs=_belongs(item, book),
        grasps=len(done.grasps),
        grasping_s=done.grasping_s,
    )


def _by_guess(items: Sequence[CrateItemGrasps], guess: Guess, *, book: RuleBook) -> list[Placed]:
    """Sort by a method that names one kind, without doubt, from one grasp."""
    found = []
    for item in items:
        first = item.grasps[0]
        found.append(
            Placed(
                bin=_certain(first.grasp.measurements, guess, book=book),
                belongs=_belongs(item, book),
                grasps=1,
                grasping_s=first.lasted_s,
            )
        )
    return found


def _certain(measured: Mapping[str, Measurement], guess: Guess, *, book: RuleBook) -> str:
    size = measured.get("size_mm")
    if size is None or "stiffness_n_per_mm" not in measured:
        return book.default_bin
    identity = label_identity(guess(measured))
    sharp = replace(size, low=size.middle, high=size.middle)
    return decide(book, Evidence(identity=identity, size_mm=sharp, grasps=book.most_grasps)).bin


def _belongs(item: CrateItemGrasps, book: RuleBook) -> str:
    return true_bin(book, kind=item.kind, taught=item.known, size_mm=item.size_mm)


def judge(crates: Sequence[CrateItemGrasps], *, book: RuleBook = BOOK) -> StudyReport:
    """Put all ways of sorting into tables."""
    given = answers(crates)
    summary = [
        {
            "level": level,
            "method": method,
            "items": one.items,
            "purity": one.purity,
            "left_over": one.left_over,
            "grasps_per_item": one.grasps_per_item,
            "items_per_hour": one.items_per_hour,
            "sorted_right_per_hour": one.items_per_hour * (1 - one.left_over) * (one.purity or 0.0),
            "bins": {name: list(counts) for name, counts in one.bins.items()},
        }
        for (level, method), one in sort_crates(crates, book=book).items()
    ]
    sorting = [item for item in crates if not item.teaches]
    damaged = sum(item.damaged for item in sorting)
    return StudyReport(
        name="sorting",
        title="Sorting a mixed crate by rules (simulated)",
        provenance=(
            f"Simulated: {len(sorting)} items sorted, a quarter of them strangers; taught and "
            "measured as in `palpate study identify`. Right is where the rules would send the item "
            "if everything of it were known.",
            f"Items per hour count {CARRY_S:g} s to bring and carry away an item and {TURN_S:g} s "
            "to turn it for another grasp: assumed, not simulated.",
            f"Pressed beyond their yield in up to {SORTED_GRASPS} grasps: {damaged} of "
            f"{len(sorting)} items.",
        ),
        tables=[Table.of("Purity of what a rule put into a bin, and what it costs", summary)],
        payload={
            "study": "sorting",
            "simulated": True,
            "carry_s": CARRY_S,
            "turn_s": TURN_S,
            "items": len(sorting),
            "damaged": damaged,
            "summary": summary,
            "identify": summed(given),
            "against_learners": against_learners(given),
        },
        files={"crates.json": partial(write_crates, crates)},
        figures={"sorting-rate": partial(draw, summary)},
    )


def draw(summary: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw errors over items per hour: each line goes from one grasp an item to three."""
    from palpate.plots.style import BLUE, ORANGE, new_figure

    levels = list(dict.fromkeys(row["level"] for row in summary))
    ways = {"ours, ": ("palpate", BLUE), "boosted trees, ": ("boosted trees", ORANGE)}
    with new_figure(columns=len(levels), width_in=7.2, height_in=3.2, shared=True) as (fig, axes):
        for axis, level in zip(axes[0], levels, strict=True):
            for start, (label, colour) in ways.items():
                rows = [
                    row
                    for row in summary
                    if row["level"] == level and row["method"].startswith(start)
                    if row["method"].endswith(("one grasp", "2 grasps", "3 grasps"))
                ]
                rate = [row["items_per_hour"] for row in rows]
                left = [100 * row["left_over"] for row in rows]
                wrong = [
                    (100 - at) * (1 - (r["purity"] or 0.0))
                    for at, r in zip(left, rows, strict=True)
                ]
                axis.plot(rate, left, "s--", color=colour, label=f"{label}: left for people")
                axis.plot(rate, wrong, "o-", color=colour, label=f"{label}: in a wrong bin")
            axis.set(xlabel="items per hour", title=f"{level}, simulated", ylim=(0, 100))
        axes[0][0].set_ylabel("share of the crate (%)")
        axes[0][0].legend(fontsize=7, loc="upper left")
    return fig
