"""Current force during real presses, from resistance and one measured force.

The models are a clock, a static law, boosted trees and the force law of palpate. Each model is
given the force once and predicts ln(force / given force) and the half width of its interval at
every sample. All models are trained on other presses. Every setting has the same weight, because
the test is on new settings.
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
from palpate.force.force_states import compute_states, log_reading
from palpate.measurement import half_width_sds
from palpate_studies.baselines.full_input_learners import make_trees
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.press_data import Press, read_presses
from palpate_studies.protocol.paired import compare
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import find_weighted_quantile, group

LEVEL = 0.9
FOLDS = 5
#: Weight of a release sample: a release is only two or three samples long.
_RELEASE_WEIGHT = 5.0
#: Training samples: this many after the force is given, then every n-th sample of the hold.
_ALL_UNTIL, _EVERY = 30, 4
_TICK_S = 0.02
#: Number of boosted trees, not tuned.
_ROUNDS = 200

Prediction: TypeAlias = tuple[FloatArray, FloatArray]
Follower: TypeAlias = Callable[[Press], Prediction]
Presses: TypeAlias = Sequence[Press]
Rows: TypeAlias = list[dict[str, Any]]


def report(
    *,
    recordings: Annotated[
        Path, typer.Option(help="Training recordings of presses.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(help="Recordings to track; by default 5 folds by setting.", metavar="CSV"),
    ] = None,
) -> StudyReport:
    """Track the force of real presses from resistance, given the force once per press.

    Example: palpate study presses --recordings presses.csv.gz
    """
    known = read_presses(recordings)
    splits = (
        split_folds(known) if test_recordings is None else [(known, read_presses(test_recordings))]
    )
    scores = judge(splits)
    return StudyReport(
        name="presses",
        title="Current force on real Velostat during robot presses",
        provenance=(
            "Real recordings with a reference load cell.",
            f"{FOLDS} folds by setting: all repeats of a setting are held out together."
            if test_recordings is None
            else f"Trained on {recordings} alone.",
            "All models are given the force once per press. After that they use resistance alone, "
            "except `clock`, which uses no sensor. `palpate` is `palpate.ForceLaw` with a "
            "population learned from the training presses; `trees` have the same states as inputs.",
            "Similar presses make the models look better while the force is held; the release "
            "shows the contribution of the sheet.",
        ),
        tables=[
            Table.of("Force after the given force, medians over presses", scores["summary"]),
            Table.of("Hold and release, medians over samples", scores["by_force"]),
        ],
        payload={**scores},
    )


command = as_command(report)


@lru_cache(maxsize=2048)
def _states(press: Press) -> FloatArray:
    reading = log_reading(press.trace.excess)
    return compute_states(press.trace.time_s, reading)


def _inputs(press: Press) -> FloatArray:
    """Return the change of the states since the given force, and that force."""
    states, given = _states(press), press.trace.given
    measured = np.full((len(states), 1), np.log(press.trace.force_n[given]))
    return np.concatenate([states - states[given], measured], axis=1)


def log_change(press: Press) -> FloatArray:
    """Return ln(force / given force), with forces of at least 0.01 N."""
    force_n = np.maximum(press.trace.force_n, 0.01)
    return np.asarray(np.log(force_n / force_n[press.trace.given]))


def _select_training(press: Press) -> NDArray[np.bool_]:
    """Return a mask of the training samples of a press."""
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
    """Yield training and test presses, with all repeats of a setting together."""
    settings = list(dict.fromkeys(press.trace.group for press in presses))
    for fold in (settings[k::FOLDS] for k in range(min(FOLDS, len(settings)))):
        inside = [press for press in presses if press.trace.group not in fold]
        yield inside, [press for press in presses if press.trace.group in fold]


def _with_interval(follow: Callable[[Press], FloatArray], train: Presses) -> Follower:
    errors = _pool(train, lambda press: np.abs(follow(press) - log_change(press)))
    half = find_weighted_quantile(errors, _weight(train), LEVEL)
    return lambda press: ((value := follow(press)), np.full(value.shape, half))


def learn_clock(train: Presses) -> Follower:
    """Learn the median change of force at each time since the given force."""

    def ticks(press: Press) -> FloatArray:
        since_s = press.trace.time_s - press.trace.time_s[press.trace.given]
        return np.asarray(np.round(since_s / _TICK_S))

    tick, change = _pool(train, ticks), _pool(train, log_change)
    order = np.argsort(tick, kind="stable")
    seen, starts = np.unique(tick[order], return_index=True)
    usual = np.array([np.median(part) for part in np.split(change[order], starts[1:])])
    return _with_interval(lambda press: np.asarray(np.interp(ticks(press), seen, usual)), train)


def learn_static_law(train: Presses) -> Follower:
    """Learn a power law of the change of the reading with least absolute error."""

    def reading(press: Press) -> FloatArray:
        return _inputs(press)[:, 0]

    x, y, weight = _pool(train, reading), _pool(train, log_change), _weight(train)
    slope, reweighted = 1.0, weight
    for _ in range(20):
        slope = float((reweighted * x) @ y / max(float((reweighted * x) @ x), 1e-12))
        reweighted = weight / np.maximum(np.abs(y - slope * x), 0.01)
    return _with_interval(lambda press: slope * reading(press), train)


def learn_trees(train: Presses) -> Follower:
    """Learn boosted trees on the change of the states since the given force."""
    machine = make_trees(loss="absolute_error", max_iter=_ROUNDS, early_stopping=False)
    inputs = np.concatenate([_inputs(press)[_select_training(press)] for press in train])
    machine.fit(inputs, _pool(train, log_change), sample_weight=_weight(train))
    return _with_interval(lambda press: np.asarray(machine.predict(_inputs(press))), train)


def learn_force_law(train: Presses) -> Follower:
    """Learn the population of `palpate.ForceLaw`; the measured force updates it."""
    population = learn_population([make_known_contact(press) for press in train])

    def follow(press: Press) -> Prediction:
        states, given = _states(press), press.trace.given
        law, given_n = ForceLaw(population), float(press.trace.force_n[given])
        law.update(states[given], force_n=given_n)
        value, sd = law.log_force(states)
        return value - np.log(given_n), half_width_sds(LEVEL) * sd

    return follow


def make_known_contact(press: Press) -> KnownContact:
    """Return a press from its given force as training data of a population."""
    training = _select_training(press) & (press.trace.force_n > 0)
    used = np.r_[press.trace.given, np.flatnonzero(training)]
    weight = np.where(used > press.last_held, _RELEASE_WEIGHT, 1.0)
    return KnownContact(
        inputs=_states(press)[used],
        force_n=press.trace.force_n[used],
        weight=weight / weight.mean(),
        # The repeats of a setting are at different places on the sensor.
        place=(press.recording_id, press.press),
        given=0,
    )


MODELS: Mapping[str, Callable[[Presses], Follower]] = {
    "clock": learn_clock,
    "static": learn_static_law,
    "trees": learn_trees,
    "ours": learn_force_law,
}


class Followed(NamedTuple):
    """A model's predictions for a press, at each sample after the given force."""

    press: Press
    #: ln(estimated / true force), and whether the interval covers the true force.
    log_error: FloatArray
    covered: NDArray[np.bool_]

    @property
    def is_released(self) -> NDArray[np.bool_]:
        """Whether each sample is after the last sample at or above the given force."""
        given = self.press.trace.given
        return np.arange(given + 1, len(self.press.trace.time_s)) > self.press.last_held


def compare_with_cell(press: Press, prediction: Prediction) -> Followed:
    """Compare a model's predictions with the load cell after the given force."""
    given = press.trace.given
    change, half = (part[given + 1 :] for part in prediction)
    given_n, truth_n = float(press.trace.force_n[given]), press.trace.force_n[given + 1 :]
    value_n, low_n, high_n = (
        given_n * np.exp(each) for each in (change, change - half, change + half)
    )
    covered = (low_n <= truth_n) & (truth_n <= high_n)
    return Followed(press, np.asarray(np.log(value_n / truth_n)), covered)


def judge(splits: Iterable[tuple[Presses, Presses]]) -> dict[str, Any]:
    """Track every held-out press with every trained model; score the predictions."""
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
        "summary": _summarise(followed),
        "by_force": _summarise_by_part(followed),
        "compared": _compare_models(followed),
        "level": LEVEL,
    }


def _summarise(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over presses, for all presses and for each setting."""
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


def _summarise_by_part(followed: Mapping[str, Sequence[Followed]]) -> Rows:
    """Return medians over samples, separately for hold and release."""
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
    """Compare the error of `ours` with each other model, with settings as specimens.

    The case is a press with its median error, or a sample of the release.
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
    # Some recordings contain no release.
    if groups:
        lost = {model: select_release(each) for model, each in followed.items()}
        rows += compare(lost, groups, part="released")
    return rows
