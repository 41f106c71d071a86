"""Force now under real presses, from resistance after the force was measured once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate_studies.press_data import Press, read_presses
from palpate_studies.press_models import FOLDS, LEVEL, MODELS, Prediction, Presses, folds
from palpate_studies.protocol.paired import compare
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group

#: Name of a band of force -> its ends, newtons.
BANDS = {"0-2": (0.0, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}
_FOLDED = f"{FOLDS} folds by setting: a setting's repeats are left out together."
_WORDS = (
    "All models are given the force once per press, then all but `clock`, which sees no sensor, "
    "see resistance alone: how much force rises after that, and when, is learned like everything "
    "else. `ours`: `palpate.ForceLaw`, its population learned from the training presses; `trees` "
    "see the same states.",
    "Presses of one kind that are alike help them; the release shows what the sheet is worth.",
)
Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """A model's answer on a press, at each sample after the force was given.

    Attributes
    ----------
    press : Press
        The press.
    value_n, low_n, high_n : ndarray, shape (n_after,)
        Force and the ends of its interval, newtons.
    """

    press: Press
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the force was given."""
        trace = self.press.trace
        return np.asarray(trace.time_s[trace.told + 1 :] - trace.time_s[trace.told])

    @property
    def truth_n(self) -> FloatArray:
        """Force of the load cell, newtons."""
        return self.press.trace.force_n[self.press.trace.told + 1 :]

    @property
    def log_error(self) -> FloatArray:
        """ln(estimated / true force)."""
        return np.asarray(np.log(self.value_n / self.truth_n))

    @property
    def last_held_log_error(self) -> float:
        """Error at the last sample before the release; of the first where none was held."""
        return float(self.log_error[max(self.press.last_held - self.press.trace.told - 1, 0)])

    @property
    def released(self) -> NDArray[np.bool_]:
        """Whether each sample comes after the last with as much force as given."""
        given = self.press.trace.told
        return np.arange(given + 1, len(self.press.trace.time_s)) > self.press.last_held

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether the interval holds the true force."""
        return (self.low_n <= self.truth_n) & (self.truth_n <= self.high_n)


def in_newtons(press: Press, prediction: Prediction) -> Followed:
    """Return a model's answer in newtons, from the given force on."""
    given = press.trace.told
    change, half = (part[given + 1 :] for part in prediction)
    given_n = float(press.trace.force_n[given])
    return Followed(
        press=press,
        value_n=given_n * np.exp(change),
        low_n=given_n * np.exp(change - half),
        high_n=given_n * np.exp(change + half),
    )


def report(
    *,
    recordings: Annotated[
        Path, typer.Option(help="Recordings of presses to learn from.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(help="Recordings to follow; without, 5 folds by setting.", metavar="CSV"),
    ] = None,
) -> StudyReport:
    """Follow the force of real presses from resistance, given the force once in each.

    Example: palpate study presses --recordings presses.csv.gz
    """
    known = read_presses(recordings)
    splits = folds(known) if test_recordings is None else [(known, read_presses(test_recordings))]
    scores = judge(splits)
    return StudyReport(
        name="presses",
        title="Force now on real Velostat under a robot's presses",
        provenance=(
            "Real recordings with a reference load cell.",
            _FOLDED if test_recordings is None else f"Learned from {recordings} alone.",
            *_WORDS,
        ),
        tables=tables(scores),
        payload={"study": "presses", **scores},
    )


command = as_command(report)


def judge(splits: Iterable[tuple[Presses, Presses]]) -> dict[str, Any]:
    """Follow every press that is tested by every model, learned on the others, and score it."""
    followed: dict[str, list[Followed]] = {name: [] for name in MODELS}
    for train, tested in splits:
        for name, learn in MODELS.items():
            model = learn(train)
            followed[name] += [in_newtons(press, model(press)) for press in tested]
    return {
        "rows": [
            {
                "recording_id": one.press.recording_id,
                "press": one.press.press,
                "model": model,
                "median_abs_log_error": float(np.median(np.abs(one.log_error))),
                "final_log_error": float(one.log_error[-1]),
                "coverage": float(np.mean(one.covered)),
            }
            for model, each in followed.items()
            for one in each
        ],
        "summary": _summary(followed),
        "by_force": _by_force(followed),
        "compared": _compared(followed),
        "level": LEVEL,
    }


def _summary(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over presses, of all and of each setting."""
    settings: dict[str, dict[str, Sequence[Followed]]] = {"all": {**followed}}
    for model, each in followed.items():
        for key, mine in group(each, "press.trace.group"):
            settings.setdefault(key["group"], {})[model] = mine
    return [
        {
            "setting": setting,
            "model": model,
            "presses": len(each),
            "median_abs_log_error": float(
                np.median([np.median(np.abs(one.log_error)) for one in each])
            ),
            "final_log_error": float(np.median([abs(one.log_error[-1]) for one in each])),
            "last_held_log_error": float(np.median([abs(one.last_held_log_error) for one in each])),
            "coverage": float(np.mean([np.mean(one.covered) for one in each])),
            "final_coverage": float(np.mean([one.covered[-1] for one in each])),
        }
        for setting, by_model in settings.items()
        for model, each in by_model.items()
    ]


def _by_force(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over samples, by force and where the press is released."""
    lines: Rows = []
    for model, each in followed.items():
        force_n, log_error, covered, released = (
            np.concatenate([getattr(one, name) for one in each])
            for name in ("truth_n", "log_error", "covered", "released")
        )
        parts = {name: (force_n >= a) & (force_n < b) for name, (a, b) in BANDS.items()}
        for name, mine in {**parts, "held": ~released, "released": released}.items():
            if mine.any():
                lines.append(
                    {
                        "model": model,
                        "part": name,
                        "samples": int(mine.sum()),
                        "median_abs_log_error": float(np.median(np.abs(log_error[mine]))),
                        "coverage": float(np.mean(covered[mine])),
                    }
                )
    return lines


def _compared(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return the error of ours less that of each other model, by setting of the presses.

    Over presses it is the median error of each, over the release that of each sample.
    """

    def released(each: Sequence[Followed]) -> FloatArray:
        return np.concatenate([np.abs(one.log_error[one.released]) for one in each])

    ours = followed["ours"]
    presses = {
        model: [float(np.median(np.abs(one.log_error))) for one in each]
        for model, each in followed.items()
    }
    rows = compare(presses, [one.press.trace.group for one in ours], part="presses")
    groups = [one.press.trace.group for one in ours for _ in range(int(one.released.sum()))]
    # Recordings of presses that are never let go have no release.
    if groups:
        lost = {model: released(each) for model, each in followed.items()}
        rows += compare(lost, groups, part="released")
    return rows


def tables(scores: Mapping[str, Any]) -> list[Table]:
    """Return the rows of the study's JSON as tables."""
    return [
        Table.of("Force after it was given, medians over presses", scores["summary"]),
        Table.of("By force and part of the press, medians over samples", scores["by_force"]),
    ]
