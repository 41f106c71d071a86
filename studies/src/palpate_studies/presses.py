"""Force now under real presses: given once, then from resistance alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate_studies.other_presses import MOTIONS, other_presses
from palpate_studies.press_data import Press, read_presses
from palpate_studies.press_figure import draw_followed
from palpate_studies.press_follow import Followed, in_newtons
from palpate_studies.press_models import FOLDS, LEVEL, MODELS, Presses, folds
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.stretches import follow_stretches, read_stretches, stretch_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Name of a band of force -> its ends, newtons.
BANDS = {"0-2": (0.0, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}

_BY_SETTING = f"{FOLDS} folds by setting: a setting's repeats are left out together."
_MODELS = (
    "All models are given the force once per press, then all but `constant` and `clock`, which see "
    "no sensor, see resistance alone: how much force rises after that, and when, is learned like "
    "everything else. `ours`: `palpate.ForceLaw`, its population learned from the training "
    "presses; `ridge` and `trees` see the same states.",
    "Presses of one kind that are alike help them; the release shows what the sheet is worth.",
)

Rows: TypeAlias = list[dict[str, Any]]


def command(
    recordings: Annotated[
        Path | None, typer.Option(help="Recordings of presses to learn from.", metavar="CSV")
    ] = None,
    test_recordings: Annotated[
        Path | None,
        typer.Option(help="Recordings to follow; without, 5 folds by setting.", metavar="CSV"),
    ] = None,
    stretch_resistance: Annotated[
        Path | None,
        typer.Option(help="Resistance of stretched rubber, to follow its force.", metavar="HOLDS"),
    ] = None,
    stretch_force: Annotated[
        Path | None, typer.Option(help="Force of the same holds.", metavar="HOLDS")
    ] = None,
    second: Annotated[
        bool,
        typer.Option("--second", help="Presses of simulated sheets of another law, no recordings."),
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Follow the force of real presses from resistance, given the force once in each.

    Example: palpate study presses --recordings presses.csv.gz
    """
    if second == (recordings is not None):
        raise InputError("give either --recordings or --second")
    if (stretch_resistance is None) != (stretch_force is None):
        raise InputError("--stretch-resistance and --stretch-force go together; give both")
    if recordings is None:
        _second_report().emit(as_json=as_json, out=out)
        return
    stretches = (
        read_stretches(stretch_resistance, force=stretch_force)
        if stretch_resistance and stretch_force
        else []
    )
    known = read_presses(recordings)
    if test_recordings is None:
        splits = [*folds(known)]
        split = _BY_SETTING
    else:
        tested = read_presses(test_recordings)
        splits = [(known, tested)]
        shared = {p.recording_id for p in known} & {p.recording_id for p in tested}
        split = f"Learned from {recordings}, followed on {test_recordings}" + (
            f"; {len(shared)} recordings are in both, so those errors are of the fit."
            if shared
            else ", no recording in both."
        )
    report = _report(_answered(splits), split=split)
    report = _with_stretches(report, stretches) if stretches else report
    report.emit(as_json=as_json, out=out)


def _answered(splits: Sequence[tuple[Presses, Presses]]) -> dict[str, list[Followed]]:
    """Return the answers of every model on the tested part of each split."""
    answers: dict[str, list[Followed]] = {name: [] for name in MODELS}
    for train, tested in splits:
        for name, learn in MODELS.items():
            model = learn(train)
            answers[name] += [in_newtons(press, model(press)) for press in tested]
    return answers


def _rows(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    return [
        {
            "recording_id": one.press.recording_id,
            "press": one.press.press,
            "model": model,
            "median_abs_log_error": float(np.median(np.abs(one.log_error))),
            "final_log_error": float(one.log_error[-1]),
            "last_held_log_error": one.last_held_log_error,
            "coverage": float(np.mean(one.covered)),
            "final_covered": bool(one.covered[-1]),
        }
        for model, each in followed.items()
        for one in each
    ]


def _summary(rows: Rows, settings: Mapping[str, str]) -> Rows:
    summary: Rows = []
    for setting in ("all", *dict.fromkeys(settings.values())):
        for model in MODELS:
            mine = [
                row
                for row in rows
                if row["model"] == model and setting in ("all", settings[row["recording_id"]])
            ]
            columns = {key: np.array([row[key] for row in mine]) for key in mine[0]}
            summary.append(
                {
                    "setting": setting,
                    "model": model,
                    "presses": len(mine),
                    "median_abs_log_error": float(np.median(columns["median_abs_log_error"])),
                    "final_log_error": float(np.median(np.abs(columns["final_log_error"]))),
                    "last_held_log_error": float(np.median(np.abs(columns["last_held_log_error"]))),
                    "coverage": float(np.mean(columns["coverage"])),
                    "final_coverage": float(np.mean(columns["final_covered"])),
                }
            )
    return summary


def _by_force(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over samples, by force and where the press is released."""
    lines: Rows = []
    for model, each in followed.items():
        force_n = np.concatenate([one.truth_n for one in each])
        error = np.abs(np.concatenate([one.log_error for one in each]))
        covered = np.concatenate([one.covered for one in each])
        released = np.concatenate([one.released for one in each])
        parts = {name: (force_n >= a) & (force_n < b) for name, (a, b) in BANDS.items()}
        for name, mine in {**parts, "held": ~released, "released": released}.items():
            if mine.any():
                lines.append(
                    {
                        "model": model,
                        "part": name,
                        "samples": int(mine.sum()),
                        "median_abs_log_error": float(np.median(error[mine])),
                        "coverage": float(np.mean(covered[mine])),
                    }
                )
    return lines


def _compared(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return the error of ours less that of each other model, by setting of the presses.

    Over presses it is the median error of each, over the release that of each sample.
    """

    def lost(model: str, part: str) -> FloatArray:
        errors = [np.abs(one.log_error) for one in followed[model]]
        if part == "presses":
            return np.array([np.median(error) for error in errors])
        each = zip(errors, followed[model], strict=True)
        return np.concatenate([error[one.released] for error, one in each])

    groups = {
        "presses": [one.press.trace.group for one in followed["ours"]],
        "released": [
            one.press.trace.group for one in followed["ours"] for _ in range(one.released.sum())
        ],
    }
    return [
        {
            "part": part,
            "rival": rival,
            **paired_difference(lost("ours", part), lost(rival, part), group).to_dict(),
        }
        for part, group in groups.items()
        for rival in MODELS
        # Recordings of presses that are never let go have no release.
        if rival != "ours" and group
    ]


def _scored(followed: Mapping[str, Sequence[Followed]]) -> tuple[list[Table], dict[str, Any]]:
    """Return the tables of every model, and what they are made of."""
    rows = _rows(followed)
    settings = {one.press.recording_id: one.press.trace.group for one in followed["ours"]}
    summary, by_force = _summary(rows, settings), _by_force(followed)
    columns = (
        ("median_abs_log_error", "abs ln error"),
        ("final_log_error", "at the end"),
        ("last_held_log_error", "before release"),
        ("coverage", "coverage"),
        ("final_coverage", "coverage, end"),
    )
    table = Table(
        title="Force after it was given, medians over presses",
        columns=("setting", "model", "presses", *(title for _, title in columns)),
        rows=[
            [one["setting"], one["model"], str(one["presses"])]
            + [f"{one[key]:.3f}" for key, _ in columns]
            for one in summary
        ],
    )
    parts = Table(
        title="By force and part of the press, medians over samples",
        columns=("model", "part", "samples", "abs ln error", "coverage"),
        rows=[
            [one["model"], one["part"], str(one["samples"])]
            + [f"{one[key]:.3f}" for key in ("median_abs_log_error", "coverage")]
            for one in by_force
        ],
    )
    scores = {
        "rows": rows,
        "summary": summary,
        "by_force": by_force,
        "compared": _compared(followed),
        "level": LEVEL,
    }
    return [table, parts], scores


def _report(followed: Mapping[str, Sequence[Followed]], *, split: str) -> StudyReport:
    tables, scores = _scored(followed)
    return StudyReport(
        name="presses",
        title="Force now on real Velostat under a robot's presses",
        provenance=(f"Real recordings with a reference load cell. {split}", *_MODELS),
        tables=tables,
        payload=scores,
        figures={"presses": lambda: draw_followed(followed["ours"], followed["static"])},
    )


def _second_report() -> StudyReport:
    tables: list[Table] = []
    rows: dict[str, Any] = {}
    scores: dict[str, Any] = {}
    for motion in MOTIONS:
        shown, found = _scored(_answered([*folds(other_presses(motion))]))
        tables += [replace(one, title=f"{motion.capitalize()}: {one.title}") for one in shown]
        rows[motion] = found.pop("rows")
        scores[motion] = found
    return StudyReport(
        name="presses",
        title="Force now on simulated sheets of another law (second generator)",
        provenance=(
            "Simulated: sheets whose conductance rises steeply, then with the logarithm of the "
            "load only, with play of a fixed force and creep at an even pace, pressed at eight "
            f"places. {_BY_SETTING} A setting is a sheet and a force.",
            "Alike: up, held and let go as the robot of the real recordings does. Unlike: of any "
            "speed and length, with a force that wanders, let go in up to 0.6 s.",
            *_MODELS,
        ),
        tables=tables,
        payload={"second_generator": True, "rows": rows, **scores},
    )


def _with_stretches(report: StudyReport, stretches: Sequence[Press]) -> StudyReport:
    stretched = follow_stretches(stretches)
    table, rows = stretch_table(stretches, stretched)

    def draw() -> Figure:
        return draw_followed(stretched["observer"], stretched["static"], stretched=True)

    return replace(
        report,
        provenance=(
            *report.provenance,
            "Stretches: specimens left out; given the force once, 0.5 s after the peak. The clock "
            "reads no sensor.",
        ),
        tables=[*report.tables, table],
        payload={**report.payload, "stretches": rows},
        figures={**report.figures, "stretches": draw},
    )
