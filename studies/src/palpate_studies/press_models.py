"""Models that follow a press: a clock, a static law, boosted trees, the law of palpate.

Each is given the force once and answers with ln(force / given force) at every sample, and with the
half width of its interval. Everything is learned from training presses; every setting counts as
much as every other, because a setting that nobody has seen is the task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.estimate.force_states import log_reading, states_of
from palpate_studies.baselines.told_everything import boosted_trees
from palpate_studies.force_learning import KnownContact, interval_reach, learn_population
from palpate_studies.press_data import Press

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


@lru_cache(maxsize=2048)
def _states(press: Press) -> FloatArray:
    reading = log_reading(press.trace.excess)
    return states_of(press.trace.time_s, reading)


def _inputs(press: Press) -> FloatArray:
    """Return the change of the states since the force was given, and that force."""
    states, given = _states(press), press.trace.told
    measured = np.full((len(states), 1), np.log(press.trace.force_n[given]))
    return np.concatenate([states - states[given], measured], axis=1)


def log_change(press: Press) -> FloatArray:
    """Return ln(force / given force); before the contact, where nothing is asked, of 0.01 N."""
    force_n = np.maximum(press.trace.force_n, 0.01)
    return np.asarray(np.log(force_n / force_n[press.trace.told]))


def _seen(press: Press) -> NDArray[np.bool_]:
    """Return the samples to learn from."""
    place, given = np.arange(len(press.trace.time_s)), press.trace.told
    dense = (place <= given + _ALL_UNTIL) | (place > press.last_held) | (place % _EVERY == 0)
    return np.asarray((place > given) & dense)


def _pooled(presses: Presses, each: Callable[[Press], FloatArray]) -> FloatArray:
    return np.concatenate([each(press)[_seen(press)] for press in presses])


def _weight(presses: Presses) -> FloatArray:
    settings = [press.trace.group for press in presses]
    parts = []
    for press in presses:
        released = np.arange(len(press.trace.time_s)) > press.last_held
        part = np.where(released, _RELEASE_WEIGHT, 1.0)[_seen(press)]
        parts.append(part / len(part) / settings.count(press.trace.group))
    weight = np.concatenate(parts)
    return np.asarray(weight / weight.mean())


def folds(presses: Presses) -> Iterator[tuple[list[Press], list[Press]]]:
    """Yield what stays and what is left out: the repeats of a setting together."""
    settings = list(dict.fromkeys(press.trace.group for press in presses))
    for fold in (settings[k::FOLDS] for k in range(min(FOLDS, len(settings)))):
        inside = [press for press in presses if press.trace.group not in fold]
        yield inside, [press for press in presses if press.trace.group in fold]


def _with_interval(follow: Callable[[Press], FloatArray], train: Presses) -> Follower:
    errors = _pooled(train, lambda press: np.abs(follow(press) - log_change(press)))
    order, weight = np.argsort(errors), _weight(train)
    share = np.cumsum(weight[order]) / weight.sum()
    half = errors[order[min(int(np.searchsorted(share, LEVEL)), len(order) - 1)]]
    return lambda press: ((value := follow(press)), np.full(value.shape, half))


def clock(train: Presses) -> Follower:
    """Learn the usual change of force at each time since it was given."""

    def ticks(press: Press) -> FloatArray:
        since_s = press.trace.time_s - press.trace.time_s[press.trace.told]
        return np.asarray(np.round(since_s / _TICK_S))

    tick, change = _pooled(train, ticks), _pooled(train, log_change)
    order = np.argsort(tick, kind="stable")
    seen, starts = np.unique(tick[order], return_index=True)
    usual = np.array([np.median(part) for part in np.split(change[order], starts[1:])])
    return _with_interval(lambda press: np.asarray(np.interp(ticks(press), seen, usual)), train)


def static(train: Presses) -> Follower:
    """Learn a power law of the change of the reading, by least absolute error."""

    def reading(press: Press) -> FloatArray:
        return _inputs(press)[:, 0]

    x, y, weight = _pooled(train, reading), _pooled(train, log_change), _weight(train)
    slope, share = 1.0, weight
    for _ in range(20):
        slope = float((share * x) @ y / max(float((share * x) @ x), 1e-12))
        share = weight / np.maximum(np.abs(y - slope * x), 0.01)
    return _with_interval(lambda press: slope * reading(press), train)


def trees(train: Presses) -> Follower:
    """Learn boosted trees on the states since the force was given."""
    machine = boosted_trees(loss="absolute_error", max_iter=_ROUNDS, early_stopping=False)
    inputs = np.concatenate([_inputs(press)[_seen(press)] for press in train])
    machine.fit(inputs, _pooled(train, log_change), sample_weight=_weight(train))
    return _with_interval(lambda press: np.asarray(machine.predict(_inputs(press))), train)


def ours(train: Presses) -> Follower:
    """Learn the population of `palpate.ForceLaw`; the measured force updates it."""
    population = learn_population([known_contact(press) for press in train])

    def follow(press: Press) -> Prediction:
        states, given = _states(press), press.trace.told
        law, given_n = ForceLaw(population), float(press.trace.force_n[given])
        law.update(states[given], force_n=given_n)
        value, sd = law.log_force(states)
        return value - np.log(given_n), interval_reach(LEVEL) * sd

    return follow


def known_contact(press: Press) -> KnownContact:
    """Return a press, from the measured force on, as what a population is learned from."""
    used = np.r_[press.trace.told, np.flatnonzero(_seen(press) & (press.trace.force_n > 0))]
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
