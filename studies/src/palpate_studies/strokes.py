"""Force of real touches: up, held, down, by sensors and pins that the models have not seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.stroke_data import SMALLEST_N, Mask, Touch, read_strokes
from palpate_studies.stroke_models import LEVEL, MODELS, TOLD, Others, others_of

PHASES = ("loading", "holding", "unloading")
#: Name of a band of force -> its ends, newtons.
BANDS = {"0.5-2": (0.5, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}
_TITLES = {"sensor": "Sensor left out", "pin": "Pin left out", "test": "Test recordings"}

Rows: TypeAlias = list[dict[str, Any]]
Split: TypeAlias = tuple[str, Others, Others]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """A model's answers on the scored samples of one touch; arrays of shape (n_scored,)."""

    split: str
    model: str
    told: str
    touch: Touch
    log_force: FloatArray
    error: FloatArray
    covered: Mask
    phase: NDArray[np.str_]


def command(
    recordings: Annotated[
        Path, typer.Option(help="Recordings of touches to learn from.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(
            help="Recordings to follow; without, each sensor in turn is left out.", metavar="CSV"
        ),
    ] = None,
    pins: Annotated[
        bool, typer.Option("--pins", help="Leave out each pin of a sensor instead.")
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Follow the force of real touches from resistance, with and without a measured force.

    Example: palpate study strokes --recordings velostat_strokes.csv.gz
    """
    if pins and test_recordings is not None:
        raise InputError("--pins leaves out pins of --recordings; drop it or --test-recordings")
    touches = read_strokes(recordings)
    splits: list[Split]
    if test_recordings is not None:
        splits = [("test", touches, read_strokes(test_recordings))]
    else:
        splits = [*(_pins_out(touches) if pins else _sensors_out(touches))]
    if not splits:
        raise InputError(
            f"{recordings}: one {'pin of each sensor' if pins else 'sensor'}, nothing to learn "
            "from when it is left out; give --test-recordings"
        )
    scored = [one for split in splits for one in _scores(split)]
    _report(scored, touches=len(touches)).emit(as_json=as_json, out=out)


def _sensors_out(touches: Others) -> Iterator[Split]:
    """Yield each sensor with the others to learn from."""
    sensors = list(dict.fromkeys(one.sensor for one in touches))
    for sensor in sensors if len(sensors) > 1 else []:
        mine = [one for one in touches if one.sensor == sensor]
        yield "sensor", [one for one in touches if one.sensor != sensor], mine


def _pins_out(touches: Others) -> Iterator[Split]:
    """Yield each pin with the other pins of its sensor to learn from."""
    for sensor in dict.fromkeys(one.sensor for one in touches):
        mine = [one for one in touches if one.sensor == sensor]
        pins = list(dict.fromkeys(one.pin for one in mine))
        for pin in pins if len(pins) > 1 else []:
            inside = [one for one in mine if one.pin != pin]
            yield "pin", inside, [one for one in mine if one.pin == pin]


def _scores(split: Split) -> Iterator[Scored]:
    name, train, tested = split
    for told in TOLD:
        for model, learn in MODELS.items():
            follow = learn(train, told)
            for touch in tested:
                used, others = touch.after(told), others_of(touch, tested)
                if not used.any() or (told == "place" and not others):
                    continue
                value, half = follow(touch, others)
                error = np.abs(value - touch.log_force)[used]
                yield Scored(
                    split=name,
                    model=model,
                    told=told,
                    touch=touch,
                    log_force=touch.log_force[used],
                    error=error,
                    covered=error <= half[used],
                    phase=touch.phase[used],
                )


def _rows(scored: Sequence[Scored]) -> Rows:
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
                            "split": one.split,
                            "model": one.model,
                            "told": one.told,
                            "phase": phase,
                            "band": band,
                            **_figures(one.error[mine], one.covered[mine]),
                        }
                    )
    return rows


def _figures(error: FloatArray, covered: Mask) -> dict[str, Any]:
    return {
        "samples": len(error),
        "median_abs_log_error": round(float(np.median(error)), 5),
        "coverage": round(float(np.mean(covered)), 5),
    }


def _summary(scored: Sequence[Scored], *, by_sensor: bool) -> Rows:
    """Return medians over samples, of all or of each sensor, by phase and by band of force."""
    summary: Rows = []
    keys = dict.fromkeys((one.split, one.model, one.told) for one in scored)
    for split, model, told in keys:
        mine = [one for one in scored if (one.split, one.model, one.told) == (split, model, told)]
        sensors = dict.fromkeys(one.touch.sensor for one in mine)
        for sensor in sensors if by_sensor else ("all",):
            of = [one for one in mine if sensor in ("all", one.touch.sensor)]
            error = np.concatenate([one.error for one in of])
            covered = np.concatenate([one.covered for one in of])
            phases = np.concatenate([one.phase for one in of])
            force_n = np.exp(np.concatenate([one.log_force for one in of]))
            for phase in ("all", *PHASES):
                for band, (low, high) in {"all": (0.0, np.inf), **BANDS}.items():
                    here = (force_n >= low) & (force_n < high)
                    here &= (phases == phase) | (phase == "all")
                    if here.any():
                        summary.append(
                            {
                                "split": split,
                                "sensor": sensor,
                                "model": model,
                                "told": told,
                                "phase": phase,
                                "band": band,
                                **_figures(error[here], covered[here]),
                            }
                        )
    return summary


def _compared(scored: Sequence[Scored]) -> Rows:
    """Return the error of ours less that of each other model, by pin of a sensor."""
    rows: Rows = []
    for told in dict.fromkeys(one.told for one in scored):
        each = {
            model: [s for s in scored if (s.model, s.told) == (model, told)] for model in MODELS
        }
        for phase in ("all", "unloading"):
            chosen = [(one.phase == phase) | (phase == "all") for one in each["ours"]]
            group = [
                f"{one.touch.sensor}-{one.touch.pin}"
                for one, mine in zip(each["ours"], chosen, strict=True)
                for _ in range(int(mine.sum()))
            ]
            lost = {
                model: np.concatenate([s.error[c] for s, c in zip(some, chosen, strict=True)])
                for model, some in each.items()
            }
            rows += [
                {
                    "told": told,
                    "phase": phase,
                    "rival": rival,
                    **paired_difference(lost["ours"], lost[rival], group).to_dict(),
                }
                for rival in MODELS
                if rival != "ours"
            ]
    return rows


def _tables(summary: Rows) -> list[Table]:
    """Return a table for each split: one line for each model and what it knows."""
    tables = []
    columns = [("all", "all"), ("unloading", "all"), *(("all", band) for band in BANDS)]
    for split in dict.fromkeys(one["split"] for one in summary):
        mine = [one for one in summary if one["split"] == split]
        rows = []
        for told, model, sensor in dict.fromkeys(
            (one["told"], one["model"], one["sensor"]) for one in mine
        ):
            found = {
                (one["phase"], one["band"]): one
                for one in mine
                if (one["told"], one["model"], one["sensor"]) == (told, model, sensor)
            }
            cells = [found.get(column) for column in columns]
            rows.append(
                [told, model, sensor]
                + ["" if one is None else f"{one['median_abs_log_error']:.3f}" for one in cells]
                + ["" if one is None else f"{one['coverage']:.2f}" for one in cells[:2]]
            )
        tables.append(
            Table(
                title=f"{_TITLES[split]}, median |error of ln force|",
                columns=(
                    *("known", "model", "sensor", "all", "unloading"),
                    *(f"{band} N" for band in BANDS),
                    *("coverage", "unloading"),
                ),
                rows=rows,
            )
        )
    return tables


def _report(scored: Sequence[Scored], *, touches: int) -> StudyReport:
    summary = _summary(scored, by_sensor=False)
    sensors = _summary(scored, by_sensor=True)
    return StudyReport(
        name="strokes",
        title="Force of real Velostat under short touches",
        provenance=(
            f"Real recordings with a load cell; learned from {touches} touches of the training "
            f"file. Samples of {SMALLEST_N:g} N and more; medians over samples.",
            "`ours` is `palpate.ForceLaw`, its population learned from the training touches. "
            "`place`: the other attempts at the place are known, force and reading. A static law "
            "takes its gain from them, `ours` a law of the place, the clock their usual "
            "force at each time. `five_percent`, `eighty_percent`: the force is measured once, on "
            "the way up; later samples are scored.",
            "`constant` and `clock` read no sensor. The touches are alike in time, which helps a "
            "clock, trees and the force law alike; unloading and small forces show what the "
            "sheet adds.",
        ),
        tables=_tables([*summary, *sensors]),
        payload={
            "rows": _rows(scored),
            "summary": summary,
            "sensors": sensors,
            "compared": _compared(scored),
            "level": LEVEL,
        },
    )
