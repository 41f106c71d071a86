"""Force now under real presses, from resistance after the force was measured once.

The models are a clock, a static law, boosted trees and the law of palpate. Each is given the force
once and answers with ln(force / given force) at every sample, and with the half width of its
interval. Everything is learned from training presses; every setting counts as much as every other,
because a setting that nobody has seen is the task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.estimate.force_states import log_reading, states_of
from palpate_studies.baselines.full_input_learners import make_trees
from palpate_studies.force_learning import KnownContact, interval_quantile, learn_population
from palpate_studies.press_data import Press, read_presses
from palpate_studies.protocol.paired import compare
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group

LEVEL = 0.9
FOLDS = 5
#: A release is two or three samples long and half of what is asked.
_RELEASE_WEIGHT = 5.0
#: This many samples after the force is given, and every n-th of the hold, show what there is to
#: learn.
_ALL_UNTIL, _EVERY = 30, 4
_TICK_S = 0.02
#: Trees of the boosted rival; not tuned.
_ROUNDS = 200

Prediction: TypeAlias = tuple[FloatArray, FloatArray]
Follower: TypeAlias = Callable[[Press], Prediction]
Presses: TypeAlias = Sequence[Press]
Rows: TypeAlias = list[dict[str, Any]]


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
    splits = (
        split_folds(known) if test_recordings is None else [(known, read_presses(test_recordings))]
    )
    scores = judge(splits)
    return StudyReport(
        name="presses",
        title="Force now on real Velostat under a robot's presses",
        provenance=(
            "Real recordings with a reference load cell.",
            f"{FOLDS} folds by setting: a setting's repeats are left out together."
            if test_recordings is None
            else f"Learned from {recordings} alone.",
            "All models are given the force once per press, then all but `clock`, which sees no "
            "sensor, see resistance alone: how much force rises after that, and when, is learned "
            "like everything else. `ours`: `palpate.ForceLaw`, its population learned from the "
            "training presses; `trees` see the same states.",
            "Presses of one kind that are alike help them; the release shows what the sheet is "
            "worth.",
        ),
        tables=[
            Table.of("Force after it was given, medians over presses", scores["summary"]),
            Table.of("Held and released, medians over samples", scores["by_force"]),
        ],
        payload={**scores},
    )


command = as_command(report)


@lru_cache(maxsize=2048)
def _states(press: Press) -> FloatArray:
    reading = log_reading(press.trace.excess)
    return states_of(press.trace.time_s, reading)


def _inputs(press: Press) -> FloatArray:
    """Return the change of the states since the force was given, and that force."""
    states, given = _states(press), press.trace.given
    measured = np.full((len(states), 1), np.log(press.trace.force_n[given]))
    return np.concatenate([states - states[given], measured], axis=1)


def log_change(press: Press) -> FloatArray:
    """Return ln(force / given force); before the contact, where nothing is asked, of 0.01 N."""
    force_n = np.maximum(press.trace.force_n, 0.01)
    return np.asarray(np.log(force_n / force_n[press.trace.given]))


def _select_training(press: Press) -> NDArray[np.bool_]:
    """Return the samples to learn from."""
    place, given = np.arange(len(press.trace.time_s)), press.trace.given
    dense = (place <= given + _ALL_UNTIL) | (place > press.last_held) | (place % _EVERY == 0)
    return np.asarray((place > given) & dense)


def _pool(presses: Presses, each: Callable[[Press], FloatArray]) -> FloatArray:
    return np.concatenate([each(press)[_select_training(press)] for press in presses])


def _weight(presses: Presses) -> FloatArray:
    settings = [press.trace.group for press in presses]
    parts = []
    for press in presses:
        released = np.arange(len(press.trace.time_s)) > press.last_held
        part = np.where(released, _RELEASE_WEIGHT, 1.0)[_select_training(press)]
        parts.append(part / len(part) / settings.count(press.trace.group))
    weight = np.concatenate(parts)
    return np.asarray(weight / weight.mean())


def split_folds(presses: Presses) -> Iterator[tuple[list[Press], list[Press]]]:
    """Yield what stays and what is left out: the repeats of a setting together."""
    settings = list(dict.fromkeys(press.trace.group for press in presses))
    for fold in (settings[k::FOLDS] for k in range(min(FOLDS, len(settings)))):
        inside = [press for press in presses if press.trace.group not in fold]
        yield inside, [press for press in presses if press.trace.group in fold]


def _with_interval(follow: Callable[[Press], FloatArray], train: Presses) -> Follower:
    errors = _pool(train, lambda press: np.abs(follow(press) - log_change(press)))
    order, weight = np.argsort(errors), _weight(train)
    share = np.cumsum(weight[order]) / weight.sum()
    half = errors[order[min(int(np.searchsorted(share, LEVEL)), len(order) - 1)]]
    return lambda press: ((value := follow(press)), np.full(value.shape, half))


def clock(train: Presses) -> Follower:
    """Learn the usual change of force at each time since it was given."""

    def ticks(press: Press) -> FloatArray:
        since_s = press.trace.time_s - press.trace.time_s[press.trace.given]
        return np.asarray(np.round(since_s / _TICK_S))

    tick, change = _pool(train, ticks), _pool(train, log_change)
    order = np.argsort(tick, kind="stable")
    seen, starts = np.unique(tick[order], return_index=True)
    usual = np.array([np.median(part) for part in np.split(change[order], starts[1:])])
    return _with_interval(lambda press: np.asarray(np.interp(ticks(press), seen, usual)), train)


def static(train: Presses) -> Follower:
    """Learn a power law of the change of the reading, by least absolute error."""

    def reading(press: Press) -> FloatArray:
        return _inputs(press)[:, 0]

    x, y, weight = _pool(train, reading), _pool(train, log_change), _weight(train)
    slope, share = 1.0, weight
    for _ in range(20):
        slope = float((share * x) @ y / max(float((share * x) @ x), 1e-12))
        share = weight / np.maximum(np.abs(y - slope * x), 0.01)
    return _with_interval(lambda press: slope * reading(press), train)


def trees(train: Presses) -> Follower:
    """Learn boosted trees on the states since the force was given."""
    machine = make_trees(loss="absolute_error", max_iter=_ROUNDS, early_stopping=False)
    inputs = np.concatenate([_inputs(press)[_select_training(press)] for press in train])
    machine.fit(inputs, _pool(train, log_change), sample_weight=_weight(train))
    return _with_interval(lambda press: np.asarray(machine.predict(_inputs(press))), train)


def ours(train: Presses) -> Follower:
    """Learn the population of `palpate.ForceLaw`; the measured force updates it."""
    population = learn_population([make_known_contact(press) for press in train])

    def follow(press: Press) -> Prediction:
        states, given = _states(press), press.trace.given
        law, given_n = ForceLaw(population), float(press.trace.force_n[given])
        law.update(states[given], force_n=given_n)
        value, sd = law.log_force(states)
        return value - np.log(given_n), interval_quantile(LEVEL) * sd

    return follow


def make_known_contact(press: Press) -> KnownContact:
    """Return a press, from the measured force on, as what a population is learned from."""
    training = _select_training(press) & (press.trace.force_n > 0)
    used = np.r_[press.trace.given, np.flatnonzero(training)]
    weight = np.where(used > press.last_held, _RELEASE_WEIGHT, 1.0)
    return KnownContact(
        inputs=_states(press)[used],
        force_n=press.trace.force_n[used],
        weight=weight / weight.mean(),
        # Repeats of a setting are at several places of the sensor.
        place=(press.recording_id, press.press),
        given=0,
    )


MODELS: Mapping[str, Callable[[Presses], Follower]] = {
    "clock": clock,
    "static": static,
    "trees": trees,
    "ours": ours,
}


class Followed(NamedTuple):
    """A model's answer on a press, at each sample after the force was given."""

    press: Press
    #: ln(estimated / true force), and whether the interval holds the true force.
    log_error: FloatArray
    covered: NDArray[np.bool_]

    @property
    def is_released(self) -> NDArray[np.bool_]:
        """Whether each sample comes after the last with as much force as given."""
        given = self.press.trace.given
        return np.arange(given + 1, len(self.press.trace.time_s)) > self.press.last_held


def compare_with_cell(press: Press, prediction: Prediction) -> Followed:
    """Return a model's answer next to the load cell, from the given force on."""
    given = press.trace.given
    change, half = (part[given + 1 :] for part in prediction)
    given_n, truth_n = float(press.trace.force_n[given]), press.trace.force_n[given + 1 :]
    value_n, low_n, high_n = (
        given_n * np.exp(each) for each in (change, change - half, change + half)
    )
    covered = (low_n <= truth_n) & (truth_n <= high_n)
    return Followed(press, np.asarray(np.log(value_n / truth_n)), covered)


def judge(splits: Iterable[tuple[Presses, Presses]]) -> dict[str, Any]:
    """Follow every held-out press by every model, learned on the others; score it."""
    followed: dict[str, list[Followed]] = {name: [] for name in MODELS}
    for train, tested in splits:
        for name, learn in MODELS.items():
            model = learn(train)
            followed[name] += [compare_with_cell(press, model(press)) for press in tested]
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
        "by_force": _by_part(followed),
        "compared": _compare_models(followed),
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
            "coverage": float(np.mean([np.mean(one.covered) for one in each])),
        }
        for setting, by_model in settings.items()
        for model, each in by_model.items()
    ]


def _by_part(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over samples, while the force is held and where it is released."""
    rows: Rows = []
    for model, each in followed.items():
        log_error, covered, released = (
            np.concatenate([getattr(one, name) for one in each])
            for name in ("log_error", "covered", "is_released")
        )
        rows += [
            {
                "model": model,
                "part": name,
                "samples": int(mine.sum()),
                "median_abs_log_error": float(np.median(np.abs(log_error[mine]))),
                "coverage": float(np.mean(covered[mine])),
            }
            for name, mine in (("held", ~released), ("released", released))
            if mine.any()
        ]
    return rows


def _compare_models(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return our error less that of each other model, by setting of the presses.

    Over presses it is the median error of each, over the release that of each sample.
    """

    def select_release(each: Sequence[Followed]) -> FloatArray:
        return np.concatenate([np.abs(one.log_error[one.is_released]) for one in each])

    ours = followed["ours"]
    presses = {
        model: [float(np.median(np.abs(one.log_error))) for one in each]
        for model, each in followed.items()
    }
    rows = compare(presses, [one.press.trace.group for one in ours], part="presses")
    groups = [one.press.trace.group for one in ours for _ in range(int(one.is_released.sum()))]
    # Recordings of presses that are never let go have no release.
    if groups:
        lost = {model: select_release(each) for model, each in followed.items()}
        rows += compare(lost, groups, part="released")
    return rows
