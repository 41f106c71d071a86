"""Models that follow a touch: a clock, a static law, ridge, boosted trees, and the law of palpate.

Each model is learned from training touches and returns, for a test touch, ln force at every sample
with the half width of its interval. What else it knows is `told`: nothing, the other attempts at
the same place, or the force once in this touch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from scipy.special import ndtri

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.errors import needing
from palpate.estimate.force_law import INPUTS, Population
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.stroke_data import Touch

TOLD = ("nothing", "place", "five_percent", "eighty_percent")
LEVEL = 0.9
#: A clock's time step: one sample of the logger.
_TICK_S = 0.007

Prediction: TypeAlias = tuple[FloatArray, FloatArray]
Others: TypeAlias = Sequence[Touch]
#: From a touch and the other attempts at its place to a prediction.
Follower: TypeAlias = Callable[[Touch, Others], Prediction]
Learner: TypeAlias = Callable[[Others, str], Follower]


def others_of(touch: Touch, touches: Others) -> list[Touch]:
    """Return the other attempts at the place of a touch."""
    return [one for one in touches if one.place == touch.place and one is not touch]


def _origin(touch: Touch, told: str) -> float:
    return float(touch.log_force[touch.told[told]]) if told in touch.told else 0.0


def _pooled(touches: Others, told: str, each: Callable[[Touch], FloatArray]) -> FloatArray:
    return np.concatenate([each(one)[one.after(told)] for one in touches])


def _with_interval(
    follow: Callable[[Touch, Others], FloatArray], train: Others, told: str
) -> Follower:
    """Return a follower whose interval covers the errors of its own training touches."""
    errors = [
        np.abs(follow(one, others_of(one, train)) - one.log_force)[one.after(told)] for one in train
    ]
    half = float(np.quantile(np.concatenate(errors), LEVEL))
    return lambda touch, others: (
        (value := follow(touch, others)),
        np.full(value.shape, half),
    )


def constant(train: Others, told: str) -> Follower:
    """Learn one force, that of the place where it is known, or hold the force that was measured."""

    def middle(touches: Others) -> float:
        return float(np.median(_pooled(touches, told, lambda one: one.log_force)))

    usual = 0.0 if told in train[0].told else middle(train)

    def follow(touch: Touch, others: Others) -> FloatArray:
        known = middle(others) if told == "place" and others else usual
        return np.full(len(touch.time_s), known + _origin(touch, told))

    return _with_interval(follow, train, told)


def clock(train: Others, told: str) -> Follower:
    """Learn the usual force at each time since contact, or its usual change since measured."""

    def ticks(touch: Touch) -> FloatArray:
        start = touch.time_s[touch.told[told]] if told in touch.told else 0.0
        return np.round((touch.time_s - start) / _TICK_S)

    def table(touches: Others) -> tuple[FloatArray, FloatArray]:
        tick = _pooled(touches, told, ticks)
        force = _pooled(touches, told, lambda one: one.log_force - _origin(one, told))
        seen = np.unique(tick)
        return seen, np.array([np.median(force[tick == one]) for one in seen])

    usual = table(train)

    def follow(touch: Touch, others: Others) -> FloatArray:
        known = table(others) if told == "place" and others else usual
        return np.asarray(np.interp(ticks(touch), *known)) + _origin(touch, told)

    return _with_interval(follow, train, told)


def static(train: Others, told: str) -> Follower:
    """Learn a power law; its gain from what is known of the place or of this touch."""
    reading = _pooled(train, "nothing", lambda one: one.inputs[:, 0])
    force = _pooled(train, "nothing", lambda one: one.log_force)
    slope, offset = _absolute_line(reading, force)

    def follow(touch: Touch, others: Others) -> FloatArray:
        value = slope * touch.inputs[:, 0] + offset
        if told in touch.told:
            at = touch.told[told]
            return np.asarray(value + touch.log_force[at] - value[at])
        if told == "place" and others:
            left = _pooled(others, told, lambda one: one.log_force - slope * one.inputs[:, 0])
            return np.asarray(value + float(np.median(left)) - offset)
        return np.asarray(value)

    return _with_interval(follow, train, told)


def _absolute_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return the line of least absolute error, by reweighting."""
    weight = np.ones_like(y)
    line = np.zeros(2)
    for _ in range(20):
        line = np.polyfit(x, y, 1, w=weight)
        weight = 1.0 / np.sqrt(np.maximum(np.abs(y - np.polyval(line, x)), 0.01))
    return float(line[0]), float(line[1])


def _inputs(touch: Touch, told: str) -> FloatArray:
    """Return what a learner sees: the states, or their change since the force was measured."""
    if told not in touch.told:
        return touch.inputs
    at = touch.told[told]
    measured = np.full((len(touch.inputs), 1), touch.log_force[at])
    return np.concatenate([touch.inputs - touch.inputs[at], measured], axis=1)


def trees(train: Others, told: str) -> Follower:
    """Learn boosted trees on the same inputs; knowing the place, given by the mean of it."""
    with needing("gradient boosting", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingRegressor
    machine = HistGradientBoostingRegressor(
        loss="absolute_error", max_iter=100, max_leaf_nodes=15, min_samples_leaf=40, random_state=0
    )

    def seen(touch: Touch, others: Others) -> FloatArray:
        inputs = _inputs(touch, told)
        if told != "place":
            return inputs
        known = others or [touch]
        reading = np.mean(_pooled(known, told, lambda one: one.inputs[:, 0]))
        force = np.mean(_pooled(known, told, lambda one: one.log_force))
        more = np.full((len(inputs), 1), force if others else np.nan)
        return np.concatenate([inputs, inputs[:, :1] - reading, more], axis=1)

    x = np.concatenate([seen(one, others_of(one, train))[one.after(told)] for one in train])
    y = _pooled(train, told, lambda one: one.log_force - _origin(one, told))
    w = _pooled(train, told, lambda one: one.weight)
    machine.fit(x, y, sample_weight=w)
    return _with_interval(
        lambda touch, others: machine.predict(seen(touch, others)) + _origin(touch, told),
        train,
        told,
    )


def ridge(train: Others, told: str) -> Follower:
    """Learn a ridge on the same inputs; knowing the place, with the mean error there."""

    def basis(touch: Touch) -> FloatArray:
        return np.column_stack([_inputs(touch, told), np.ones(len(touch.time_s))])

    x = _pooled(train, told, basis)
    y = _pooled(train, told, lambda one: one.log_force - _origin(one, told))
    weighed = x * _pooled(train, told, lambda one: one.weight)[:, None]
    line = np.linalg.solve(weighed.T @ x + 1e-3 * len(x) * np.eye(x.shape[1]), weighed.T @ y)

    def follow(touch: Touch, others: Others) -> FloatArray:
        value = basis(touch) @ line + _origin(touch, told)
        if told == "place" and others:
            left = _pooled(others, told, lambda one: one.log_force - basis(one) @ line)
            return np.asarray(value + float(np.median(left)))
        return np.asarray(value)

    return _with_interval(follow, train, told)


def ours(train: Others, told: str) -> Follower:
    """Learn the population of `palpate.ForceLaw`; the place or one force updates the law."""
    population = _population(tuple(train))

    def follow(touch: Touch, others: Others) -> Prediction:
        law = ForceLaw(population)
        if told == "place" and others:
            law = ForceLaw.fit(
                _pooled(others, told, lambda one: one.inputs[:, :INPUTS]),
                force_n=np.exp(_pooled(others, told, lambda one: one.log_force)),
                contact=[one.attempt for one in others for _ in range(one.scored.sum())],
                population=population,
            )
        if told in touch.told:
            at = touch.told[told]
            law.update(touch.inputs[at, :INPUTS], force_n=np.exp(touch.log_force[at]))
        value, sd = law.log_force(touch.inputs[:, :INPUTS])
        return value, float(ndtri(0.5 + LEVEL / 2)) * sd

    return follow


@lru_cache(maxsize=2)
def _population(train: tuple[Touch, ...]) -> Population:
    return learn_population([known_contact(one) for one in train if one.scored.sum() > 1])


def known_contact(touch: Touch) -> KnownContact:
    """Return a touch as what a population is learned from."""
    used = np.flatnonzero(touch.scored)
    given = np.flatnonzero(used == touch.told["eighty_percent"])
    return KnownContact(
        inputs=touch.inputs[used, :INPUTS],
        force_n=np.exp(touch.log_force[used]),
        weight=touch.weight[used],
        place=touch.place,
        given=int(given[0]) if len(given) else None,
    )


MODELS: Mapping[str, Learner] = {
    "constant": constant,
    "clock": clock,
    "static": static,
    "ridge": ridge,
    "trees": trees,
    "ours": ours,
}
