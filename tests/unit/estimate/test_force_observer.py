"""The observer on sheets that creep: what it learns, says and refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.observer import ForceObserver, ObserverModel
from palpate.estimate.observer_fit import Trace, fit_observer

MODEL = ObserverModel(
    time_constants_s=(0.3, 3.0),
    weights=(1.2, -0.2, -0.1),
    sharing=0.0,
    unloading=0.3,
    spread=(0.02, 0.02, 0.1, 0.1),
    tail=1.0,
)


def creeping(seed: int, *, group: str) -> Trace:
    """Return a loading to two random plateaus; ln conductance creeps by a log-time law."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(-0.5, 2.5, 0.02)
    first_n, second_n = rng.uniform(3, 6), rng.uniform(4, 12)
    ramp = np.interp(time_s, [0, 0.5, 1.0, 1.3, 5], [0.01, first_n, first_n, second_n, second_n])
    force = np.maximum(ramp, 0.01)
    rises = np.diff(np.log(force), prepend=np.log(force[0]))
    age = time_s[:, None] - time_s[None, :]
    growth = np.where(age >= 0, 1 + 0.12 * np.log1p(np.maximum(age, 0) / 0.05), 0.0)
    log_conductance = growth @ rises + np.log(0.01) + rng.normal(3.0, 0.6)
    excess = np.exp(log_conductance + 0.003 * rng.standard_normal(time_s.size))
    told = int(np.searchsorted(time_s, 0.45))
    return Trace(
        time_s=time_s,
        excess=excess,
        resolution=np.zeros_like(excess),
        force_n=force,
        first=int(np.searchsorted(time_s, 0.2)),
        told=told,
        group=group,
    )


def easing(seed: int, *, group: str) -> Trace:
    """Return a loading that relaxes: ln force goes 1.5 times as far as ln conductance at 1 N.

    Under larger loads it goes less far, with the inverse root of the force.
    """
    rng = np.random.default_rng(seed)
    time_s, told_n = np.arange(0.0, 5.0, 0.05), float(np.exp(rng.uniform(-0.5, 2.5)))
    fallen = rng.uniform(0.02, 0.05) * np.log1p(time_s / 0.2)
    return Trace(
        time_s=time_s,
        excess=20.0 * np.exp(-fallen),
        resolution=np.zeros_like(time_s),
        force_n=told_n * np.exp(-1.5 * told_n**-0.5 * fallen),
        first=0,
        told=0,
        group=group,
    )


def relaxing(seed: int, *, group: str) -> Trace:
    """Return two closings of an object that relaxes, beside a sheet whose contact jumps about."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 8.0, 0.05)
    again_s, further = rng.uniform(2.0, 5.0), rng.uniform(0.2, 1.0)
    ages = np.maximum(time_s, 0.0), np.maximum(time_s - again_s, 0.0)
    deformation = 1.0 + further * (time_s >= again_s)
    lost = np.log1p(ages[0] / 0.15) + further * np.log1p(ages[1] / 0.15)
    force = rng.uniform(2.0, 6.0) * (deformation - 0.05 * lost)
    jumps = np.cumsum(rng.normal(0.0, 0.02, time_s.size))
    return Trace(
        time_s=time_s,
        excess=5.0 * force * np.exp(jumps),
        resolution=np.zeros_like(time_s),
        force_n=force,
        first=0,
        told=0,
        group=group,
        deformation=deformation,
    )


def errors(model: ObserverModel, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Return |error of ln force| and coverage after the force was told."""
    observer = ForceObserver(model)
    said = []
    for k, time_s in enumerate(trace.time_s):
        known = None if trace.deformation is None else trace.deformation[k : k + 1]
        now = observer.step(float(time_s), trace.excess[k : k + 1], deformation=known)
        if k == trace.told:
            observer.tell(trace.force_n[k : k + 1])
        said.append((now.value_n[0], now.low_n[0], now.high_n[0]))
    value, low, high = np.array(said)[trace.told + 1 :].T
    truth = trace.force_n[trace.told + 1 :]
    return np.abs(np.log(value / truth)), (low <= truth) & (truth <= high)


@pytest.fixture(scope="module")
def learned() -> tuple[ObserverModel, ObserverModel]:
    """Return an observer and a static law, learned from the same forty loadings."""
    traces = [creeping(seed, group=f"sheet {seed % 8}") for seed in range(40)]
    return fit_observer(traces), fit_observer(traces, memory=False)


def test_memory_halves_the_error_on_sheets_not_learned_from(
    learned: tuple[ObserverModel, ObserverModel],
) -> None:
    fresh = [creeping(seed, group="new") for seed in range(1000, 1020)]
    ours, static = (
        np.median([np.median(errors(model, trace)[0]) for trace in fresh]) for model in learned
    )
    assert ours < 0.5 * static


def test_intervals_cover_on_sheets_not_learned_from(
    learned: tuple[ObserverModel, ObserverModel],
) -> None:
    fresh = [creeping(seed, group="new") for seed in range(2000, 2020)]
    inside = np.mean([np.mean(errors(learned[0], trace)[1]) for trace in fresh])
    assert 0.85 <= inside <= 0.995


def test_a_change_that_counts_less_under_a_large_load_is_learned() -> None:
    traces = [easing(seed, group=f"specimen {seed % 4}") for seed in range(24)]
    fresh = [easing(seed, group="new") for seed in range(500, 510)]
    observer, static = fit_observer(traces), fit_observer(traces, memory=False)
    assert 0.4 <= observer.easing <= 0.6
    assert static.easing == 0.0
    ours, plain = (
        np.median([np.median(errors(model, trace)[0]) for trace in fresh])
        for model in (observer, static)
    )
    assert ours < 0.4 * plain


def test_an_object_that_relaxes_is_followed_better_where_its_closure_is_known() -> None:
    traces = [relaxing(seed, group=f"sheet {seed % 8}") for seed in range(40)]
    fresh = [relaxing(seed, group="new") for seed in range(3000, 3020)]
    deaf = [replace(trace, deformation=None) for trace in traces]
    told, plain = (fit_observer(each) for each in (traces, deaf))
    stiffening, loss = told.object_weights
    assert stiffening > 0.3
    assert loss < -0.01
    assert plain.object_weights == pytest.approx((0.0, 0.0), abs=1e-9)
    ours = np.median([np.median(errors(told, trace)[0]) for trace in fresh])
    sheet = np.median([np.median(errors(plain, trace)[0]) for trace in fresh])
    assert ours < 0.5 * sheet


def test_a_model_that_knows_the_closure_asks_for_it() -> None:
    observer = ForceObserver(replace(MODEL, object_weights=(0.0, -0.02)))
    with pytest.raises(ValueError, match="give step a deformation"):
        observer.step(0.0, [5.0])


def test_nothing_is_said_before_a_force_was_told() -> None:
    observer = ForceObserver(MODEL, sensors=2)
    with pytest.raises(ValueError, match="needs a reading first"):
        observer.tell([1.0, 1.0])
    assert np.isnan(observer.step(0.0, [5.0, 5.0]).value_n).all()
    observer.tell([2.0, np.nan])
    now = observer.step(0.1, [5.0, 5.0])
    assert now.value_n[0] == pytest.approx(2.0)
    assert np.isnan(now.value_n[1])
    with pytest.raises(ValueError, match="above 0 N"):
        observer.tell([0.0, 1.0])


def test_the_interval_grows_with_time_and_change() -> None:
    observer = ForceObserver(MODEL)
    observer.step(0.0, [5.0])
    observer.tell([2.0])
    ratios = [
        (now.high_n / now.low_n)[0]
        for now in (
            observer.step(0.1, [5.0]),
            observer.step(5.0, [5.0]),
            observer.step(5.1, [50.0]),
        )
    ]
    assert ratios[0] < ratios[1] < ratios[2]


def test_a_sudden_fall_of_conductance_is_a_release() -> None:
    answers = []
    for unloading in (0.0, 0.3):
        observer = ForceObserver(replace(MODEL, unloading=unloading))
        observer.step(0.0, [20.0])
        observer.tell([10.0])
        answers.append(observer.step(0.014, [15.0]).value_n[0])
    assert answers[1] < 0.7 * answers[0]


def test_too_few_loadings_are_refused() -> None:
    with pytest.raises(CalibrationError, match="3 loadings"):
        fit_observer([creeping(seed, group="one") for seed in range(3)])
