"""How surely bruised apples differ from sound ones, by every way on the same simulated grasps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
import typer

from palpate.produce.bruise.model import BruiseModel, default_model
from palpate_studies.bruise_data import (
    PLACED_WITHIN_MM,
    REFERENCE_APPLES,
    Examined,
    as_drawn,
    examine,
)
from palpate_studies.bruise_scores import (
    EARLIER,
    FALSE_ALARMS,
    FIRST_MET,
    KIND,
    SAME_WIDTH,
    TREES,
    area_lost,
    felt_of,
    log_odds,
    model_of,
    score_all,
    scored,
    way,
)
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.fruit import corky
from palpate_studies.twin_apple import Apple

#: What is shown of ours: against which references, and in words.
SHOWN = {KIND: "ours, first met, 2.5 s", EARLIER: "ours, with its earlier record, 2.5 s"}


def report(
    *,
    apples: Annotated[
        int, typer.Option(help="Apples tested on each level; 500 for figures to rely on.", min=24)
    ] = 48,
    seed: Annotated[int, typer.Option(help="Seed of apples and sensors.", min=0)] = 1,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp many sound and bruised apples on the twin, and tell them apart in every way.

    With --out, the model learned at each level is written too. --second judges bruises of another
    shape, and the same apples of the first, by the model that palpate ships; two dozen on a sensor.

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
    counts, ways, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
    models = dict[str, BruiseModel]()
    for level in LEVELS:
        of = {
            purpose: [one for one in examined if (one.purpose, one.level) == (purpose, level)]
            for purpose in dict.fromkeys(one.purpose for one in examined)
        }
        models[level] = model_of(of["learn"], level=level)
        scores = score_all(of["test"], models[level], learned=of["learn"])
        counts[level] = {purpose: len(mine) for purpose, mine in of.items()}
        ways[level] = {
            name: {"auc": one.auc, "interval": one.interval(), "found": one.found()}
            for name, one in scores.items()
        }
        compared += [
            {
                "level": level,
                "ours": label,
                "rival": rival,
                **area_lost(scores[way(names)], scores[rival]).to_dict(),
            }
            for names, label in SHOWN.items()
            for rival in (SAME_WIDTH, TREES[names])
        ]
    return StudyReport(
        name="bruise",
        title="Bruised and sound apples (simulated)",
        provenance=[
            f"Simulated, both levels: {counts['lab']['test']} apples tested and "
            f"{counts['lab']['learn']} others, on other sensors, learned from, half of them "
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
                    for level in LEVELS
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
            f"bruise-model-{level}.json": partial(_save, model) for level, model in models.items()
        },
    )


def second_report(seeds: Sequence[int]) -> StudyReport:
    """Judge the same apples of both generators by the model that palpate ships."""
    remakes: dict[str, Callable[[Apple], Apple]] = {"first": as_drawn, "second": corky}
    rows = [
        {"generator": name, **_shipped([one for seed in seeds for one in _apples(seed, remade)])}
        for name, remade in remakes.items()
    ]
    return StudyReport(
        name="bruise",
        title="Bruises of another shape (simulated)",
        provenance=(
            "Simulated, at level lab. The second generator is described in "
            "`palpate_studies.second.fruit`, fixed before it was scored; the model that "
            "palpate ships was learned on the first.",
        ),
        tables=[
            Table.of(
                "Bruised or sound: area under the ROC curve",
                rows,
                {
                    "generator": "{generator}",
                    "apples": "{apples}",
                    "ours, earlier record": "{area_with_an_earlier_record:.2f}",
                    "ours, first met": "{area_first_met:.2f}",
                    "the paper's way": "{area_the_papers_way:.2f}",
                },
            )
        ],
        payload={"study": "bruise", "simulated": True, "bruise": rows},
    )


def _apples(seed: int, remade: Callable[[Apple], Apple]) -> list[Examined]:
    return list(examine({"test": 24}, levels=["lab"], seed=seed, remade=remade))


def _shipped(found: Sequence[Examined]) -> dict[str, Any]:
    felt, model = felt_of(found), default_model()
    change = [
        one.presses["same_width"].mean_percent - one.presses["before"].mean_percent for one in found
    ]
    scores = {
        "with_an_earlier_record": log_odds(felt, model, EARLIER),
        "first_met": log_odds(felt, model, FIRST_MET),
        "the_papers_way": np.array(change),
    }
    each = {name: scored(found, score) for name, score in scores.items()}
    return {
        "apples": len(found),
        "sensors": len({one.sensor for one in found}),
        **{f"area_{name}": one.auc for name, one in each.items()},
        "lost_less_the_papers_way": area_lost(
            each["with_an_earlier_record"], each["the_papers_way"]
        ).to_dict(),
    }


def _save(model: BruiseModel, path: Any) -> None:
    model.save(path)
