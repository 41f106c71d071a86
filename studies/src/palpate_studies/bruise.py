"""How surely bruised apples differ from sound ones, by every way on the same simulated grasps."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.files import atomic_path
from palpate.produce.bruise.model import BruiseModel, default_model, simulated_sides
from palpate.produce.learning import LabelledTable
from palpate_studies.bruise_data import (
    PLACED_WITHIN_MM,
    REFERENCE_APPLES,
    Examined,
    as_drawn,
    examine,
)
from palpate_studies.bruise_scores import FALSE_ALARMS, compare_all, known_of, score_all
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.fruit import corky, rotten
from palpate_studies.twin_apple import Apple

#: Digits of contrasts in the file of simulated sides.
_DIGITS = 3


def report(
    *,
    apples: Annotated[
        int, typer.Option(help="Apples tested on each level; 500 for figures to rely on.", min=24)
    ] = 48,
    seed: Annotated[int, typer.Option(help="Seed of apples and sensors.", min=0)] = 1,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp many sound and bruised apples on the twin, and tell them apart in every way.

    With --out, the sides learned from at each level are written too. --second judges bruises of
    another shape, rot, and the same apples of the first, two dozen on a sensor, by what the sides
    that palpate ships teach.

    Example: palpate study bruise --apples 96 --out reports
    """
    if second:
        return second_report(range(seed, seed + apples // 24))
    purposes = {
        "learn": max(2 * apples // 24 * 24, 48),
        "test": apples,
    }
    return judge(examine(purposes, levels=LEVELS, seed=seed))


command = as_command(report)


def judge(examined: Sequence[Examined]) -> StudyReport:
    """Score everything and put it into tables."""
    levels = list(dict.fromkeys(one.level for one in examined))
    counts, ways, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
    known = {}
    for level in levels:
        of = {
            purpose: [one for one in examined if (one.purpose, one.level) == (purpose, level)]
            for purpose in dict.fromkeys(one.purpose for one in examined)
        }
        sensors = len({one.sensor for one in of["learn"]})
        learned_on = (
            f"{len(of['learn'])} simulated apples on {sensors} simulated sensors, level {level}"
        )
        known[level] = known_of(of["learn"]), learned_on
        model = BruiseModel.learn(known[level][0], learned_on=learned_on)
        scores = score_all(of["test"], model, known=known[level][0])
        counts[level] = {purpose: len(mine) for purpose, mine in of.items()}
        ways[level] = {
            name: {"auc": one.auc, "interval": one.interval(), "found": one.found()}
            for name, one in scores.items()
        }
        compared += [{"level": level, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruised and sound apples (simulated)",
        provenance=[
            f"Simulated, each level: {counts[levels[0]]['test']} apples tested and "
            f"{counts[levels[0]]['learn']} others, on other sensors, learned from, half of them "
            f"bruised, each with its bruise within {PLACED_WITHIN_MM:g} mm of the middle of either "
            "finger; grasped once at the side in question, closed by contact. They differ in size, "
            "firmness, roundness, firmer sides; bruises in diameter, depth, softness, dent and "
            "place (ranges: `palpate_studies.fruit_ranges`).",
            f"References: class, {REFERENCE_APPLES} other sound apples on the same sensor; item, "
            "one grasp a quarter turn on; history, one earlier grasp of the same side, sound then.",
        ],
        tables=[
            Table.wide(
                "Bruised or not, from one grasp of the side: area under the ROC curve, and percent "
                f"found at {100 * FALSE_ALARMS:g} % false alarms",
                [
                    {"level": level, "way": name, **one}
                    for level in levels
                    for name, one in ways[level].items()
                ],
                {"way": "{way}"},
                over="level",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={
            "study": "bruise",
            "origin": "twin",
            "apples": counts,
            "ways": ways,
            "compared": compared,
        },
        files={
            f"bruise-sides-{level}.json": partial(save_sides, *sides)
            for level, sides in known.items()
        },
    )


def second_report(seeds: Sequence[int]) -> StudyReport:
    """Judge the same apples, bruised in two ways or rotten, by the model that palpate ships."""
    remakes: dict[str, Callable[[Apple], Apple]] = {
        "first": as_drawn,
        "second": corky,
        "rot": rotten,
    }
    rows, ways = list[dict[str, Any]](), list[dict[str, Any]]()
    _, known = simulated_sides()
    for name, remade in remakes.items():
        found = [one for seed in seeds for one in _apples(seed, remade)]
        scores = score_all(found, default_model(), known=known)
        counts = {"apples": len(found), "sensors": len({one.sensor for one in found})}
        ways += [
            {"generator": name, "way": way, **counts, "auc": one.auc, "found": one.found()}
            for way, one in scores.items()
        ]
        rows += [{"generator": name, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruises of another shape, and rot (simulated)",
        provenance=(
            "Simulated, at level lab. The second generator is described in "
            "`palpate_studies.second.fruit`, fixed before it was scored; the model that "
            "palpate ships was learned on the first.",
        ),
        tables=[
            Table.wide(
                "Bruised or sound: area under the ROC curve, and percent found at "
                f"{100 * FALSE_ALARMS:g} % false alarms",
                ways,
                {"way": "{way}"},
                over="generator",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={"study": "bruise", "simulated": True, "ways": ways, "compared": rows},
    )


def _apples(seed: int, remade: Callable[[Apple], Apple]) -> list[Examined]:
    return list(examine({"test": 24}, levels=["lab"], seed=seed, remade=remade))


def save_sides(known: Mapping[str, LabelledTable], learned_on: str, path: Path) -> None:
    """Write known sides as JSON, in the form of those that come with palpate."""
    document = {
        "learned_on": learned_on,
        "sides": {
            name: {"labels": table.labels, "contrasts": table.rows.round(_DIGITS).tolist()}
            for name, table in known.items()
        },
    }
    with atomic_path(path) as unfinished:
        unfinished.write_text(json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n")
