"""Learning the population of the force law from synthetic touches."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.force_law import ForceLaw, Population
from palpate.estimate.force_states import compute_states, log_reading
from palpate_studies.force_learning import KnownContact, learn_population


def contacts(*, seed: int, count: int = 40, gain_sd: float = 0.4) -> list[KnownContact]:
    """Return synthetic touches: a power law with a gain per place, and creep."""
    rng = np.random.default_rng(seed)
    found = []
    for place in range(count // 2):
        gain = np.exp(rng.normal(0.0, gain_sd))
        for _ in range(2):
            time_s = np.arange(0.0, 1.0, 0.01)
            peak = rng.uniform(4, 12)
            force = np.interp(time_s, [0.2, 0.4, 0.8, 0.9], [0.0, peak, peak, 0.0])
            creep = 1.0 + 0.2 * np.log1p(np.maximum(time_s - 0.2, 0.0) / 0.05)
            excess = 3.0 * gain * force**1.2 * creep * np.exp(0.02 * rng.standard_normal(100))
            used = force >= 0.5
            found.append(
                KnownContact(
                    inputs=compute_states(time_s, log_reading(excess))[used],
                    force_n=force[used],
                    weight=np.ones(used.sum()),
                    place=place,
                    given=int(np.argmax(force[used] >= 0.8 * peak)),
                )
            )
    return found


def errors(population: Population, *, given: str) -> tuple[float, float]:
    """Return the median |ln error| and the coverage on contacts of other places."""
    off, covered = [], []
    tested = contacts(seed=2)
    for one, other in zip(tested[::2], tested[1::2], strict=True):
        law = ForceLaw(population)
        if given == "place":
            law = ForceLaw.fit(
                other.inputs,
                force_n=other.force_n,
                contact=[0] * len(other.force_n),
                population=population,
            )
        first = 0
        if given == "once":
            assert one.given is not None
            law.update(one.inputs[one.given], force_n=one.force_n[one.given])
            first = one.given + 1
        mean, sd = law.log_force(one.inputs[first:])
        error = np.abs(mean - np.log(one.force_n[first:]))
        off.append(error)
        covered.append(error <= 1.645 * sd)
    return float(np.median(np.concatenate(off))), float(np.mean(np.concatenate(covered)))


def test_known_forces_reduce_error_with_covering_intervals() -> None:
    population = learn_population(contacts(seed=1))
    nothing, place, once = (errors(population, given=t) for t in ("nothing", "place", "once"))
    assert place[0] < 0.35 * nothing[0]
    assert once[0] < 0.35 * nothing[0]
    for _, coverage in (nothing, place, once):
        assert 0.8 <= coverage <= 1.0


def test_learn_population_without_contacts_raises() -> None:
    with pytest.raises(CalibrationError, match="no contact"):
        learn_population([])
