"""The main job on things that no estimator was written for, and on those of the main study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from palpate.commands.options import JsonOption
from palpate.estimate.damage_learning import FruitClosing, copies, read_closings
from palpate.twin.objects import TwinObject
from palpate_studies.grasp_cycle import KINDS, LEVELS, answers, as_row, scores, times
from palpate_studies.grasp_cycles import Cycle, Sample, ours
from palpate_studies.other_things import dough, foam, layered, long_enough, recorded
from palpate_studies.report import OutOption, StudyReport

#: Seed of the first object of the final look; the controller saw none of these forms before.
FIRST_SEED = 4_700_000
FORMS: dict[str, Callable[[TwinObject], TwinObject]] = {
    "as drawn": lambda thing: thing,
    "layered": layered,
    "foam": foam,
    "dough": dough,
}


def command(
    grasps: Annotated[int, typer.Option(help="Of each form, hand and level.", min=1)] = 25,
    data: Annotated[
        Path | None,
        typer.Option(help="Folder of recorded closings, for real fruit.", metavar="DIR"),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Grasp simulated things of unforeseen forms, and with the recorded curves of real fruit.

    Example: palpate study grasp-forms --data recordings --out reports
    """
    fruit = list[FruitClosing]()
    if data is not None:
        closings = read_closings(data / "fruit_rupture.csv.gz", data / "fruit_rupture_index.csv")
        copied = copies(closings)
        fruit = long_enough([one for one in closings if one.grasp_id not in copied])
    report(grasps, fruit=fruit).emit(as_json=as_json, out=out)


def report(
    grasps: int, *, fruit: Sequence[FruitClosing] = (), first_seed: int = FIRST_SEED
) -> StudyReport:
    """Make the grasps and report them, a row for each form, hand and level.

    Parameters
    ----------
    grasps : int
        Of each form, hand and level.
    fruit : sequence of FruitClosing
        Recorded closings; each is taken in turn.
    first_seed : int
        The same things stand behind all drawn forms.
    """
    found = dict[tuple[str, str, str], list[Cycle]]()
    for level, kind, number in product(LEVELS, KINDS, range(grasps)):
        sample = Sample(seed=first_seed + number, level=level, kind=kind)
        ways = dict(FORMS)
        if fruit:
            ways["real fruit"] = partial(recorded, closing=fruit[number % len(fruit)])
        for form, way in ways.items():
            cycle = ours(replace(sample, made=way(sample.obj())))
            found.setdefault((level, kind, form), []).append(cycle)
    summary = [
        {"level": level, "hand": kind, "way": form, **scores(cycles)}
        for (level, kind, form), cycles in found.items()
    ]
    return StudyReport(
        name="grasp-forms",
        title="A gentle grasp of things of other forms (simulated)",
        provenance=[
            "Simulated at 15 frames/s, default settings. Layered: a skin on flesh a third as "
            "stiff, and a core. Foam: force as deformation to the power of 2.5. Dough: loses half "
            "of its force, most of it within a tenth of a second.",
            "Real fruit: the recorded force over closure of bananas, kiwis and mangos in another "
            "robot's hand, whose give is in them, up to where each ruptured; sheet, fingers and "
            "servo are the twin's.",
        ],
        tables=[times(summary), answers(summary)],
        payload={
            "study": "grasp-forms",
            "origin": "twin",
            "summary": summary,
            "grasps": [
                {"form": form, **as_row(cycle)}
                for (_, _, form), cycles in found.items()
                for cycle in cycles
            ],
        },
    )
