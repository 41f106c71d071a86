"""Learn the population of a force law from recordings with a load cell."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.force.force_law import (
    MEMORY_FRACTION,
    MOST_SAMPLES,
    Population,
    noise_inputs,
    scale_memory,
    standardise,
    with_curve,
)
from palpate_studies.rows import find_weighted_quantile

#: Prior standard deviation over sensors of the constant and of each other weight (ln N, guesses),
#: and the weight of the prior in contacts.
_PRIOR_SD, _PRIOR_CONTACTS = (0.5, 0.1), 2.0
#: Spread from contact to contact as a fraction of the spread over sensors, if no place was touched
#: twice.
_CONTACT_FRACTION = 0.1
#: Weight of the relation within a contact relative to the change since a force was measured.
_WITHIN = 0.1
_RIDGE = 1e-3
#: Scale of errors that are small enough (ln), and degrees of freedom of the Student weights of
#: larger errors.
_GOOD_ENOUGH, _FREEDOM = 0.02, 4.0
#: Percentile of the training forces that defines the weakest force.
_WEAKEST_PERCENTILE = 1.0
_ROUNDS, _EM_ROUNDS, _REWEIGHTINGS = 3, 6, 15
#: Normal quantile and level of the interval to which the scatter is scaled.
_AT_LEVEL, _LEVEL = 1.645, 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownContact:
    """One contact with the measured force at each sample.

    Attributes
    ----------
    inputs : ndarray, shape (n, INPUTS)
        Inputs computed by `ForceStates`.
    force_n : ndarray, shape (n,)
        Newtons, above 0.
    place : hashable
        Key shared by contacts at one place of one sensor.
    weight : ndarray, shape (n,), optional
        Weight of each sample; equal by default.
    given : int or None
        Sample at which the force would be measured once; None without a measurement.
    """

    inputs: FloatArray
    force_n: FloatArray
    place: Hashable
    weight: FloatArray | None = None
    given: int | None = None


@dataclass(slots=True, eq=False)
class _Fit:
    """Contacts as regressors, and the population fitted to them."""

    design: list[FloatArray]
    log_n: list[FloatArray]
    weight: list[FloatArray]
    given: list[int | None]
    population: Population


def learn_population(contacts: Sequence[KnownContact]) -> Population:
    """Learn weights, their spread and the scatter from contacts with known forces.

    The mean is fitted to changes within contacts with least absolute error: gains differ from place
    to place, and a regression over all contacts would flatten the law. The spread is estimated by
    expectation maximisation from the deviations of the contacts.

    Raises
    ------
    CalibrationError
        If no contact has two samples, or a value is not finite.
    """
    contacts = [one for one in contacts if len(one.force_n) > 1]
    if not contacts:
        raise CalibrationError(
            "no contact has two measured forces; a population needs at least one such contact"
        )
    fit = _initialise(contacts)
    deviations: list[FloatArray] = []
    for _ in range(_ROUNDS):
        _fit_mean(fit)
        deviations = _fit_spread(fit)
    population = fit.population
    by_place: dict[Hashable, list[FloatArray]] = defaultdict(list)
    for one, deviation in zip(contacts, deviations, strict=True):
        by_place[one.place].append(deviation)
    repeats = [
        (np.array(each) - np.mean(each, axis=0)) * np.sqrt(len(each) / (len(each) - 1))
        for each in by_place.values()
        if len(each) > 1
    ]
    contact_spread = _CONTACT_FRACTION * population.spread
    if repeats:
        changes = np.concatenate(repeats)
        contact_spread = (changes.T @ changes + contact_spread) / (len(changes) + 1)
    return replace(population, contact_spread=contact_spread)


def _initialise(contacts: Sequence[KnownContact]) -> _Fit:
    every = with_curve(np.concatenate([one.inputs for one in contacts]))
    log_n = [np.log(one.force_n) for one in contacts]
    if not (np.isfinite(every).all() and np.isfinite(np.concatenate(log_n)).all()):
        raise CalibrationError("a reading is not finite or a force is not positive; remove it")
    centre, scale = every.mean(axis=0), every.std(axis=0)
    scale[scale < 1e-9] = 1.0
    design = []
    for one in contacts:
        z = standardise(one.inputs, centre=centre, scale=scale)
        later = np.arange(len(z)) > (len(z) if one.given is None else one.given)
        design.append(np.column_stack([np.ones(len(z)), z, later]))
    size = design[0].shape[1]
    spread = _prior_spread(size)
    population = Population(
        centre=centre,
        scale=scale,
        mean=np.zeros(size),
        spread=spread,
        contact_spread=spread,
        noise=np.array([np.log(0.15), 0.0, 0.0, 0.0]),
        least_n=float(np.exp(np.percentile(np.concatenate(log_n), _WEAKEST_PERCENTILE))),
    )
    return _Fit(
        design=design,
        log_n=log_n,
        weight=[
            np.ones(len(one.force_n)) if one.weight is None else np.asarray(one.weight, dtype=float)
            for one in contacts
        ],
        given=[one.given for one in contacts],
        population=population,
    )


def _prior_spread(size: int) -> FloatArray:
    sd = np.full(size, _PRIOR_SD[1])
    sd[0] = _PRIOR_SD[0]
    # The weight of having measured a force is known.
    sd[-1] = 1e-3
    return np.diag(sd**2)


def _fit_mean(fit: _Fit) -> None:
    """Fit the weights to changes within contacts, and the constant to their means."""
    population = fit.population
    rows, targets, weights = [], [], []
    each = zip(fit.design, fit.log_n, fit.weight, fit.given, strict=True)
    for design, log_n, weight, given in each:
        before = _before_measurement(design)
        middle = np.average(before, axis=0, weights=weight)
        rows.append(before - middle)
        targets.append(log_n - np.average(log_n, weights=weight))
        weights.append((_WITHIN if given is not None else 1.0) * weight)
        if given is None or given == len(log_n) - 1:
            continue
        after, at = design[given + 1 :], design[given]
        memory = scale_memory(population.spread, MEMORY_FRACTION) @ at
        gain = (after @ memory) / (at @ memory + population.variance(at[None])[0])
        rows.append(after - gain[:, None] * at)
        targets.append(log_n[given + 1 :] - gain * log_n[given] - (1 - gain) * population.mean[0])
        weights.append(weight[given + 1 :])
    x, y, w = np.concatenate(rows), np.concatenate(targets), np.concatenate(weights)
    x[:, 0] = 0.0
    mean, weight_factor = np.zeros(x.shape[1]), np.ones(len(y))
    for _ in range(_REWEIGHTINGS):
        weighed = x * (w * weight_factor)[:, None]
        normal = weighed.T @ x + _RIDGE * w.sum() * np.eye(x.shape[1])
        mean = np.linalg.solve(normal, weighed.T @ y)
        weight_factor = 1.0 / np.maximum(np.abs(y - x @ mean), _GOOD_ENOUGH)
        weight_factor /= np.average(weight_factor, weights=w)
    mean[0] = np.mean(
        [
            np.average(log_n - _before_measurement(design) @ mean, weights=weight)
            for design, log_n, weight in zip(fit.design, fit.log_n, fit.weight, strict=True)
        ]
    )
    fit.population = replace(population, mean=mean)


def _before_measurement(design: FloatArray) -> FloatArray:
    """Return the regressors without a measured force."""
    return np.column_stack([design[:, :-1], np.zeros(len(design))])


def _fit_spread(fit: _Fit) -> list[FloatArray]:
    """Fit the spread of the weights and the scatter; return the contacts' deviations."""
    deviations: list[FloatArray] = []
    robust = [np.ones(len(log_n)) for log_n in fit.log_n]
    for _ in range(_EM_ROUNDS):
        population = fit.population
        precision = np.linalg.inv(population.spread)
        deviations, total, errors = [], np.zeros_like(precision), []
        for place, (design, log_n) in enumerate(zip(fit.design, fit.log_n, strict=True)):
            x, weight = _before_measurement(design), fit.weight[place]
            weight_factor = min(MOST_SAMPLES / weight.sum(), 1.0)
            variance = population.variance(x)
            weighed = x * (weight_factor * weight * robust[place] / variance)[:, None]
            covariance = np.linalg.inv(weighed.T @ x + precision)
            left = log_n - x @ population.mean
            deviation = covariance @ (weighed.T @ left)
            left = left - x @ deviation
            robust[place] = (_FREEDOM + 1) / (_FREEDOM + left**2 / variance)
            errors.append(np.sqrt(left**2 + np.einsum("ni,ij,nj->n", x, covariance, x)))
            deviations.append(deviation)
            total += np.outer(deviation, deviation) + covariance
        prior = _prior_spread(len(total))
        count = len(deviations)
        fit.population = replace(
            population,
            spread=(total + _PRIOR_CONTACTS * prior) / (count + _PRIOR_CONTACTS),
            noise=_fit_noise(fit, np.concatenate(errors)),
        )
    return deviations


def _fit_noise(fit: _Fit, error: FloatArray) -> FloatArray:
    """Fit the logarithm of the scatter as a linear function of its inputs."""
    x = noise_inputs(np.concatenate(fit.design))
    weight = np.concatenate(fit.weight)
    weighed = x * weight[:, None]
    normal = weighed.T @ x + 1e-3 * weight.sum() * np.diag([0.0, 1.0, 1.0, 1.0])
    line = np.linalg.solve(normal, weighed.T @ np.log(error + 0.5 * _GOOD_ENOUGH))
    ratio = error / np.exp(x @ line)
    line[0] += np.log(find_weighted_quantile(ratio, weight, _LEVEL) / _AT_LEVEL)
    return np.asarray(line)
