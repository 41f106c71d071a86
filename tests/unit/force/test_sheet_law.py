"""The force law of a sheet calibrated with a load cell: recovery, pixels, memory, intervals."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.factories import make_sheet_law

from palpate.errors import CalibrationError
from palpate.force.gain import Gain
from palpate.force.sheet_follower import SheetFollower, SheetReader
from palpate.force.sheet_law import SheetLaw
from palpate.force.sheet_states import States, compute_states

#: Steps of a calibration, newtons, and the times at which each is read after its beginning.
STEPS_N, READ_S = (1.0, 2.0, 4.0, 7.0, 10.0), (0.42, 20.0)
CREEP = 0.04


def read_pixel(force_n: float, *, since_s: float, exponent: float, gain: float) -> float:
    """Return the excess of a sheet that creeps with the logarithm of time."""
    creep = 1.0 + CREEP * math.log(max(since_s, 0.1) / 0.1)
    return (gain * force_n) ** (1.0 / exponent) * creep


def calibrate(
    seed: int,
    *,
    placements: int = 6,
    exponent: float = 0.8,
    pixels: int = 4,
    steps_n: tuple[float, ...] = STEPS_N,
) -> list[tuple[States, np.ndarray]]:
    """Return placements of a load cell, each with its own gain and share of the pixels."""
    random, found = np.random.default_rng(seed), []
    for _ in range(placements):
        gain, share = math.exp(random.normal(0.0, 0.05)), random.dirichlet(np.full(pixels, 8.0))
        time_s, excess, forces, now_s = [0.0], [np.zeros(pixels)], [0.0], 1.0
        for force_n in steps_n:
            for since_s in READ_S:
                time_s.append(now_s + since_s)
                excess.append(
                    [
                        read_pixel(force_n * part, since_s=since_s, exponent=exponent, gain=gain)
                        for part in share
                    ]
                )
                forces.append(force_n)
            now_s += 20.0
        found.append((compute_states(time_s, excess), np.array(forces)))
    return found


def test_law_of_a_power_law_sheet_covers_forces_on_new_places() -> None:
    law = SheetLaw.fit(calibrate(1))
    errors, covered = [], []
    for states, force_n in calibrate(2, placements=20):
        value, low, high = law.force_n(states)
        loaded = force_n > 0
        errors.append(np.log(value[loaded] / force_n[loaded]))
        covered.append(((low <= force_n) & (force_n <= high))[loaded])
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.1
    assert np.mean(covered) > 0.8


def test_the_same_force_on_two_or_four_pixels_is_equal() -> None:
    law = SheetLaw.fit(calibrate(1))
    forces = []
    for share in ((0.25,) * 4, (0.5, 0.5, 0.0, 0.0)):
        read = [read_pixel(6.0 * part, since_s=20.0, exponent=0.8, gain=1.0) for part in share]
        value, _, _ = law.force_n(compute_states([0.0, 20.0], [np.zeros(4), read]))
        forces.append(float(value[1]))
    assert forces == pytest.approx([6.0, 6.0], rel=0.1)
    assert forces[1] == pytest.approx(forces[0], rel=0.05)


def test_creeping_reading_of_a_constant_force_is_constant() -> None:
    follower = SheetFollower(SheetLaw.fit(calibrate(3)))
    follower.step(0.0, np.zeros(4))
    found = [
        follower.step(
            float(since_s),
            np.full(4, read_pixel(1.5, since_s=float(since_s), exponent=0.8, gain=1.0)),
        ).value
        for since_s in np.arange(0.02, 20.0, 0.02)
    ]
    later = np.array(found[50:])
    assert later == pytest.approx(np.full(later.size, 6.0), rel=0.12)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    seed=st.integers(0, 50),
    exponent=st.floats(0.6, 1.6),
    readings=st.lists(st.floats(0.1, 1000.0), min_size=2, max_size=6, unique=True),
)
def test_force_rises_with_the_reading_also_beyond_the_calibration(
    seed: int, exponent: float, readings: list[float]
) -> None:
    law = SheetLaw.fit(calibrate(seed, placements=3, exponent=exponent))
    states = [compute_states([0.0, 1.0], [np.zeros(4), np.full(4, x)]) for x in sorted(readings)]
    forces = np.array([law.force_n(one)[0][1] for one in states])
    assert (np.diff(forces) >= 0).all()


def test_states_of_a_recording_do_not_depend_on_how_often_a_held_reading_is_read() -> None:
    held = np.array([0.5, 2.0])
    rare = compute_states([0.0, 1.0, 3.0], [np.zeros(2), held, held])
    often_s = np.r_[0.0, np.linspace(1.0, 3.0, 41)]
    often = compute_states(often_s, [np.zeros(2), *[held] * 41])
    assert often.lag[-1] == pytest.approx(rare.lag[-1])


def test_gain_of_a_contact_scales_the_force_and_replaces_the_uncertainty_of_contacts() -> None:
    plain, known = SheetFollower(make_sheet_law(2)), SheetFollower(make_sheet_law(2))
    known.gain = Gain(log_mean=math.log(1.5), log_sd=0.02, law_sd=0.2)
    one, other = plain.step(0.0, np.full(2, 3.0)), known.step(0.0, np.full(2, 3.0))
    assert other.value == pytest.approx(1.5 * one.value, rel=0.05)
    assert other.high / other.low < one.high / one.low


def test_sheet_that_never_responds_is_refused() -> None:
    with pytest.raises(CalibrationError, match="no reading rises"):
        SheetLaw.fit([(compute_states([0.0, 1.0], np.zeros((2, 4))), np.array([0.0, 5.0]))])


def test_a_stored_law_reads_as_the_fitted_one() -> None:
    law, (states, _) = SheetLaw.fit(calibrate(4)), calibrate(5)[0]
    stored = json.loads(json.dumps(law.as_dict()))
    again, before = SheetLaw.from_dict(stored).read(states), law.read(states)
    assert again.force_n == pytest.approx(before.force_n, rel=1e-12)
    assert again.log_sd == pytest.approx(before.log_sd, rel=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [{"mean": [1.0]}, {"covariance": [0.0]}, {"noise": None}, {"contact": [float("nan")] * 16}],
)
def test_an_invalid_stored_law_is_refused(wrong: dict[str, Any]) -> None:
    stored = SheetLaw.fit(calibrate(4)).as_dict() | wrong
    with pytest.raises(CalibrationError, match="calibrate the force again"):
        SheetLaw.from_dict(stored)


def test_settled_reading_is_foreseen_from_the_first_half_second() -> None:
    contacts = [
        calibrate(seed, placements=1, steps_n=(force_n,))[0]
        for seed, force_n in enumerate(STEPS_N * 2)
    ]
    reader = SheetReader(SheetLaw.fit(contacts))
    for at_s in (0.0, 0.1, 0.3, 0.5):
        read = read_pixel(1.0, since_s=at_s, exponent=0.8, gain=1.0) if at_s else 0.0
        reader.follow(at_s, np.full((2, 2), read))
    soon, late = (
        read_pixel(1.0, since_s=since_s, exponent=0.8, gain=1.0) for since_s in (0.5, 20.0)
    )
    assert np.abs(reader.settle() / late - 1.0).max() < 0.5 * (late / soon - 1.0)
    assert (reader.settle(log_n=0.1) > reader.settle()).all()
