"""The paper's Table 1 on real recordings: every method against waiting, specimens held out."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate.settling.relaxation import Relaxation
from palpate_studies.held_out import (
    CUTOFFS_S,
    LEVEL,
    MAIN_CUTOFF_S,
    OURS,
    FileResult,
    analyse,
    baselines,
)
from palpate_studies.real_holds_scores import limits, per_specimen, summary_of, worst_holds
from palpate_studies.real_holds_tables import tables_of
from palpate_studies.report import OutOption, StudyReport
from palpate_studies.specimens import HORIZON_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Table 1 of Fairchild, Chen and Tan: mean error, % of the settled relative change, their sensor.
PUBLISHED = {
    "exponential": (12, 2.9, 2.5, 2.3, 2.8, 2.5, 2.0, 1.0),
    "recorded": (15, 10, 9.2, 8.2, 5.4, 3.2, 2.4, 0.86),
}


def command(
    holds: Annotated[
        list[Path] | None,
        typer.Option(help="Real holds; may be repeated.", metavar="FILE"),
    ] = None,
    specimen_pattern: Annotated[
        str | None,
        typer.Option(
            help="Regular expression whose first group (or match) in hold_id is the specimen. "
            "[default: cut at the first number with a unit, version or hold number]",
            metavar="REGEX",
        ),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Score every settling method on real recordings, calibrated only on other specimens.

    Example: palpate study real-holds --holds silicone.csv.gz --holds velostat.csv.gz --out report
    """
    if not holds:
        raise InputError("name at least one recording with --holds FILE")
    try:
        pattern = None if specimen_pattern is None else re.compile(specimen_pattern)
    except re.error as error:
        raise InputError(f"--specimen-pattern {specimen_pattern}: {error}; fix it") from error
    report([analyse(file, pattern=pattern) for file in holds]).emit(as_json=as_json, out=out)


def report(results: Sequence[FileResult]) -> StudyReport:
    """Put the results of all files into one report."""
    files: list[dict[str, Any]] = [
        {
            "file": result.name,
            "holds": len(result.holds),
            "specimens": sorted(set(result.specimens.values())),
            "left_out_unit": result.unit,
            "summary": summary_of(result),
            "per_specimen": per_specimen(result),
            "worst": worst_holds(result),
            "limits": limits(result),
        }
        for result in results
    ]
    provenance = [
        f"Real recordings, nothing simulated: {file['file']}, {file['holds']} holds of "
        f"{len(file['specimens'])} specimen(s) ({', '.join(file['specimens'][:6])})."
        for file in files
    ]
    provenance.append(
        "The odds of relaxation that ship were learned on public silicone and Velostat holds: "
        "where these are the same, its rows are not unseen. `palpate study settling-families` "
        "leaves specimens out of the odds, too."
    )
    provenance.append(
        "No published entry was an input. The paper's rows are of its own sensor and in % of a "
        "relative change: compare ratios between methods, not percentages."
    )
    figures: dict[str, Any] = {}
    for number, (file, result) in enumerate(zip(files, results, strict=True), start=1):
        figures[f"errors_{number}"] = _errors_drawer(file)
        figures[f"worst_{number}"] = _worst_drawer(file, result)
    return StudyReport(
        name="real-holds",
        title="Settled values of real recordings, predicted from their first seconds",
        provenance=provenance,
        tables=tables_of(
            files, published=PUBLISHED, cutoffs_s=CUTOFFS_S, main_cutoff_s=MAIN_CUTOFF_S
        ),
        payload={
            "origin": "real recordings",
            "horizon_s": HORIZON_S,
            "level": LEVEL,
            "main_cutoff_s": MAIN_CUTOFF_S,
            "files": files,
            "published_mean_abs_error_percent": {
                name: dict(zip(map(str, CUTOFFS_S), row, strict=True))
                for name, row in PUBLISHED.items()
            },
        },
        figures=figures,
    )


def _errors_drawer(file: Mapping[str, Any]) -> Any:
    def draw() -> Figure:
        from palpate_studies.plots.errors import errors_by_cutoff

        title = f"{file['file']}: {file['holds']} real holds; bands: bootstrap over " + (
            f"{file['left_out_unit']}s, 90 %"
        )
        return errors_by_cutoff(file["summary"], title=title, level=LEVEL)

    return draw


def _worst_drawer(file: Mapping[str, Any], result: FileResult) -> Any:
    def draw() -> Figure:
        from palpate.plots.settle import Panel, settle_figure

        holds = {(hold.hold_id, hold.channel): hold for hold in result.holds}
        panels = [
            Panel(
                title=f"{entry['hold_id']}\nerror {entry['error_percent']:+.2g} % of settled, "
                f"{entry['error_of_remaining_percent']:.0f} % of the rest",
                hold=holds[entry["hold_id"], entry["channel"]],
                cutoff_s=MAIN_CUTOFF_S,
            )
            for entry in file["worst"]
            if entry["error_percent"] is not None
        ]
        methods = {OURS: Relaxation(), **baselines()}
        return settle_figure(panels, methods=methods, horizon_s=HORIZON_S, level=LEVEL)

    return draw
