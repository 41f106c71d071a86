"""Force now during random staircases of closing and opening, on sheets of the twin."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate_studies.baselines.told_everything import LEARNERS, RIDGE, TREES
from palpate_studies.protocol.paired import compare, rms
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.sheets import other_sheet
from palpate_studies.staircase_data import FollowedForce, followed, learned_from

#: Method -> what it is, in the order of the table.
METHODS = {
    "settled": "law of settled readings",
    "early": "law of readings soon after a movement",
    "by_time": "both laws, by the time since the reading moved",
    "memory": "law with memory, of other sensors, by the settled readings of this one",
    "now": "the mean of the last two in ln force (`live --force`)",
    RIDGE: f"{LEARNERS[RIDGE]}, learned on other sheets",
    TREES: f"{LEARNERS[TREES]}, learned on other sheets",
}
#: What `now` is compared with.
RIVALS = ("settled", RIDGE, TREES)
#: The first sheet that is tested, written down before anything was scored on it; looked at before:
#: 60_000 to 60_059 and 61_000 to 61_059, of the second generator 96_100 on, 97_100 to 97_129 and
#: 97_300 to 97_329. The mean of two laws was chosen on 2_500_000 to 2_500_009 of both.
FIRST_SHEET, SECOND_SHEET = 62_000, 97_400
#: Sheets that the learners learn from; none of them is tested.
LEARNING_SHEET, LEARNED_FROM = 1_700_000, 60
_SECOND = (
    "Second generator: sheets whose conductance rises steeply, then with the logarithm of the load "
    "only, with play of a fixed force, and creep that does not slow down."
)
Runs = dict[str, dict[str, list[FollowedForce]]]


def report(
    *,
    sheets: Annotated[int, typer.Option(help="Sheets of each level.", min=1)] = 4,
    staircases: Annotated[int, typer.Option(help="Test staircases of each.", min=1, max=6)] = 2,
    second: SecondOption = False,
) -> StudyReport:
    """Follow the force through staircases of 20 s with the laws of a calibration.

    Example: palpate study staircases --sheets 2
    """
    runs: Runs = {level: {name: [] for name in METHODS} for level in LEVELS}
    remade, first = (other_sheet, SECOND_SHEET) if second else (None, FIRST_SHEET)
    taught = range(LEARNING_SHEET, LEARNING_SHEET + LEARNED_FROM)
    for level in LEVELS:
        laws = learned_from(taught, level=level, staircases=staircases, remade=remade)
        for sensor in range(first, first + sheets):
            try:
                each = followed(
                    sensor, level=level, staircases=staircases, remade=remade, laws=laws
                )
            except CalibrationError as error:
                # A pixel at the end of its converter: the guided steps refuse such a sheet.
                sys.stderr.write(f"sheet {sensor}, {level}: refused: {error}\n")
                continue
            for name, some in each.items():
                runs[level][name] += some
    return _report(runs, sheets=sheets, staircases=staircases, second=second)


command = as_command(report)


def _summary(runs: Runs) -> list[dict[str, Any]]:
    return [
        {"level": level, "method": name, **_scores(each, runs[level]["settled"])}
        for level in LEVELS
        for name, each in runs[level].items()
        if each
    ]


def _scores(
    each: Sequence[FollowedForce], settled: Sequence[FollowedForce]
) -> dict[str, float | None]:
    logs = [np.log(np.maximum(one.value_n, 0.01) / one.force_n) for one in each]
    own = [log - np.median(log) for log in logs]
    half_n = np.concatenate([(one.high_n - one.low_n) / 2 for one in each])
    return {
        "rms_error_n": _rms_n(each),
        "median_sheet_rms_n": _median_sheet_rms_n(each),
        "share_of_settled": _rms_n(each) / _rms_n(settled),
        "rms_log_error": float(np.sqrt(np.mean(np.concatenate(logs) ** 2))),
        "rms_log_error_own_gain_out": float(np.sqrt(np.mean(np.concatenate(own) ** 2))),
        # A method that gives no interval covers nothing, and is not asked to.
        "coverage": float(np.mean(np.concatenate([one.covered for one in each])))
        if half_n.any()
        else None,
        "mean_half_width_n": float(np.mean(half_n)) if half_n.any() else None,
    }


def _compared(runs: Runs) -> list[dict[str, Any]]:
    """Return the RMS error of `now` less that of each rival on the same frames, by sheet."""
    return [
        row
        for level, each in runs.items()
        for row in compare(
            {name: _errors_n(each[name]) for name in ("now", *RIVALS) if each[name]},
            [str(one.sensor) for one in each["now"] for _ in one.force_n],
            ours="now",
            statistic=rms,
            level=level,
        )
    ]


def _rms_n(each: Sequence[FollowedForce]) -> float:
    return float(rms(_errors_n(each)))


def _median_sheet_rms_n(each: Sequence[FollowedForce]) -> float:
    """Return the RMS error of the median sheet: a few that go astray decide over all together."""
    sheets = dict.fromkeys(one.sensor for one in each)
    return float(np.median([_rms_n([o for o in each if o.sensor == name]) for name in sheets]))


def _errors_n(each: Sequence[FollowedForce]) -> FloatArray:
    return np.concatenate([one.value_n - one.force_n for one in each])


def _report(runs: Runs, *, sheets: int, staircases: int, second: bool) -> StudyReport:
    summary = _summary(runs)
    return StudyReport(
        name="staircases",
        title="Force now during random staircases of closing and opening (simulated)",
        provenance=(
            "Simulated: sheets of the twin, each calibrated once as the simulated rigs are (a load "
            "cell with changing faces) and tested on other objects in another session; steps of "
            "1 mm at 3.5 mm/s, dwells of 0.2-5 s, forces above 0.2 N. Sheets whose pixels saturate "
            "are refused, named on standard error and left out.",
            "`own gain out` is the error with the median of each staircase taken away: what "
            "remains when the gain of that contact is known.",
            f"The learners learn from staircases of {LEARNED_FROM} other sheets of the level, of "
            f"the same law (seeds from {LEARNING_SHEET} on): both laws' forces, the readings up to "
            "4 s ago and the times. They give no interval.",
            *([_SECOND] if second else []),
        ),
        tables=[
            Table.of(
                f"Force now, {sheets} sheets of each level, {staircases} staircases of 20 s each",
                summary,
                {
                    "level": "{level}",
                    "method": "{method}",
                    "what": lambda row: METHODS[row["method"]],
                    "RMS error, N": "{rms_error_n:.2f}",
                    "of the median sheet, N": "{median_sheet_rms_n:.2f}",
                    "of settled's": "{share_of_settled:.2f}",
                    "RMS ln error": "{rms_log_error:.2f}",
                    "own gain out": "{rms_log_error_own_gain_out:.2f}",
                    "coverage (0.9)": "{coverage:.2f}",
                    "half width, N": "{mean_half_width_n:.2f}",
                },
            )
        ],
        payload={
            "study": "staircases",
            "second_generator": second,
            "summary": summary,
            "compared": _compared(runs),
            "sheets": sheets,
            "staircases": staircases,
        },
    )
