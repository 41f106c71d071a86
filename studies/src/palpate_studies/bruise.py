"""How surely bruised apples differ from sound ones, by every way on the same simulated grasps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
import typer

from palpate.produce.bruise.model import BruiseModel, default_model
from palpate_studies.bruise_data import (
    EARLY_S,
    PLACED_WITHIN_MM,
    REFERENCE_APPLES,
    SIDES_AROUND,
    Examined,
    as_drawn,
    examine,
)
from palpate_studies.bruise_scores import (
    CHANGE,
    EARLIER,
    FALSE_ALARMS,
    FIRST_MET,
    KIND,
    SAME_WIDTH,
    THRESHOLD,
    TREES,
    Scored,
    area_lost,
    around,
    felt_of,
    locate,
    log_odds,
    models_of,
    score_all,
    scored,
    way,
)
from palpate_studies.other_fruit import corky
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_apple import Apple

#: Edges of the classes of bruises by diameter, mm.
_DIAMETERS_MM = (4.0, 7.0, 11.3, 15.0, 20.0, 30.0)
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
        "small": apples // 7,
        "off": apples // 7,
        "around": max(apples // 10, 8),
    }
    return judge(examine(purposes, levels=LEVELS, seed=seed))


command = as_command(report)


def judge(examined: Sequence[Examined]) -> StudyReport:
    """Score everything and put it into tables."""
    counts, ways, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
    sizes, beyond, places = (dict[str, Any]() for _ in range(3))
    models = dict[str, BruiseModel]()
    for level in LEVELS:
        of = {
            purpose: [one for one in examined if (one.purpose, one.level) == (purpose, level)]
            for purpose in dict.fromkeys(one.purpose for one in examined)
        }
        by_cutoff = models_of(of["learn"], level=level)
        models[level] = by_cutoff[EARLY_S]
        scores = score_all(of["test"], by_cutoff, learned=of["learn"])
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
                **area_lost(scores[way(names, EARLY_S)], scores[rival]).to_dict(),
            }
            for names, label in SHOWN.items()
            for rival in (THRESHOLD, CHANGE, SAME_WIDTH, TREES[names])
        ]
        sizes[level] = by_size(of, models[level])
        beyond[level] = beyond_touch(of, models[level])
        places[level] = locate(of["test"], models[level])
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
            "A first look, five grasps around apples bruised anywhere on a belt of 20 mm, found "
            "one bruise in two never touched: a round, firm fruit touches a finger over some "
            "10 mm. So the side in question is presented here, and the belt is reported apart.",
        ],
        tables=_tables(ways, sizes, beyond, places),
        payload={
            "study": "bruise",
            "origin": "twin",
            "apples": counts,
            "ways": ways,
            "compared": compared,
            "by_diameter": sizes,
            "beyond": beyond,
            "places": places,
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
            "`palpate_studies.other_fruit`, fixed before anything was scored on it; the model that "
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


def by_size(
    of: Mapping[str, Sequence[Examined]], model: BruiseModel
) -> dict[str, list[dict[str, float]]]:
    """Score bruises by their diameter against the sound apples of the test."""
    sound = [one for one in of["test"] if not one.bruised]
    bruised = [one for one in (*of["small"], *of["test"]) if one.bruised]
    diameter_mm = np.array([one.apple.bruise.diameter_mm for one in bruised if one.apple.bruise])
    found, felt = {}, felt_of([*sound, *bruised])
    for names, label in SHOWN.items():
        score, rows = log_odds(felt, model, names), []
        for low, high in pairwise(_DIAMETERS_MM):
            inside = (diameter_mm >= low) & (diameter_mm < high)
            if inside.any():
                chosen = Scored(
                    bruised=np.repeat([False, True], [len(sound), int(inside.sum())]),
                    score=np.concatenate([score[: len(sound)], score[len(sound) :][inside]]),
                    sensors=(),
                )
                rows.append(
                    {
                        "from_mm": low,
                        "to_mm": high,
                        "bruises": int(inside.sum()),
                        "auc": chosen.auc,
                        "found": chosen.found(),
                    }
                )
        found[label] = rows
    return found


def beyond_touch(
    of: Mapping[str, Sequence[Examined]], model: BruiseModel
) -> dict[str, dict[str, float]]:
    """Score what the fingers hardly touch: bruises off the belt, and sides nobody pointed at."""
    off = [*(one for one in of["test"] if not one.bruised), *of["off"]]
    found = {
        "12 to 25 mm above the middle, with its earlier record": scored(
            off, log_odds(felt_of(off), model, EARLIER)
        ),
        f"anywhere on a belt of 20 mm, first met, {SIDES_AROUND} grasps around": around(
            of["around"], model
        ),
    }
    return {name: {"auc": one.auc, "found": one.found()} for name, one in found.items()}


def _tables(
    ways: Mapping[str, Any],
    sizes: Mapping[str, Any],
    beyond: Mapping[str, Any],
    places: Mapping[str, Any],
) -> list[Table]:
    """Return the tables of every way, of bruises by size, and of what is missed."""

    def area(row: Mapping[str, Any]) -> str:
        between = "" if row["interval"] is None else " ({:.3f} to {:.3f})".format(*row["interval"])
        return f"{row['auc']:.3f}{between}"

    each = [
        {"level": level, "way": name, **one, "area": area(one)}
        for level in LEVELS
        for name, one in ways[level].items()
    ]
    by_diameter = [
        {"level": level, "way": label, **row}
        for label in SHOWN.values()
        for level in LEVELS
        for row in sizes[level][label]
    ]
    missed = [
        {"level": level, "what": name, "text": "AUC {auc:.3f}, found {found:.0%}".format(**one)}
        for level in LEVELS
        for name, one in beyond[level].items()
    ]
    # Too few to learn from name no places.
    missed += [
        {"level": level, "what": what, "text": text.format(**places[level])}
        for level in LEVELS
        if places[level]
        for what, text in (
            ("finger named rightly", "{finger_right:.0%}"),
            (
                "place on that finger, median off (off if its middle is named)",
                "{median_off_mm:.1f} mm ({median_spread_mm:.1f} mm)",
            ),
        )
    ]
    return [
        Table.wide(
            "Bruised or not, from one grasp of the side: area under the ROC curve (90 % interval "
            f"over sensors), and percent found at {100 * FALSE_ALARMS:g} % false alarms",
            each,
            {"way": "{way}"},
            over="level",
            form="{area}, {found:.0p}",
        ),
        Table.of(
            "By diameter of the bruise (below 11.3 mm: smaller than what was learned from)",
            by_diameter,
            {
                "way": "{way}",
                "diameter, mm": "{from_mm:g} to {to_mm:g}",
                "level": "{level}",
                "bruises": "{bruises}",
                "AUC": "{auc:.3f}",
                "found, %": "{found:.0p}",
            },
        ),
        Table.wide(
            "Bruises that the fingers may not touch, and where those that they touch are",
            missed,
            {"what": "{what}"},
            over="level",
            form="{text}",
        ),
    ]
