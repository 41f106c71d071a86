"""Ours next to every simpler rule on drawn families and real recordings, seen and left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate.holds import Hold
from palpate.settling.own import OwnRelaxation
from palpate.settling.predict import METHODS, predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod, Status
from palpate.settling.scoring import settled_value
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.settling_families import FAMILIES, after_baseline, draw
from palpate_studies.settling_odds import (
    CUTOFFS_S,
    learn,
    lessons_of,
    log_odds,
    source,
    units_of,
)
from palpate_studies.specimens import HORIZON_S, settled_holds

OURS, BEST = "relaxation", "best simple"
SIMPLE = tuple(name for name in METHODS if name != OURS)
#: Past holds of the same sensor to learn from, and later ones that it takes to score that.
OWN_HOLDS, FEWEST_LATER = (5, 10, 20, 40), 5


def command(
    holds: Annotated[
        list[Path] | None,
        typer.Option(help="Real holds; may be repeated.", metavar="FILE"),
    ] = None,
    count: Annotated[int, typer.Option(help="Holds drawn of each family.", min=2)] = 300,
    seed: Annotated[int, typer.Option(help="Of the drawn holds; best one not used before.")] = 0,
    odds: Annotated[
        Path | None,
        typer.Option(help="Write the odds learned on all of these here, and stop.", metavar="FILE"),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Compare ours with simpler rules, family by family.

    Example: palpate study settling-families --holds silicone.csv.gz --holds velostat.csv.gz
    """
    if not holds:
        raise InputError("name at least one recording with --holds FILE")
    real = {file.name.removesuffix(".csv.gz"): settled_holds(file) for file in holds}
    if odds is not None:
        odds.write_text(source(learn(lessons_of(real).values())), encoding="utf-8")
        return
    report(real, count=count, seed=seed).emit(as_json=as_json, out=out)


def report(real: Mapping[str, Sequence[Hold]], *, count: int, seed: int) -> StudyReport:
    """Score everything and put it into one report."""
    drawn = {family: draw(family, count, seed=seed) for family in FAMILIES}
    seen = {name: scores(holds) for name, holds in {**real, **drawn}.items()}
    left_out = _left_out(real, drawn)
    own = {
        f"{name}, after {past}": found
        for name, unit in units_of(real).items()
        for past, found in _learning(unit.holds)
    }
    rng = np.random.default_rng(seed)
    rested, risen = (
        {
            name: _rested(holds, rng=rng, rises_s=rises_s)
            for name, holds in {**real, **drawn}.items()
        }
        for rises_s in ((0.0, 0.0), RISES_S)
    )
    return StudyReport(
        name="settling-families",
        title="The settled value of recordings of every kind",
        provenance=(
            f"Real: {', '.join(f'{name} ({len(holds)} holds)' for name, holds in real.items())}. "
            "The odds that ship were learned on recordings of these names: their rows of the first "
            "two tables are not unseen, those of the next two are.",
            f"Drawn from formulas (no sensor, no twin): {count} holds of each family, seed {seed}; "
            "the odds were learned on others.",
            f"{BEST}: the rule with the smallest median on the real holds that are not left out.",
        ),
        tables=[
            _rivals(f"Median |error|, % of the settled value, {_AT}", seen),
            _ours(f"Ours alone, {_AT}", seen),
            _rivals(f"Median |error|, left out of the odds, {_AT}", left_out),
            _ours(f"Ours alone, left out of the odds, {_AT}", left_out),
            _own("Median |error| and coverage with and without the sensor's own past holds", own),
            _ours(
                f"Ours with 0.5 to 3 s of the unloaded sensor in front, {_AT} of contact", rested
            ),
            _ours(
                f"The same where contact is made over 0.03 to 0.3 s, {_AT} of full contact", risen
            ),
        ],
        payload={
            "seed": seed,
            "count": count,
            "cutoffs_s": list(CUTOFFS_S),
            "seen": {name: _payload(found) for name, found in seen.items()},
            "left_out": {name: _payload(found) for name, found in left_out.items()},
            "own_holds": {
                name: {"without": _payload(without), "with": _payload(learned)}
                for name, (without, learned) in own.items()
            },
            "with_baseline": {name: _payload(found) for name, found in rested.items()},
            "with_rise": {name: _payload(found) for name, found in risen.items()},
        },
    )


#: How long a contact takes to be made, s.
RISES_S = (0.03, 0.3)
_AT = f"at {' / '.join(f'{cutoff_s:g}' for cutoff_s in CUTOFFS_S)} s"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scores:
    """How rules do on the same holds, one row for each cut-off.

    Attributes
    ----------
    errors : mapping of str to ndarray, shape (n_cutoffs, n_holds)
        |error| by rule, % of the settled value.
    covered, ok : ndarray, shape (n_cutoffs, n_holds)
        Whether the interval of ours covers the settled value, and whether its status is `ok`.
    """

    errors: Mapping[str, FloatArray]
    covered: FloatArray
    ok: FloatArray


def scores(
    holds: Sequence[Hold],
    *,
    ours: SettlingMethod | None = None,
    rivals: Sequence[str] = SIMPLE,
    starts_s: Sequence[float] | None = None,
) -> Scores:
    """Return how ours and its rivals do on holds; cut-offs count from `starts_s`, 0 by default."""
    methods: dict[str, SettlingMethod | str] = {name: name for name in rivals}
    methods[OURS] = ours or Relaxation()
    shape = (len(CUTOFFS_S), len(holds))
    errors = {name: np.empty(shape) for name in methods}
    covered, ok = np.empty(shape), np.empty(shape)
    for column, hold in enumerate(holds):
        start_s = starts_s[column] if starts_s else 0.0
        settled = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S + start_s)
        for row, cutoff_s in enumerate(CUTOFFS_S):
            for name, method in methods.items():
                found = predict_settled(
                    hold.time_s,
                    hold.values,
                    cutoff_s=cutoff_s + start_s,
                    horizon_s=HORIZON_S + start_s,
                    method=method,
                )
                errors[name][row, column] = 100 * abs(float(found.value) / settled - 1)
            covered[row, column] = found.low <= settled <= found.high
            ok[row, column] = found.status == Status.OK
    return Scores(errors=errors, covered=covered, ok=ok)


def _rested(
    holds: Sequence[Hold], *, rng: np.random.Generator, rises_s: tuple[float, float]
) -> Scores:
    """Return how ours does behind a baseline, with contact made over `rises_s`."""
    rested = [after_baseline(hold, rng=rng, rises_s=rng.uniform(*rises_s)) for hold in holds]
    starts_s = [
        float(long.time_s[len(long.time_s) - len(hold.time_s)] - hold.time_s[0])
        for long, hold in zip(rested, holds, strict=True)
    ]
    return scores(rested, rivals=(), starts_s=starts_s)


def _learning(holds: Sequence[Hold]) -> Iterator[tuple[int, tuple[Scores, Scores]]]:
    """Yield how ours does without and with the first holds, on all that were recorded later."""
    for past in OWN_HOLDS:
        if len(holds) - past >= FEWEST_LATER:
            later, learned = holds[past:], OwnRelaxation(holds=tuple(holds[:past]))
            yield past, (scores(later, rivals=()), scores(later, rivals=(), ours=learned))


def _left_out(
    real: Mapping[str, Sequence[Hold]], drawn: Mapping[str, Sequence[Hold]]
) -> dict[str, Scores]:
    """Return scores of every family and specimen under odds learned without it."""
    lessons = lessons_of(real)
    units = {name: unit.holds for name, unit in units_of(real).items()}
    found = {}
    for name, holds in {**units, **drawn}.items():
        odds = learn([one for other, one in lessons.items() if other != name])
        found[name] = scores(holds, ours=Relaxation(log_odds=log_odds(odds)))
    best = {
        name: _with_best(found[name], [found[other].errors for other in units if other != name])
        for name in units
        if len(units) > 1
    }
    return found | best


def _with_best(one: Scores, others: Sequence[Mapping[str, FloatArray]]) -> Scores:
    """Return scores with those of the simple rule that is best on others, at each cut-off."""
    best = []
    for row in range(len(CUTOFFS_S)):
        medians = {
            name: np.median(np.concatenate([errors[name][row] for errors in others]))
            for name in SIMPLE
        }
        best.append(one.errors[min(medians, key=medians.__getitem__)][row])
    return Scores(errors={**one.errors, BEST: np.array(best)}, covered=one.covered, ok=one.ok)


def _rivals(title: str, found: Mapping[str, Scores]) -> Table:
    rules = [
        rule for rule in (*SIMPLE, BEST, OURS) if any(rule in s.errors for s in found.values())
    ]
    return Table(
        title=title,
        columns=("holds", "n", *rules),
        rows=[
            (
                name,
                str(one.ok.shape[1]),
                *(
                    _cell(np.median(one.errors[rule], axis=1)) if rule in one.errors else "-"
                    for rule in rules
                ),
            )
            for name, one in found.items()
        ],
    )


def _own(title: str, found: Mapping[str, tuple[Scores, Scores]]) -> Table:
    return Table(
        title=title,
        columns=("holds", "n later", "without", "with", "p90 without", "p90 with", "coverage with"),
        rows=[
            (
                name,
                str(without.ok.shape[1]),
                *(_cell(_OURS["median"](one)) for one in (without, learned)),
                *(_cell(_OURS["p90"](one)) for one in (without, learned)),
                _cell(_OURS["coverage"](learned)),
            )
            for name, (without, learned) in found.items()
        ],
    )


#: Figures reported for ours alone, by cut-off.
_OURS: Mapping[str, Callable[[Scores], FloatArray]] = {
    "median": lambda one: np.median(one.errors[OURS], axis=1),
    "p90": lambda one: np.quantile(one.errors[OURS], 0.9, axis=1),
    "worst": lambda one: one.errors[OURS].max(axis=1),
    "coverage": lambda one: one.covered.mean(axis=1),
    "coverage of ok": lambda one: (
        (one.covered * one.ok).sum(axis=1)
        / np.where(one.ok.any(axis=1), one.ok.sum(axis=1), np.nan)
    ),
    "share ok": lambda one: one.ok.mean(axis=1),
}


def _ours(title: str, found: Mapping[str, Scores]) -> Table:
    return Table(
        title=title,
        columns=("holds", "n", *_OURS),
        rows=[
            (name, str(one.ok.shape[1]), *(_cell(figure(one)) for figure in _OURS.values()))
            for name, one in found.items()
        ],
    )


def _cell(values: FloatArray) -> str:
    return " / ".join("-" if np.isnan(value) else f"{value:.2g}" for value in values)


def _payload(one: Scores) -> dict[str, Any]:
    medians = {rule: np.median(errors, axis=1).tolist() for rule, errors in one.errors.items()}
    ours = {
        name: [None if np.isnan(value) else float(value) for value in figure(one)]
        for name, figure in _OURS.items()
    }
    return {"holds": int(one.ok.shape[1]), "median_abs_error_percent": medians, OURS: ours}
