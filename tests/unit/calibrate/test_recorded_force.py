"""The force law of a sensor from its readings with known loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.fixtures import calibrate_once

from palpate.calibrate.loaded_readings import read_loaded
from palpate.calibrate.loaded_sensor import TableOptions
from palpate.calibrate.recorded_force import fit_force, fit_sensor, make_calibration
from palpate.calibration import Calibration
from palpate.errors import CalibrationError, InputError
from palpate.force.force_law import ForceLaw
from palpate.force.of_calibration import force_now

LOADS_N = np.array([0.0, 0.8, 1.7, 3.1, 5.2, 8.4])
#: A pad of 20 kilohm whose conductance rises almost linearly.
OHM = 20e3 / (1.0 + 6.0 * LOADS_N**0.95)
RATIO = OHM / (OHM + 4700.0)  # of the supply voltage, sensor at ground


def press(peaks_n: list[float], *, rest_ohm: float = 20e3) -> dict[str, Any]:
    """Return a recording of presses with creep, and its load."""
    time_s = np.arange(0.0, 5.0 * len(peaks_n) + 2.0, 0.04)
    load_n = np.zeros(time_s.size)
    for number, peak_n in enumerate(peaks_n):
        since_s = time_s - 5.0 * number - 2.0
        load_n += np.interp(since_s, [0.0, 0.3, 2.0, 2.4], [0.0, peak_n, peak_n, 0.0])
    excess = 6.0 * load_n**0.95
    slow = np.zeros_like(excess)
    for at in range(1, excess.size):
        slow[at] = slow[at - 1] + 0.03 * (excess[at] - slow[at - 1])
    read = 0.85 * excess + 0.15 * slow
    return {"time_s": time_s, "R_ohm": rest_ohm / (1.0 + read), "load_n": load_n}


@pytest.mark.parametrize(
    "columns",
    [
        {"R_kOhm": OHM / 1e3},
        {"A0": np.round(1023 * RATIO)},
        {"A0": np.round(1023 * (1 - RATIO))},
        {"change_percent": 100.0 * (OHM / OHM[0] - 1.0)},
        {"value_ohm": OHM, "temp_c": OHM},
    ],
    ids=["kilohm", "falling counts", "rising counts", "percent", "and a temperature"],
)
def test_settled_readings_in_any_unit_give_the_same_newtons(columns: dict[str, Any]) -> None:
    fitted = fit_force({"load_n": LOADS_N, **columns}, adc_bits=10)
    (trace,) = fitted.force({name: values[1:] for name, values in columns.items()}, adc_bits=10)
    np.testing.assert_allclose(trace.force_n, LOADS_N[1:], rtol=0.12)
    assert ((trace.low_n <= LOADS_N[1:]) & (LOADS_N[1:] <= trace.high_n)).all()


def test_open_sensor_at_rest_is_read_by_its_conductance() -> None:
    table = {"load_n": LOADS_N, "R_ohm": np.r_[np.inf, 3e5 / LOADS_N[1:]]}
    fitted = fit_force(table)
    (trace,) = fitted.force({"R_ohm": [np.inf, 1e5]})
    assert trace.force_n[0] == 0.0
    assert trace.force_n[1] == pytest.approx(3.0, rel=0.1)


def test_rows_without_a_load_are_converted_but_not_fitted() -> None:
    known = np.array([True, True, False, True, False, True])
    given = fit_force({"load_n": np.where(known, LOADS_N, np.nan), "R_ohm": OHM})
    alone = fit_force({"load_n": LOADS_N[known], "R_ohm": OHM[known]})
    np.testing.assert_allclose(given.force_n, alone.force_n)
    (trace,) = given.force({"R_ohm": OHM[~known]})
    np.testing.assert_allclose(trace.force_n, LOADS_N[~known], rtol=0.15)


def test_settled_law_is_that_of_dead_weights() -> None:
    fitted = fit_force({"load_n": LOADS_N, "R_ohm": OHM})
    known = ForceLaw.fit((OHM[0] / OHM[1:] - 1.0).tolist(), force_n=LOADS_N[1:])
    assert isinstance(fitted.law, ForceLaw)
    assert fitted.law.force(9.0) == known.force(9.0)


def test_moving_load_is_followed_on_another_recording() -> None:
    fitted = fit_force(press([2.0, 6.0, 1.2, 4.0, 8.0, 3.0]))
    other = press([5.0, 2.5])
    (trace,) = fitted.force({name: other[name] for name in ("time_s", "R_ohm")})
    held = other["load_n"] > 0.95 * np.max(other["load_n"])
    np.testing.assert_allclose(trace.force_n[held], other["load_n"][held], rtol=0.2)
    pressed = other["load_n"] > 0.5
    inside = (trace.low_n <= other["load_n"]) & (other["load_n"] <= trace.high_n)
    assert inside[pressed].mean() > 0.85
    assert fitted.held_out is not None
    assert fitted.held_out.median_abs_log_error < 0.12


def test_law_with_history_has_the_smaller_held_out_error_on_a_sheet_that_creeps() -> None:
    """A power law reads creep as force."""
    fitted = fit_force(press([2.0, 6.0, 1.2, 4.0, 8.0, 3.0, 5.0, 1.7]))
    assert fitted.held_out is not None
    power = fitted.held_out.power_median_abs_log_error
    assert power is not None
    assert fitted.held_out.median_abs_log_error < power


def lay(weights_n: list[float], *, creep: float) -> dict[str, Any]:
    """Return a recording of weights, each on the sensor for 25 s after 10 s without."""
    time_s = np.arange(0.0, 35.0 * len(weights_n) + 10.0, 0.1)
    excess = np.zeros(time_s.size)
    for number, weight_n in enumerate(weights_n):
        since_s = time_s - 35.0 * number - 10.0
        on = (since_s >= 0) & (since_s < 25.0)
        slow = creep * np.exp(-np.maximum(since_s, 0.0) / 3.0)
        excess += np.where(on, 6.0 * weight_n**0.95 * (1.0 - slow), 0.0)
    return {"time_s": time_s, "R_ohm": 20e3 / (1.0 + excess)}


@pytest.mark.parametrize("creep", [0.0, 0.3, 0.5])
def test_log_of_weights_teaches_the_creep_after_they_were_placed(creep: float) -> None:
    weights_n, tested_n = [1.5, 4.0, 9.0], 6.0
    log, other = lay(weights_n, creep=creep), lay([tested_n], creep=creep)
    fitted = fit_force(log, weights=weights_n)
    settled = ForceLaw.fit(fitted.excess.tolist(), force_n=fitted.force_n)
    (trace,), (before,) = (replace(fitted, law=law).force(other) for law in (fitted.law, settled))
    at = np.searchsorted(other["time_s"], [10.5, 11.0, 13.0])
    error, without = (np.abs(np.log(one.force_n[at] / tested_n)) for one in (trace, before))
    assert error.mean() < 0.85 * without.mean()
    last = np.searchsorted(other["time_s"], 34.0)
    assert trace.force_n[last] == pytest.approx(before.force_n[last], rel=0.02)
    assert len(fitted.early) == np.isfinite(fitted.early).sum() == 3


@pytest.mark.parametrize(
    "given",
    [
        {"source": {"load_n": LOADS_N, "R_ohm": OHM}},
        {"source": press([2.0, 6.0, 1.2, 4.0, 8.0, 3.0])},
        {"source": lay([1.5, 4.0, 9.0], creep=0.3), "weights": [1.5, 4.0, 9.0]},
    ],
    ids=["weights", "load cell", "log of weights"],
)
def test_saved_calibration_follows_frames_as_the_fit(given: dict[str, Any], tmp_path: Path) -> None:
    fitted = fit_force(**given)
    make_calibration(fitted, earlier=None, name="pad").save(tmp_path / "pad.json")
    stored = Calibration.load(tmp_path / "pad.json")
    assert stored.rest_ohm.ravel() == pytest.approx(20e3, rel=0.01)
    follower = force_now(stored)
    other = press([5.0])
    (trace,) = fitted.force({name: other[name] for name in ("time_s", "R_ohm")})
    excess = stored.rest_ohm.item() / other["R_ohm"] - 1.0
    frames = zip(other["time_s"], excess[:, None, None], strict=True)
    live = np.array([follower.step(*one).middle for one in frames])
    np.testing.assert_allclose(live, trace.force_n, rtol=1e-3, atol=1e-6)


def test_saving_keeps_the_layout_of_an_earlier_file() -> None:
    earlier = calibrate_once(seed=2, level="lab", apart_from="")
    pixels = {
        f"r{row}c{col}_ohm": OHM * (1.0 + 0.01 * row)
        for row in range(earlier.layout.rows)
        for col in range(earlier.layout.cols)
    }
    fitted = fit_force({"load_n": LOADS_N, **pixels})
    made = make_calibration(fitted, earlier=earlier, name="other")
    assert made.layout == earlier.layout
    assert made.block == earlier.block
    few = fit_force({"load_n": LOADS_N, "R_ohm": OHM})
    with pytest.raises(InputError, match="has 8 pixels, and the readings 1"):
        make_calibration(few, earlier=earlier, name="other")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"load_n": [2.0, 2.0, 2.0], "R_ohm": [3.0, 2.0, 1.0]}, "load does not change"),
        ({"load_n": [0, 1.0, 2.0], "R_ohm": [3.0, 3.0, 3.0]}, "do not change with the load"),
        ({"load_n": [0, 1.0, 2.0], "A0": [3.0, 300.0, 400.0]}, "--adc-bits"),
        ({"load_n": [0, 1.0, 2.0], "R_ohm": [9.0, np.nan, np.nan]}, "no weight has a usable"),
        ({**press([0.2, 0.25]), "R_ohm": press([0.2, 0.25])["R_ohm"]}, "never stays above"),
        ({**press([3.0, 4.0]), "load_n": -press([3.0, 4.0])["load_n"]}, "the loads are negative"),
    ],
)
def test_unusable_readings_are_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises((InputError, CalibrationError), match=message) as refusal:
        fit_force(table)
    assert "\n" not in str(refusal.value)


def test_force_of_real_ladders_from_three_weights_is_that_of_the_study(real_data: Path) -> None:
    """The figures of docs/force.md: median .14, of 51 loads 84 % in the interval."""
    sensors = read_loaded(
        real_data / "velostat_force_ladders.csv",
        options=TableOptions(value_columns=("resistance_ohm",)),
    )
    errors, covered = list[float](), list[bool]()
    for sensor in sensors:
        (part,) = sensor.parts
        given = np.zeros(part.load_n.size, dtype=bool)
        for at_n in (1.5, 4.0, 9.0):
            away = np.where(given | (part.load_n == 0), np.inf, np.abs(part.load_n - at_n))
            given[np.argmin(away)] = True
        few = replace(part, load_n=np.where(given | (part.load_n == 0), part.load_n, np.nan))
        trace = fit_sensor(replace(sensor, parts=(few,))).trace(part, is_settled=True)
        scored = (part.load_n > 0.5) & ~given
        errors += np.abs(np.log(trace.force_n[scored] / part.load_n[scored])).tolist()
        inside = (trace.low_n <= part.load_n) & (part.load_n <= trace.high_n)
        covered += inside[scored].tolist()
    assert len(errors) == 51
    assert np.median(errors) == pytest.approx(0.14, abs=0.005)
    assert np.mean(covered) == pytest.approx(0.84, abs=0.005)


def test_force_of_a_real_fsr_under_weights_is_better_than_a_power_law(real_data: Path) -> None:
    (sensor,) = read_loaded(real_data / "fsr_ladders.csv", options=TableOptions(adc_bits=12))
    held_out = fit_sensor(sensor).held_out
    assert held_out is not None
    assert held_out.power_median_abs_log_error is not None
    assert held_out.median_abs_log_error < held_out.power_median_abs_log_error
    assert held_out.coverage > 0.85


@pytest.mark.slow
def test_force_of_real_fsrs_under_a_hand_is_better_than_a_power_law(real_data: Path) -> None:
    (sensor,) = read_loaded(real_data / "fsr_plate.csv.gz")
    held_out = fit_sensor(sensor).held_out
    assert held_out is not None
    assert held_out.power_median_abs_log_error is not None
    assert held_out.median_abs_log_error < 0.9 * held_out.power_median_abs_log_error
    assert held_out.coverage == pytest.approx(0.9, abs=0.05)


def test_single_column_of_other_readings_may_have_another_name() -> None:
    fitted = fit_force({"load_n": LOADS_N, "R_ohm": OHM})
    (as_fitted,), (renamed,) = fitted.force({"R_ohm": OHM}), fitted.force({"fsr_ohm": OHM})
    assert renamed.force_n.tolist() == as_fitted.force_n.tolist()
    with pytest.raises(InputError, match="R_ohm"):
        fitted.force({"left_ohm": OHM, "right_ohm": OHM})


def test_rows_without_a_weight_on_a_scale_that_drifts_below_0_are_no_weights() -> None:
    drift_n = np.array([-0.008, 0.006, -0.005, 0.011])
    loads = np.r_[drift_n, LOADS_N[1:]]
    ohm = np.r_[20e3, 19.9e3, 20.1e3, 20e3, OHM[1:]]
    fitted = fit_force({"load_n": loads, "R_ohm": ohm})
    np.testing.assert_allclose(np.sort(fitted.force_n), LOADS_N[1:])
    (trace,) = fitted.force({"R_ohm": OHM[1:]})
    np.testing.assert_allclose(trace.force_n, LOADS_N[1:], rtol=0.12)


def test_noise_of_a_sensor_that_is_open_at_rest_is_no_force() -> None:
    """One count of noise is a conductance, and would be a contact."""
    time_s = np.arange(0.0, 60.0, 0.05)
    load_n = np.interp(time_s % 10.0, [3.0, 3.4, 6.0, 6.3], [0.0, 1.0, 1.0, 0.0])
    load_n *= 2.0 + time_s // 10.0
    counts = 900.0 * load_n / (load_n + 6.0)
    noise = np.random.default_rng(4).integers(0, 2, time_s.size)
    fitted = fit_force(
        {"time_s": time_s, "A3": counts.round() + noise, "load_n": load_n}, adc_bits=10
    )
    (trace,) = fitted.force({"time_s": time_s[:50], "A3": noise[:50]}, adc_bits=10)
    assert (trace.force_n == 0.0).all()
    (trace,) = fitted.force({"time_s": time_s, "A3": counts}, adc_bits=10)
    assert (trace.low_n[load_n > 1.5] > 0.0).all()


def test_touch_before_the_first_contact_is_no_noise_of_a_sensor_that_is_open_at_rest() -> None:
    table = press([4.0, 9.0, 6.0])
    # Open at rest; the conductance under a load is left.
    conductance = 1.0 / table["R_ohm"] - 1.0 / 20e3
    counts = np.round(1023 / (1.0 + 4700.0 * conductance))
    alone = fit_force({"time_s": table["time_s"], "A0": counts, "load_n": table["load_n"]})
    touched = counts.copy()
    touched[:5] = counts[table["load_n"] > 0].min() + 60
    fitted = fit_force({"time_s": table["time_s"], "A0": touched, "load_n": table["load_n"]})
    held = table["load_n"] > 3.0
    (known,), (found,) = (
        one.force({"time_s": table["time_s"], "A0": counts}, adc_bits=10) for one in (alone, fitted)
    )
    np.testing.assert_allclose(found.force_n[held], known.force_n[held], rtol=0.15)
    assert (found.force_n[held] > 2.0).all()


def test_voltage_of_a_divider_with_its_supply_is_read_as_its_counts() -> None:
    volts = 3.3 * (1.0 - RATIO)
    fitted = fit_force({"load_n": LOADS_N, "out_V": volts}, supply_v=3.3)
    (trace,) = fitted.force({"out_V": volts[1:]}, supply_v=3.3)
    np.testing.assert_allclose(trace.force_n, LOADS_N[1:], rtol=0.12)
    with pytest.raises(InputError, match="not ohm"):
        fit_force({"load_n": LOADS_N, "R_ohm": OHM}, supply_v=3.3)


def test_each_row_of_a_slow_log_may_be_a_contact() -> None:
    load_n = np.array(
        [0.0, 0.0, 1.7, 0.0, 3.1, 3.12, 0.0, 0.0, 5.2, 5.21, 5.2, 0.0, 8.4, 8.38, 0.0]
    )
    table = {
        "time_s": 15.0 * np.arange(load_n.size),
        "R_ohm": 20e3 / (1.0 + 6.0 * load_n**0.95),
        "load_n": load_n,
    }
    fitted = fit_force(table)
    assert fitted.kind == "load cell"
    assert fitted.held_out is not None
    assert fitted.held_out.groups == 4
