"""Newtons from a sensor given three spread weights: real ladders of dead weights on Velostat."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.strict import read_table
from palpate_studies.ladder_models import MODELS, Ladder, Predicted
from palpate_studies.report import StudyReport, Table, as_command

#: Loads at which a test ladder is given its own steps, newtons: spread over the working range. The
#: first weights of a ladder lie at the threshold of contact, where they show little.
GIVEN_N = (1.5, 4.0, 9.0)
#: Fewer loaded steps than this show no law.
MIN_STEPS = 5
#: Loads up to this are not scored.
SMALLEST_LOAD_N = 0.5
#: Forces below this count as this: no load at all would be an infinite error of the logarithm.
FLOOR_N = 0.05
LEVEL = 0.9

#: Figure of a model -> its head.
FIGURES = {
    "median_abs_error_percent": "error %",
    "median_abs_log_ratio": "abs ln ratio",
    "coverage": "coverage",
}

Rows: TypeAlias = list[dict[str, Any]]


def report(
    *,
    ladders: Annotated[Path, typer.Option(help="Ladders of weights to learn from.", metavar="CSV")],
    test_ladders: Annotated[
        Path | None,
        typer.Option(help="Ladders to predict; without, each in turn is left out.", metavar="CSV"),
    ] = None,
) -> StudyReport:
    """Predict dead weights on real sensors, each given those nearest to 1.5, 4 and 9 N.

    Example: palpate study force-ladders --ladders ladders.csv
    """
    known, rows = read_ladders(ladders), list[dict[str, Any]]()
    for one in read_ladders(test_ladders) if test_ladders else known:
        others = [ladder for ladder in known if ladder.name != one.name]
        if not others:
            raise InputError(f"{ladders}: no ladder other than {one.name!r} to learn from; add one")
        rows += _rows(one, others, given=_nearest(one.load_n))
    summary = [
        {"ladder": ladder, "model": model, **_scores(mine)}
        for ladder, model in dict.fromkeys((row["ladder"], row["model"]) for row in rows)
        for mine in [[row for row in rows if (row["ladder"], row["model"]) == (ladder, model)]]
    ]
    means = [
        {"model": model, **{key: float(np.mean([one[key] for one in mine])) for key in FIGURES}}
        for model in MODELS
        for mine in [[one for one in summary if one["model"] == model]]
    ]
    return StudyReport(
        name="force-ladders",
        title="Dead weights on real Velostat",
        provenance=(
            "Real recordings. A ladder is never learned from when it is predicted, apart from its "
            "steps nearest to 1.5, 4 and 9 N, which are not scored.",
            f"Loads above {SMALLEST_LOAD_N} N; intervals at level {LEVEL}. "
            f"Predictions below {FLOOR_N} N count as {FLOOR_N} N in ratios.",
        ),
        tables=[
            Table.of(
                "New sensor, given three spread weights, medians",
                [*summary, *({"ladder": "mean of ladders", **mean} for mean in means)],
                {
                    "ladder": "{ladder}",
                    "model": "{model}",
                    **{head: f"{{{key}:.3g}}" for key, head in FIGURES.items()},
                },
            )
        ],
        payload={
            "study": "force-ladders",
            "rows": rows,
            "summary": summary,
            "means": means,
            "rest_ohm": {
                "sensors": len(known),
                "low": min(one.rest_ohm for one in known),
                "high": max(one.rest_ohm for one in known),
            },
            "level": LEVEL,
        },
    )


command = as_command(report)


def read_ladders(path: Path) -> list[Ladder]:
    """Read ladders `ladder,step,load_n,resistance_ohm`, in the order of the file.

    Raises
    ------
    InputError
        If the file can't be used, or a ladder has no unloaded step at its start or too few others.
    """
    table = read_table(
        path,
        columns={
            "ladder": "text",
            "step": "number",
            "load_n": "number",
            "resistance_ohm": "number",
        },
    )
    found = []
    for name in dict.fromkeys(table["ladder"].tolist()):
        mine = table["ladder"] == name
        step, load_n, ohm = (table[c][mine] for c in ("step", "load_n", "resistance_ohm"))
        where = f"{path}: ladder {name!r}"
        if (ohm <= 0).any() or (load_n < 0).any():
            raise InputError(f"{where} has a resistance of 0 ohm or a load below 0 N; fix it")
        if load_n[0] != 0:
            raise InputError(f"{where} doesn't begin unloaded; its rest resistance is unknown")
        loaded = load_n > 0
        if np.count_nonzero(loaded) < max(MIN_STEPS, len(GIVEN_N) + 2):
            raise InputError(f"{where} has fewer than {MIN_STEPS} loaded steps; add some")
        found.append(
            Ladder(
                name=name,
                step=step[loaded].astype(int),
                load_n=load_n[loaded],
                resistance_ohm=ohm[loaded],
                rest_ohm=float(ohm[0]),
            )
        )
    return found


def _nearest(load_n: FloatArray) -> NDArray[np.bool_]:
    """Return the steps whose loads are nearest to those given, each step once."""
    given = np.zeros(len(load_n), dtype=bool)
    for at_n in GIVEN_N:
        given[np.argmin(np.where(given, np.inf, np.abs(load_n - at_n)))] = True
    return given


def _rows(one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]) -> Rows:
    rows: Rows = []
    for name, predict in MODELS.items():
        answer: Predicted = predict(one, others, told=given, level=LEVEL)
        rows += [
            {
                "ladder": one.name,
                "model": name,
                "step": int(one.step[k]),
                "load_n": float(one.load_n[k]),
                "predicted_n": float(answer.value[k]),
                "low_n": float(answer.low[k]),
                "high_n": float(answer.high[k]),
            }
            for k in np.flatnonzero((one.load_n > SMALLEST_LOAD_N) & ~given)
        ]
    return rows


def _scores(rows: Rows) -> dict[str, float]:
    load, predicted, low, high = (
        np.array([row[key] for row in rows]) for key in ("load_n", "predicted_n", "low_n", "high_n")
    )
    return {
        "median_abs_error_percent": float(np.median(np.abs(predicted / load - 1)) * 100),
        "median_abs_log_ratio": float(
            np.median(np.abs(np.log(np.maximum(predicted, FLOOR_N) / load)))
        ),
        "coverage": float(np.mean((low <= load) & (load <= high))),
    }
