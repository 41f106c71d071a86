"""Sorting a mixed crate by rules: purity and throughput, with and without grasping again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.commands.options import JsonOption, TargetForceOption
from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import Identifier, as_labelled
from palpate.produce.sorting.conditions import Evidence, OneOf, Within
from palpate.produce.sorting.hand import TimedGrasp
from palpate.produce.sorting.rules import Rule, RuleBook, decide
from palpate.produce.sorting.rules_file import check_kinds, read_rules
from palpate.produce.sorting.run import sort_item
from palpate.produce.sorting.score import (
    CARRY_S,
    TURN_S,
    Placed,
    Score,
    score_sorting,
    where_it_belongs,
)
from palpate_studies.identify import (
    CratesOption,
    ItemsOption,
    SensorsOption,
    against_lda,
    answers,
    crates_of,
    identifiers,
    summed,
)
from palpate_studies.identify_baselines import Guess, guesses
from palpate_studies.identify_data import (
    LEVELS,
    SORTED_GRASPS,
    CrateItemGrasps,
    squeeze_in_words,
    write_crates,
)
from palpate_studies.plots.sorting import purity_figure
from palpate_studies.report import OutOption, StudyReport, Table


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One way of sorting all crates of one level."""

    level: str
    method: str
    score: Score


def command(
    sensors: SensorsOption = 1,
    items: ItemsOption = 2,
    crates: CratesOption = None,
    rules: Annotated[
        Path | None, typer.Option(help="Rules file; by default one bin per kind.", metavar="FILE")
    ] = None,
    target_force_n: TargetForceOption = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Sort mixed crates with strangers among them; purity and items per hour of each way.

    Example: palpate study sorting --out reports
    """
    book = BOOK if rules is None else read_rules(rules)
    found = crates_of(crates, sensors=sensors, items=items, target_force_n=target_force_n)
    if rules is not None:
        check_kinds(book, taught={item.kind for item in found if item.teaches}, path=rules)
    report(found, book=book).emit(as_json=as_json, out=out)
    if out is not None:
        write_crates(found, out / "crates.json")


def runs(crates: Sequence[CrateItemGrasps], *, book: RuleBook) -> list[Run]:
    """Sort every crate in every way."""
    found = []
    for level in LEVELS:
        of_level = [item for item in crates if item.level == level]
        if not of_level:
            continue
        placed: dict[str, list[Placed]] = {}
        for sensor in sorted({item.sensor for item in of_level}):
            mine = [item for item in of_level if item.sensor == sensor]
            for method, done in _sorted_by_all(mine, book=book).items():
                placed.setdefault(method, []).extend(done)
        found += [
            Run(level=level, method=method, score=score_sorting(done, book=book))
            for method, done in placed.items()
        ]
    return found


def _sorted_by_all(crate: Sequence[CrateItemGrasps], *, book: RuleBook) -> dict[str, list[Placed]]:
    teaching = [item for item in crate if item.teaches]
    sorting = [item for item in crate if not item.teaches]
    done = {
        method: _by_guess(sorting, guess, book=book) for method, guess in guesses(teaching).items()
    }
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
    identity = as_labelled(guess(measured))
    sharp = replace(size, low=size.middle, high=size.middle)
    return decide(book, Evidence(identity=identity, size_mm=sharp, grasps=book.most_grasps)).bin


def _belongs(item: CrateItemGrasps, book: RuleBook) -> str:
    return where_it_belongs(book, kind=item.kind, taught=item.known, size_mm=item.size_mm)


def report(crates: Sequence[CrateItemGrasps], *, book: RuleBook = BOOK) -> StudyReport:
    """Put all ways of sorting into tables and a figure."""
    found, given = runs(crates, book=book), answers(crates)
    sorting = [item for item in crates if not item.teaches]
    damaged = sum(item.damaged for item in sorting)
    return StudyReport(
        name="sorting",
        title="Sorting a mixed crate by rules (simulated)",
        provenance=(
            f"Simulated: {len(sorting)} items sorted, a quarter of them strangers; taught and "
            "measured as in `palpate study identify`. Right is where the rules would send the item "
            "if everything of it were known. " + squeeze_in_words(crates),
            f"Items per hour count {CARRY_S:g} s to bring and carry away an item and {TURN_S:g} s "
            "to turn it for another grasp: assumed, not simulated.",
            f"Pressed beyond their yield in up to {SORTED_GRASPS} grasps: {damaged} of "
            f"{len(sorting)} items.",
        ),
        tables=[_ways_table(found), *_bins_tables(found, book)],
        payload={
            "simulated": True,
            "carry_s": CARRY_S,
            "turn_s": TURN_S,
            "items": len(sorting),
            "damaged": damaged,
            "summary": [_summary(run) for run in found],
            "identify": summed(given),
            "against_lda": [
                row
                for level in dict.fromkeys(run.level for run in found)
                for row in against_lda(given, level)
            ],
        },
        figures={"sorting-purity": lambda: purity_figure([_summary(run) for run in found])},
    )


def _summary(run: Run) -> dict[str, Any]:
    one = run.score
    return {
        "level": run.level,
        "method": run.method,
        "items": one.items,
        "purity": one.purity,
        "left_over": one.left_over,
        "grasps_per_item": one.grasps_per_item,
        "items_per_hour": one.items_per_hour,
        "sorted_right_per_hour": one.items_per_hour * (1 - one.left_over) * (one.purity or 0.0),
        "bins": {name: list(counts) for name, counts in one.bins.items()},
    }


def _ways_table(found: Sequence[Run]) -> Table:
    rows = []
    for run in found:
        row = _summary(run)
        rows.append(
            [
                run.level,
                run.method,
                "-" if row["purity"] is None else f"{100 * row['purity']:.0f}",
                f"{100 * row['left_over']:.0f}",
                f"{row['grasps_per_item']:.2f}",
                f"{row['items_per_hour']:.0f}",
                f"{row['sorted_right_per_hour']:.0f}",
            ]
        )
    return Table(
        title="Purity of what a rule put into a bin, and what it costs",
        columns=(
            "level",
            "method",
            "purity, %",
            "left for hand, %",
            "grasps per item",
            "items per hour",
            "of them right in a bin",
        ),
        rows=rows,
    )


def _bins_tables(found: Sequence[Run], book: RuleBook) -> list[Table]:
    tables = []
    for level in dict.fromkeys(run.level for run in found):
        mine = [run for run in found if run.level == level]
        rows = []
        for name in book.bins:
            cells = []
            for run in mine:
                count, right = run.score.bins.get(name, (0, 0))
                own = str(count) if name == book.default_bin else f"{right} of {count}"
                cells.append("-" if count == 0 else own)
            rows.append([name, *cells])
        tables.append(
            Table(
                title=f"Right, of all in each bin, {level}",
                columns=("bin", *(run.method for run in mine)),
                rows=rows,
            )
        )
    return tables
