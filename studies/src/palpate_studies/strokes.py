"""Force of real touches: up, held, down, by sensors that the models have not seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_studies.protocol.paired import compare
from palpate_studies.recordings import leave_out
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group
from palpate_studies.stroke_models import (
    LEVEL,
    MODELS,
    SMALLEST_N,
    TOLD,
    Mask,
    Others,
    Touch,
    others_of,
    read_strokes,
)

PHASES = ("loading", "holding", "unloading")
#: Name of a band of force -> its ends, newtons.
BANDS = {"0.5-2": (0.5, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}

Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """A model's answers on the scored samples of one touch; arrays of shape (n_scored,)."""

    model: str
    told: str
    touch: Touch
    log_force: FloatArray
    error: FloatArray
    covered: Mask
    phase: NDArray[np.str_]


def report(
    *,
    recordings: Annotated[
        Path, typer.Option(help="Recordings of touches to learn from.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(
            help="Recordings to follow; without, each sensor in turn is left out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Follow the force of real touches from resistance, with and without a measured force.

    Example: palpate study strokes --recordings velostat_strokes.csv.gz
    """
    touches = read_strokes(recordings)
    if test_recordings is None:
        splits, how = leave_out(touches, lambda one: one.sensor), "each sensor in turn left out"
        if len(splits) < 2:
            raise InputError(
                f"{recordings}: one sensor, nothing to learn from when it is left out; "
                "give --test-recordings"
            )
    else:
        splits = [("", touches, read_strokes(test_recordings))]
        how = f"learned from, {test_recordings} followed"
    scored = [one for _, train, tested in splits for one in _score(train, tested)]
    summary = _summary(scored)
    columns = {"all": ("all", "all"), "unloading": ("unloading", "all")}
    columns |= {f"{band} N": ("all", band) for band in BANDS}
    names = {place: head for head, place in columns.items()}
    return StudyReport(
        name="strokes",
        title="Force of real Velostat under short touches",
        provenance=(
            f"Real recordings with a load cell, {len(touches)} touches, {how}. "
            f"Samples of {SMALLEST_N:g} N and more; medians over samples.",
            "`ours` is `palpate.ForceLaw`, its population learned from the training touches. "
            "`place`: the other attempts at the place are known, force and reading. A static law "
            "takes its gain from them, `ours` a law of the place, the clock their usual "
            "force at each time. `five_percent`, `eighty_percent`: the force is measured once, on "
            "the way up; later samples are scored.",
            "`constant` and `clock` read no sensor. The touches are alike in time, which helps a "
            "clock, trees and the force law alike; unloading and small forces show what the "
            "sheet adds.",
        ),
        tables=[
            Table.wide(
                "Sensor left out, median |error of ln force| (coverage)",
                [
                    row | {"part": names[row["phase"], row["band"]]}
                    for row in summary
                    if (row["phase"], row["band"]) in names
                ],
                {"known": "{told}", "model": "{model}"},
                over="part",
                form="{median_abs_log_error:.3f} ({coverage:.2f})",
            )
        ],
        payload={
            "study": "strokes",
            "rows": _rows(scored),
            "summary": summary,
            "compared": _compared(scored),
            "level": LEVEL,
        },
    )


command = as_command(report)


def _score(train: Others, tested: Others) -> Iterator[Scored]:
    """Yield the answers of every model on the tested touches."""
    for told in TOLD:
        if told == "place" and not (_are_repeated(train) and _are_repeated(tested)):
            continue
        for model, learn in MODELS.items():
            follow = learn(train, told)
            for touch in tested:
                used, others = touch.after(told), others_of(touch, tested)
                if not used.any() or (told == "place" and not others):
                    continue
                value, half = follow(touch, others)
                error = np.abs(value - touch.log_force)[used]
                yield Scored(
                    model=model,
                    told=told,
                    touch=touch,
                    log_force=touch.log_force[used],
                    error=error,
                    covered=error <= half[used],
                    phase=touch.phase[used],
                )


def _are_repeated(touches: Others) -> bool:
    """Whether some place was touched more than once."""
    return len({one.place for one in touches}) < len(touches)


def _rows(scored: Sequence[Scored]) -> Rows:
    """Return medians over the samples of each touch, by phase and by band of force."""
    rows: Rows = []
    for one in scored:
        force_n = np.exp(one.log_force)
        for phase in PHASES:
            for band, (low, high) in BANDS.items():
                mine = (one.phase == phase) & (force_n >= low) & (force_n < high)
                if mine.any():
                    rows.append(
                        {
                            "recording_id": one.touch.recording_id,
                            "touch": one.touch.touch,
                            "model": one.model,
                            "told": one.told,
                            "phase": phase,
                            "band": band,
                            **_figures(one.error[mine], one.covered[mine]),
                        }
                    )
    return rows


def _summary(scored: Sequence[Scored]) -> Rows:
    """Return medians over samples of all sensors, by phase and by band of force."""
    summary: Rows = []
    for key, mine in group(scored, "model", "told"):
        error, covered, phases, log_force = (
            np.concatenate([getattr(one, name) for one in mine])
            for name in ("error", "covered", "phase", "log_force")
        )
        force_n = np.exp(log_force)
        for phase in ("all", *PHASES):
            for band, (low, high) in {"all": (0.0, np.inf), **BANDS}.items():
                here = (force_n >= low) & (force_n < high)
                here &= (phases == phase) | (phase == "all")
                if here.any():
                    summary.append(
                        {
                            **key,
                            "phase": phase,
                            "band": band,
                            **_figures(error[here], covered[here]),
                        }
                    )
    return summary


def _figures(error: FloatArray, covered: Mask) -> dict[str, Any]:
    return {
        "samples": len(error),
        "median_abs_log_error": round(float(np.median(error)), 5),
        "coverage": round(float(np.mean(covered)), 5),
    }


def _compared(scored: Sequence[Scored]) -> Rows:
    """Return the error of ours less that of each other model, by pin of a sensor."""
    rows: Rows = []
    for key, some in group(scored, "told"):
        for phase in ("all", "unloading"):
            lost: dict[str, FloatArray] = {}
            for name, mine in group(some, "model"):
                chosen = [one.error[(one.phase == phase) | (phase == "all")] for one in mine]
                lost[name["model"]] = np.concatenate(chosen)
            pins = [
                f"{one.touch.sensor}-{one.touch.pin}"
                for one in some
                if one.model == "ours"
                for _ in range(int(np.sum((one.phase == phase) | (phase == "all"))))
            ]
            rows += compare(lost, pins, **key, phase=phase)
    return rows
