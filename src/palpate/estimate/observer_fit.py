"""Learn an observer from traces of readings beside a reference force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.stats import norm, t

from palpate.errors import CalibrationError
from palpate.estimate.creep import TIME_CONSTANTS_S, CreepStates, FloatArray, loading_sensitivity
from palpate.estimate.object_states import ObjectStates
from palpate.estimate.observer import LOOK_BACK_S, ObserverModel

#: Shares of a press's own sensitivity that the fit chooses from.
SHARINGS = (0.0, 0.25, 0.5, 0.75, 1.0)
#: How much less a change may count under a large load, that the fit chooses from.
EASINGS = (0.0, 0.2, 0.4, 0.6, 0.8)
#: Such easing is taken where it leaves no more than this share of the error on groups left out.
_EARNED = 0.85
#: Errors of ln force below this are as good as none: keeps the absolute-error fit smooth.
GOOD_ENOUGH = 0.03
#: Weight of the samples before the force is told beside those after it, which are the task.
LOADING_WEIGHT = 0.3
#: A sample is one of unloading where conductance fell by more than noise: `fall` above ln 2.
UNLOADING_FALL = float(np.log(2.0))
#: A group with fewer unloading samples than this teaches nothing of unloading.
MIN_UNLOADING = 3
#: Left-out parts of the data from which the spread is learned.
FOLDS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """One loading of one sheet with its reference force.

    Attributes
    ----------
    time_s, excess, resolution, force_n : ndarray, shape (n_times,)
        From before the contact on. `excess` is the conductance G/G0 - 1, `resolution` the change of
        it that one digit of the readout makes.
    first, told : int
        Sample from which the force is above the threshold, and sample at which it is told.
    group : str
        Traces of one group (a sensor, a setting) are left out together where errors are estimated.
    deformation : ndarray, shape (n_times,), optional
        How far the object is closed upon beyond first contact, in any unit, where that is known.
    """

    time_s: FloatArray
    excess: FloatArray
    resolution: FloatArray
    force_n: FloatArray
    first: int
    told: int
    group: str
    deformation: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Features:
    """A trace as the observer sees it, from `first` on; changes are since the force was told."""

    since_s: FloatArray
    states: FloatArray
    fall: FloatArray
    closed: FloatArray
    log_force: FloatArray
    sensitivity: float
    told_n: float
    weight: FloatArray
    group: str


def fit_observer(traces: Sequence[Trace], *, memory: bool = True) -> ObserverModel:
    """Learn the weights by least absolute error, and the spread from traces left out.

    Parameters
    ----------
    traces : sequence of Trace
        Loadings of as many sheets and settings as there are.
    memory : bool
        False learns a static power law: no creep, no unloading, one exponent for all.

    Raises
    ------
    CalibrationError
        If there are fewer than ten traces: their scatter would not show.
    """
    if len(traces) < 10:
        raise CalibrationError(f"{len(traces)} loadings with a reference force, at least 10 needed")
    constants = TIME_CONSTANTS_S if memory else ()
    features = [_features(trace, time_constants_s=constants) for trace in traces]
    choices = list(product(SHARINGS, EASINGS)) if memory else [(0.0, 0.0)]
    tried = [
        _left_out(features, constants, sharing=sharing, easing=easing)
        for sharing, easing in choices
    ]
    # An exponent that depends on the load is carried far beyond the loads seen: it must earn that.
    errors = [
        _mean_error(held_out) / (_EARNED if easing > 0 else 1.0)
        for held_out, (_, easing) in zip(tried, choices, strict=True)
    ]
    best = int(np.argmin(errors))
    sharing, easing = choices[best]
    model = _fit_weights(features, constants, sharing=sharing, easing=easing)
    return _with_spread(model, tried[best])


def _left_out(
    features: Sequence[_Features],
    time_constants_s: tuple[float, ...],
    *,
    sharing: float,
    easing: float,
) -> list[tuple[_Features, ObserverModel]]:
    """Return each trace with a model learned without its group; with it, if there is but one."""
    groups = list(dict.fromkeys(one.group for one in features))
    held_out: list[tuple[_Features, ObserverModel]] = []
    for fold in (groups[k::FOLDS] for k in range(min(FOLDS, len(groups)))):
        inside = [one for one in features if one.group not in fold] or list(features)
        partial = _fit_weights(inside, time_constants_s, sharing=sharing, easing=easing)
        held_out += [(one, partial) for one in features if one.group in fold]
    return held_out


def _mean_error(held_out: Sequence[tuple[_Features, ObserverModel]]) -> float:
    """Return the mean |error of ln force|, every trace alike."""
    return float(
        np.mean([one.weight @ np.abs(_predicted(one, by) - one.log_force) for one, by in held_out])
    )


def _predicted(one: _Features, model: ObserverModel) -> FloatArray:
    held, unloaded = _changes(one, model)
    return held + unloaded


def _changes(one: _Features, model: ObserverModel) -> tuple[FloatArray, FloatArray]:
    return model.log_change(
        one.states,
        one.fall,
        closed=one.closed,
        sensitivity=np.array(one.sensitivity),
        told_n=np.array(one.told_n),
    )


def _features(trace: Trace, *, time_constants_s: tuple[float, ...]) -> _Features:
    memory = CreepStates(time_constants_s=time_constants_s)
    states, fall = [], []
    for k, time_s in enumerate(trace.time_s):
        memory.step(float(time_s), trace.excess[k : k + 1], resolution=trace.resolution[k : k + 1])
        states.append(memory.states[0].copy())
        fall.append(float(memory.fall[0]))
    all_states, all_fall, told = np.array(states), np.array(fall), trace.told
    closed = _closed(trace) if time_constants_s else np.zeros((len(trace.time_s), 2))
    seen = trace.time_s[: told + 1]
    look = int(np.searchsorted(seen, seen[-1] - LOOK_BACK_S))
    sensitivity = loading_sensitivity(seen[look:], all_states[look : told + 1, :1])
    fitted = slice(trace.first, None)
    since_s = trace.time_s[fitted] - trace.time_s[told]
    weight = np.where(since_s > 0, 1.0, LOADING_WEIGHT)
    return _Features(
        since_s=since_s,
        states=all_states[fitted] - all_states[told],
        fall=all_fall[fitted] - all_fall[told],
        closed=closed[fitted] - closed[told],
        log_force=np.log(trace.force_n[fitted] / trace.force_n[told]),
        sensitivity=float(sensitivity[0]),
        told_n=float(trace.force_n[told]),
        weight=weight / weight.sum(),
        group=trace.group,
    )


def _closed(trace: Trace) -> FloatArray:
    """Return what the closure tells at each sample; 0 where it is not known."""
    held, states = ObjectStates(), np.zeros((len(trace.time_s), 2))
    if trace.deformation is not None:
        for k, time_s in enumerate(trace.time_s):
            held.step(float(time_s), trace.deformation[k : k + 1])
            states[k] = held.states[0]
    return states


def _fit_weights(
    features: Sequence[_Features],
    time_constants_s: tuple[float, ...],
    *,
    sharing: float,
    easing: float,
) -> ObserverModel:
    """Return the model without spread."""
    design = np.concatenate(
        [
            np.hstack([one.states * one.sensitivity**-sharing, one.closed]) * one.told_n**-easing
            for one in features
        ]
    )
    target = np.concatenate([one.log_force for one in features])
    weight = np.concatenate([one.weight for one in features])
    fall = np.concatenate([one.fall for one in features])
    group = np.concatenate([np.full(one.fall.shape, one.group) for one in features])
    unloading = fall > UNLOADING_FALL
    fitted = ~unloading if time_constants_s else np.ones_like(unloading)
    weights = least_absolute(design[fitted], target[fitted], weight[fitted])
    left = target - design @ weights
    slope = 0.0
    if time_constants_s:
        slope = _unloading_slope(fall[unloading], left[unloading], group[unloading])
    return ObserverModel(
        time_constants_s=time_constants_s,
        weights=tuple(weights[:-2].tolist()),
        sharing=sharing,
        easing=easing,
        object_weights=(float(weights[-2]), float(weights[-1])),
        unloading=slope,
        spread=(0.0, 0.0, 0.0, 0.0),
        tail=1.0,
    )


def _unloading_slope(fall: FloatArray, left: FloatArray, group: NDArray[np.str_]) -> float:
    """Return the median over groups of ln force lost per unit of fall; 0 where none unloaded.

    The median, because readings that flicker can make one sensor show falls that are none.
    """
    slopes = [
        float(least_absolute(-fall[mine, None], left[mine], np.ones(np.count_nonzero(mine)))[0])
        for mine in (group == name for name in np.unique(group))
        if np.count_nonzero(mine) >= MIN_UNLOADING
    ]
    return max(float(np.median(slopes)), 0.0) if slopes else 0.0


def least_absolute(
    design: FloatArray, target: FloatArray, weight: FloatArray, *, rising: slice = slice(0)
) -> FloatArray:
    """Solve for the least absolute error by reweighting, with a trace of ridge.

    Coefficients of the `rising` columns are kept at 0 or above.
    """
    ridge = 1e-3 * weight.sum() * np.eye(design.shape[1])
    solution = np.zeros(design.shape[1])
    now = weight
    for _ in range(10):
        scaled = design * now[:, None]
        solution = _solve(scaled.T @ design + ridge, scaled.T @ target, rising)
        now = weight / np.maximum(np.abs(target - design @ solution), GOOD_ENOUGH)
    return np.asarray(solution)


def _solve(matrix: FloatArray, right: FloatArray, rising: slice) -> FloatArray:
    """Solve a positive definite system, the `rising` unknowns not below 0."""
    free = np.setdiff1d(np.arange(len(right)), np.arange(len(right))[rising])
    if free.size == len(right):
        return np.asarray(np.linalg.solve(matrix, right))
    # A free unknown enters nnls twice, with either sign.
    both = np.concatenate([np.eye(len(right)), -np.eye(len(right))[free]])
    root = np.linalg.cholesky(matrix).T
    found = nnls(root @ both.T, np.linalg.solve(root.T, right))[0]
    return np.asarray(found @ both)


def _with_spread(
    model: ObserverModel, held_out: Sequence[tuple[_Features, ObserverModel]]
) -> ObserverModel:
    terms, errors, weights = [], [], []
    for one, fitted in held_out:
        after: NDArray[np.bool_] = one.since_s > 0
        held, unloaded = (change[after] for change in _changes(one, fitted))
        clock = np.log1p(one.since_s[after] / 0.1)
        terms.append(
            np.stack([np.ones_like(held), clock, np.abs(held), np.abs(one.fall[after])], axis=1)
        )
        errors.append(np.abs(held + unloaded - one.log_force[after]))
        weights.append(np.full(held.shape, 1.0 / max(len(held), 1)))
    design, error, weight = map(np.concatenate, (terms, errors, weights))
    root = np.sqrt(weight)
    # A floor under the constant: readings are never better than the logger's last digit.
    spread = np.maximum(nnls(design * root[:, None], error * root)[0], [0.005, 0.0, 0.0, 0.0])
    ratio = error / (design @ spread)
    order = np.argsort(ratio)
    share = np.cumsum(weight[order]) / weight.sum()
    at_90 = float(ratio[order][np.searchsorted(share, 0.9)])
    # The scale is known from so many groups: Student's quantile instead of the normal one.
    few = float(t.ppf(0.95, len({one.group for one, _ in held_out})) / norm.ppf(0.95))
    return replace(
        model,
        spread=(float(spread[0]), float(spread[1]), float(spread[2]), float(spread[3])),
        tail=few * at_90 / float(norm.ppf(0.95)),
    )
