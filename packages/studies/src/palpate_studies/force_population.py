"""Learn the population of `palpate.ForceLaw` that palpate ships from all real recordings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import typer

from palpate.files import atomic_path, check_writable
from palpate.force.force_law import Population, load_population
from palpate_studies import force_ladders as ladder_study
from palpate_studies import presses as press_study
from palpate_studies import strokes as stroke_study
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.press_data import read_presses
from palpate_studies.report import StudyReport, Table, as_command

Contact = TypeVar("Contact")

#: Factor on the spread of gain and slope (guess): three ladders are too few to show the spread of
#: sensors, and sheets of other manufacturers are calibrated too.
_WIDER = 2.0

#: Training contacts per kind of recording, evenly over the file, so that all kinds count equally.
_CONTACTS = 200


def report(
    *,
    strokes: Annotated[Path, typer.Option(help="Touches with a load cell.", metavar="CSV")],
    presses: Annotated[Path, typer.Option(help="Presses with a load cell.", metavar="CSV")],
    ladders: Annotated[Path, typer.Option(help="Ladders of weights.", metavar="CSV")],
    write: Annotated[
        Path | None, typer.Option(help="Write the population for palpate.", metavar="JSON")
    ] = None,
) -> StudyReport:
    """Learn the population of the force law and compare it with the shipped one.

    Example: palpate study force-population --strokes s.csv.gz --presses p.csv.gz --ladders l.csv
    """
    if write is not None:
        check_writable(write)
    touches = [one for one in stroke_study.read_strokes(strokes) if one.scored.sum() > 1]
    weights = [ladder_study.make_known_contact(one) for one in ladder_study.read_ladders(ladders)]
    parts: dict[str, Sequence[KnownContact]] = {
        "strokes": [stroke_study.make_known_contact(one) for one in _sample_evenly(touches)],
        "presses": [
            press_study.make_known_contact(one) for one in _sample_evenly(read_presses(presses))
        ],
        # Repeated: few ladders exist, but only they contain settled readings.
        "ladders": [
            replace(one, place=f"{one.place}-{number}")
            for number in range(max(_CONTACTS // len(weights), 1))
            for one in weights
        ],
    }
    population = learn_population([one for part in parts.values() for one in part])
    factor = np.ones(len(population.mean))
    factor[:2] = _WIDER
    population = replace(population, spread=population.spread * np.outer(factor, factor))
    if write is not None:
        with atomic_path(write) as partial:
            partial.write_text(_population_json(population))
    shipped = load_population()
    rows = [
        {
            "weight": place,
            "mean": float(population.mean[place]),
            "spread": float(np.sqrt(population.spread[place, place])),
            "contact_spread": float(np.sqrt(population.contact_spread[place, place])),
            "shipped_mean": float(shipped.mean[place]),
        }
        for place in range(len(population.mean))
    ]
    counts = ", ".join(f"{len(part)} {name}" for name, part in parts.items())
    return StudyReport(
        name="force-population",
        title="Population of the force law over real Velostat sensors",
        provenance=(
            f"Real recordings with a load cell or dead weights: {counts}. Weights of standardised "
            "inputs, ln N; `spread` is over places and sensors, `contact_spread` from contact to "
            "contact.",
        ),
        tables=[Table.of("Weights of the force law", rows)],
        payload={
            "rows": rows,
            "contacts": {name: len(part) for name, part in parts.items()},
        },
    )


command = as_command(report)


def _sample_evenly(contacts: Sequence[Contact]) -> Sequence[Contact]:
    return contacts[:: max(len(contacts) // _CONTACTS, 1)]


def _population_json(population: Population) -> str:
    rounded = {
        name: np.round(values, 7).tolist() if name != "least_n" else round(values, 3)
        for name, values in population.as_dict().items()
    }
    rows = [f' "{name}": {json.dumps(values)}' for name, values in rounded.items()]
    return "{\n" + ",\n".join(rows) + "\n}\n"
