"""Ours, its rivals, and methods of other people, on the same real recordings and folds."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.errors import InputError
from palpate_studies.baselines.boosting import Boosting
from palpate_studies.baselines.constant import Constant
from palpate_studies.baselines.log_law import TunedLogLaw
from palpate_studies.baselines.ours import OurDamageLimit, OurForceLaw, OurSettling
from palpate_studies.baselines.pooled_law import PooledLaw
from palpate_studies.baselines.ridge import Ridge
from palpate_studies.baselines.stiffness_line import StiffnessLine
from palpate_studies.protocol.challenges import CHALLENGES, Challenge
from palpate_studies.protocol.method import Method, losses
from palpate_studies.protocol.other_challenges import OTHER_CHALLENGES
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import SecondOption, StudyReport, Table, as_command

_SECOND = (
    "Holds drawn from formulas (no sensor) and weights on simulated sheets, both of shapes that no "
    "method was written for; real fruit, learned from other kinds than the one that is asked about."
)
_GENERAL = (Constant(of_scale=False), Constant(of_scale=True), Ridge(), Boosting())
#: Challenge -> ours first, then every rival.
METHODS: dict[str, tuple[Method, ...]] = {
    "settled": (OurSettling(), *_GENERAL, TunedLogLaw()),
    "ladders": (OurForceLaw(), *_GENERAL, PooledLaw(own_gain=False), PooledLaw(own_gain=True)),
    "rupture": (OurDamageLimit(), *_GENERAL, StiffnessLine()),
}


def report(
    *,
    data: Annotated[Path, typer.Option(help="Folder of the real recordings.", metavar="DIR")],
    method: Annotated[
        list[Path] | None,
        typer.Option(help="Python file that defines METHOD: one of your own.", metavar="FILE"),
    ] = None,
    second: SecondOption = False,
) -> StudyReport:
    """Enter a method of your own in three challenges, against ours and every rival.

    Example: palpate study challenge --data recordings --method mine.py
    """
    entered = [entered_from(path) for path in method or []]
    asked = OTHER_CHALLENGES if second else CHALLENGES
    return judge([read(data) for read in asked.values()], entered, second=second)


command = as_command(report)


def entered_from(path: Path) -> Method:
    """Load the object METHOD from a Python file.

    Raises
    ------
    InputError
        If the file can't be loaded or defines none.
    """
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise InputError(f"--method {path}: no Python file; name one that defines METHOD")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as fault:
        raise InputError(f"--method {path}: {type(fault).__name__}: {fault}") from fault
    found: Method | None = getattr(module, "METHOD", None)
    if found is None or not (hasattr(found, "name") and callable(getattr(found, "fit", None))):
        raise InputError(f"--method {path}: METHOD needs a name and a fit; see docs/benchmark.md")
    return found


def judge(
    challenges: Sequence[Challenge], entered: Sequence[Method] = (), *, second: bool = False
) -> StudyReport:
    """Score every method of every challenge, and pair each with ours."""
    rows = {challenge.name: _rows(challenge, entered) for challenge in challenges}
    return StudyReport(
        name="challenge",
        title="Three challenges: who errs less"
        + (", on cases of a second generator" if second else ", on real recordings"),
        provenance=(
            _SECOND if second else "Real recordings.",
            "Loss: |ln(answer / truth)|, its median over cases. Fitted, chosen and tested on "
            "different specimens; a setting is never scored where it was chosen.",
            "Difference: ours less the rival, paired; 90 % bootstrap over specimens. Below zero "
            "ours errs less. With three or four specimens an interval is a rough one.",
            "The numbers of our prior for settled values were chosen with half of these holds in "
            "view (docs/prediction.md); the rivals' are chosen on other specimens.",
        ),
        tables=[_table(challenge, rows[challenge.name]) for challenge in challenges],
        payload={
            "study": "challenge",
            "origin": "simulated and real" if second else "real",
            "second_generator": second,
            **rows,
        },
    )


def _rows(challenge: Challenge, entered: Sequence[Method]) -> list[dict[str, Any]]:
    methods, cases = (*METHODS[challenge.name], *entered), challenge.cases
    specimens = [case.specimen for case in cases]
    lost = {one.name: losses(one, cases, parts=challenge.folds) for one in methods}
    best = lost[methods[0].name]
    return [
        {
            "method": name,
            "cases": len(cases),
            "specimens": len(set(specimens)),
            "median_abs_log_error": float(np.median(each)),
            "p90_abs_log_error": float(np.quantile(each, 0.9)),
            "ours_less_this": None
            if each is best
            else paired_difference(best, each, specimens).to_dict(),
        }
        for name, each in lost.items()
    ]


def _table(challenge: Challenge, rows: Sequence[dict[str, Any]]) -> Table:
    less = "ours_less_this"
    return Table.of(
        f"{challenge.name}: {challenge.asks}, {rows[0]['cases']} cases of {rows[0]['specimens']}",
        sorted(rows, key=lambda row: float(row["median_abs_log_error"])),
        {
            "method": "{method}",
            "median |ln ratio|": "{median_abs_log_error:.3f}",
            "p90": "{p90_abs_log_error:.3f}",
            "ours less this (90 %)": lambda row: (
                "{difference:+.3f} ({low:+.3f} to {high:+.3f})".format(**row[less])
                if row[less]
                else ""
            ),
            "who errs less": lambda row: row[less]["verdict"] if row[less] else "",
        },
    )
