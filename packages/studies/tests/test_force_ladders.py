"""The ladder study on synthetic and real ladders, and the learned population of the law."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from palpate.force.force_law import ForceLaw, Population
from palpate.force.force_states import compute_states, log_reading
from palpate_studies.force_learning import KnownContact, learn_population

LOADS_N = [0.0, 0.6, 1.2, 1.1, 1.6, 2.0, 3.0, 4.0, 6.0, 9.0]


def ladder_csv(path: Path, names: str) -> Path:
    """Write synthetic ladders, one per letter of `names`, with random gain and exponent."""
    lines = ["ladder,step,load_n,resistance_ohm,spread_ohm"]
    for name in names:
        rng = np.random.default_rng(ord(name))
        exponent, gain = rng.normal(1.1, 0.2), rng.normal(-3.5, 0.5)
        for step, load_n in enumerate(LOADS_N):
            excess = np.exp(gain) * load_n**exponent * np.exp(0.1 * rng.standard_normal())
            lines.append(f"{name},{step},{load_n},{1 / (0.001 + excess):.4f},0.1")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_force_ladders_scores_every_step_of_the_asked_ladders_with_every_model(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    found = document("force-ladders", "--ladders", ladder_csv(tmp_path / "a.csv", "ABC"))
    assert len(found["rows"]) == 3 * 4 * 6
    assert {row["ladder"] for row in found["rows"]} == {"A", "B", "C"}
    assert {row["load_n"] for row in found["rows"]} == {0.6, 1.2, 1.1, 2.0, 3.0, 6.0}
    assert {one["model"] for one in found["summary"]} == {"line", "power", "pooled", "ours"}
    known, tested = ladder_csv(tmp_path / "a.csv", "AB"), ladder_csv(tmp_path / "b.csv", "C")
    found = document("force-ladders", "--ladders", known, "--test-ladders", tested)
    assert {row["ladder"] for row in found["rows"]} == {"C"}


def test_ladder_predictions_depend_only_on_given_weights_and_other_ladders(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    path = ladder_csv(tmp_path / "a.csv", "ABX")
    other = tmp_path / "y.csv"
    other.write_text(re.sub(r"X,(\d),6\.0,", r"X,\1,7.0,", path.read_text()))
    answers = []
    for ladders in (path, other):
        found = document("force-ladders", "--ladders", ladders)["rows"]
        rows = [row for row in found if row["ladder"] == "X"]
        answers.append([row["predicted_n"] for row in rows])
    assert answers[0] == answers[1]


def test_force_law_on_real_ladders_beats_power_and_pooled_laws(
    real_data: Path, document: Callable[..., Any]
) -> None:
    ladders = real_data / "velostat_force_ladders.csv"
    found = document("force-ladders", "--ladders", ladders)
    error = {(one["ladder"], one["model"]): one["median_abs_log_ratio"] for one in found["summary"]}
    names = {name for name, _ in error}
    ours, power, pooled = (
        np.mean([error[name, model] for name in names]) for model in ("ours", "power", "pooled")
    )
    assert ours <= 0.25
    assert ours < 0.8 * power < 0.8 * pooled
    covered = [
        row["low_n"] <= row["load_n"] <= row["high_n"]
        for row in found["rows"]
        if row["model"] == "ours"
    ]
    assert 0.8 <= np.mean(covered) <= 0.97


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
