"""Ripening and bruises on a generator that no estimator was written for, and on the first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.produce.bruise.model import default_model
from palpate_studies.baselines.ripeness_learners import STAGE_LEARNERS
from palpate_studies.bruise_data import Examined, as_drawn, examine
from palpate_studies.bruise_scores import (
    EARLIER,
    FIRST_MET,
    area_lost,
    felt_of,
    log_odds,
    scored,
)
from palpate_studies.other_fruit import WAYS, corky, other_avocado
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.ripeness_virtual import VirtualDay, judged_days
from palpate_studies.twin_apple import Apple
from palpate_studies.twin_avocado import Avocado

#: Seeds of the final look. Virtual sensors 0 to 2 were used while this was made; no apples were.
#: Virtual sensors 94_001 to 94_004 were looked at before learners were rivals.
RIPENESS_SEED, BRUISE_SEED = 94_101, 70
#: Apples on each sensor.
APPLES = 24
FIRST, SECOND = "first", "second"
APPLE_WAYS: dict[str, Callable[[Apple], Apple]] = {FIRST: as_drawn, SECOND: corky}


def command(
    sensors: Annotated[int, typer.Option(help="Virtual sensors that judge avocados.", min=1)] = 4,
    fruits: Annotated[int, typer.Option(help="Avocados on each of them.", min=2)] = 30,
    apple_sensors: Annotated[
        int,
        typer.Option(help="Sensors on the twin that judge two dozen apples each.", min=0),
    ] = 3,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Judge fruit that ripens, and bruises that look, unlike those the rules were made on.

    Example: palpate study second-generators --out reports
    """
    ripening = {
        name: [
            day
            for sensor in range(RIPENESS_SEED, RIPENESS_SEED + sensors)
            for day in judged_days(make, sensor=sensor, fruits=fruits)
        ]
        for name, make in ripening_ways().items()
    }
    bruised = {
        name: [
            one
            for seed in range(BRUISE_SEED, BRUISE_SEED + apple_sensors)
            for one in examine({"test": APPLES}, levels=["lab"], seed=seed, remade=remade)
        ]
        for name, remade in APPLE_WAYS.items()
        if apple_sensors
    }
    report(ripening, bruised).emit(as_json=as_json, out=out)


def ripening_ways() -> dict[str, Callable[[Avocado, int], Avocado]]:
    """Return how each generator makes its fruit out of the first generator's."""
    found: dict[str, Callable[[Avocado, int], Avocado]] = {FIRST: lambda fruit, number: fruit}
    for way in WAYS:
        found[way] = _always(way)
    found["all three"] = lambda fruit, number: other_avocado(fruit, way=WAYS[number % len(WAYS)])
    return found


def _always(way: str) -> Callable[[Avocado, int], Avocado]:
    return lambda fruit, number: other_avocado(fruit, way=way)


def report(
    ripening: Mapping[str, Sequence[VirtualDay]], bruised: Mapping[str, Sequence[Examined]]
) -> StudyReport:
    """Score both and compare them with the first generator."""
    ripe = [{"generator": name, **_ripe(days)} for name, days in ripening.items()]
    apples = [{"generator": name, **_bruised(found)} for name, found in bruised.items()]
    return StudyReport(
        name="second-generators",
        title="Ripening and bruises of another shape (simulated)",
        provenance=(
            "Simulated. The second generators are described in `palpate_studies.other_fruit`, "
            "fixed before anything was scored on them.",
            "Ripening: virtual sensors, whose errors are as large as the twin's were on "
            "development sensors; no grasp is simulated. Each rule is taught with labelled fruit "
            "of the generator that it judges.",
            "Bruises: grasps on the twin at level lab, judged by the model that palpate ships, "
            "which was learned on the first generator. The same apples, sides and sensors.",
        ),
        tables=[_ripe_table(ripe), *([_bruise_table(apples)] if apples else [])],
        payload={
            "study": "second-generators",
            "simulated": True,
            "seeds": {"ripeness": RIPENESS_SEED, "bruise": BRUISE_SEED},
            "ripeness": ripe,
            "bruise": apples,
        },
    )


def _ripe(days: Sequence[VirtualDay]) -> dict[str, Any]:
    covered = [day.covered for day in days if day.covered is not None]
    return {
        "fruit_days": len(days),
        "exact": float(np.mean([day.exact for day in days])),
        "exact_one_day": float(np.mean([day.exact_one_day for day in days])),
        "coverage": float(np.mean(covered)),
        "waiting_days": len(covered),
        "exact_learned": {
            learner: float(np.mean([day.exact_learned[learner] for day in days]))
            for learner in STAGE_LEARNERS
        },
        "wrong_less_one_day": _wrong_less(days, [day.exact_one_day for day in days]),
        "wrong_less_learned": {
            learner: _wrong_less(days, [day.exact_learned[learner] for day in days])
            for learner in STAGE_LEARNERS
        },
    }


def _wrong_less(days: Sequence[VirtualDay], rival_exact: Sequence[bool]) -> dict[str, Any]:
    """Return the share of wrong stages of ours less that of a rival, by fruit."""
    return paired_difference(
        [float(not day.exact) for day in days],
        [float(not exact) for exact in rival_exact],
        [day.fruit for day in days],
        statistic=np.mean,
    ).to_dict()


def _bruised(found: Sequence[Examined]) -> dict[str, Any]:
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


def _ripe_table(rows: Sequence[dict[str, Any]]) -> Table:
    return Table(
        title="Stage of four exact, %; interval of the days to ripe (0.9)",
        columns=(
            "generator",
            "fruit days",
            "ours",
            "that day alone",
            *STAGE_LEARNERS.values(),
            "wrong: ours less that day alone, points (90 %)",
            "who errs less",
            "coverage, %",
        ),
        rows=[
            (
                row["generator"],
                str(row["fruit_days"]),
                f"{100 * row['exact']:.1f}",
                f"{100 * row['exact_one_day']:.1f}",
                *(f"{100 * row['exact_learned'][learner]:.1f}" for learner in STAGE_LEARNERS),
                "{:+.1f} ({:+.1f} to {:+.1f})".format(
                    *(100 * row["wrong_less_one_day"][key] for key in ("difference", "low", "high"))
                ),
                row["wrong_less_one_day"]["verdict"].replace("rival", "that day alone"),
                f"{100 * row['coverage']:.0f}",
            )
            for row in rows
        ],
    )


def _bruise_table(rows: Sequence[dict[str, Any]]) -> Table:
    names = {
        "area_with_an_earlier_record": "ours, earlier record",
        "area_first_met": "ours, first met",
        "area_the_papers_way": "the paper's way",
    }
    return Table(
        title="Bruised or sound: area under the ROC curve",
        columns=("generator", "apples", *names.values()),
        rows=[
            (row["generator"], str(row["apples"]), *(f"{row[key]:.2f}" for key in names))
            for row in rows
        ],
    )
