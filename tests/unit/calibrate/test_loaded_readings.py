"""Readings and loads of any logger are read as `settle` reads them, or refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.calibrate.loaded_readings import read_loaded
from palpate.calibrate.loaded_sensor import TableOptions
from palpate.errors import InputError
from palpate.holds.loads import read_weights


@pytest.mark.parametrize(
    ("head", "factor"),
    [
        ("load_n", 1.0),
        ("weight [g]", 9.80665e-3),
        ("Load (kg)", 9.80665),
        ("kraft [mN]", 1e-3),
        ("force_lbf", 4.4482216),
        ("Load (kg-f)", 9.80665),
    ],
)
def test_load_is_converted_by_the_unit_in_its_name(head: str, factor: float) -> None:
    (sensor,) = read_loaded({head: [0.0, 2.0, 5.0], "R_ohm": [900.0, 300.0, 200.0]})
    np.testing.assert_allclose(sensor.parts[0].load_n, factor * np.array([0.0, 2.0, 5.0]))
    assert sensor.is_settled


@pytest.mark.parametrize("clock", ["12:30:{:06.3f}", "2024-05-31T12:30:{:06.3f}"])
def test_load_cell_with_a_later_start_is_on_the_clock_of_the_readings(clock: str) -> None:
    at_s = np.arange(2.0, 40.0, 0.5)
    readings = {"time": [clock.format(one) for one in at_s], "R_ohm": 1e3 + at_s}
    cell_s = np.arange(10.0, 30.0, 0.25)
    cell = {"time": [clock.format(one) for one in cell_s], "force_n": cell_s / 10.0}
    (sensor,) = read_loaded(readings, load_cell=cell)
    known = np.isfinite(sensor.parts[0].load_n)
    assert known.sum() == np.sum((at_s >= 10.0) & (at_s <= 29.75))
    np.testing.assert_allclose(sensor.parts[0].load_n[known], at_s[known] / 10.0, atol=1e-9)


def test_weights_of_a_log_are_those_of_its_holds_in_order() -> None:
    time_s = np.arange(0.0, 40.0, 0.05)
    load_n = np.select([(time_s % 10 > 4) & (time_s % 10 < 9)], [1.0 + time_s // 10], 0.0)
    log = {"time_s": time_s, "R_ohm": 9000.0 / (1.0 + 4.0 * load_n)}
    (sensor,) = read_loaded(log, weights=[1.0, 2.0, 3.0, 4.0])
    for begin_s, end_s, weight_n in sensor.parts[0].weighed:
        inside = (time_s >= begin_s) & (time_s <= end_s)
        assert set(load_n[inside]) == {weight_n}
    with pytest.raises(InputError, match="3 weights above 0, but 4 holds"):
        read_loaded(log, weights=[1.0, 2.0, 3.0])


ROW = {"time_s": [0.0, 1.0, 2.0, 3.0], "R_ohm": [9.0, 8.0, 7.0, 6.0]}
SETTLED = {"R_ohm": [9.0, 8.0, 7.0]}


@pytest.mark.parametrize(
    ("readings", "loads", "message"),
    [
        ({**SETTLED, "load": [0, 1, 2]}, {}, "no unit"),
        ({**SETTLED, "load_n": [0, 1, 2], "weight_g": [0, 9, 9]}, {}, "--load-column"),
        ({**SETTLED, "n": [4, 5, 6]}, {}, "--load-unit N"),
        ({**SETTLED, "load_n": [0, 1, 2]}, {"weights": [0.0, 1.0, 2.0]}, "omit the weights"),
        (SETTLED, {"weights": [1.0]}, "no time column"),
        (ROW, {"weights": [-1.0, 2.0]}, "below 0"),
        (ROW, {"weights": {"time_s": [90.0], "g": [50]}}, "no reading in the second before"),
        (ROW, {"load_cell": {"time_s": [50.0, 51.0], "load_n": [0.0, 1.0]}}, "same clock"),
        (ROW, {"load_cell": {"load_n": [0.0, 1.0]}}, "needs a column of times"),
        (ROW, {"load_cell": {"time_s": [0.0, 1.0], "R": [0.0, 1.0]}}, "no column of loads"),
        (
            ROW,
            {"load_cell": {"time": ["12:00:00", "12:00:01"], "load_n": [0.0, 1.0]}},
            "different clocks",
        ),
        ({"time_s": [0.0, 1.0, 2.0], "force_n": [0.0, 1.0, 2.0]}, {}, "no column of readings"),
    ],
)
def test_unusable_loads_are_refused(
    readings: dict[str, list[float]], loads: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        read_loaded(readings, **loads)
    assert "\n" not in str(refusal.value)


def test_table_of_several_sensors_is_split_by_their_names() -> None:
    table = {
        "ladder": ["pad 1"] * 4 + ["pad 2"] * 5,
        "load_n": [0.0, 1, 2, 3, 0, 1, 2, 3, 4],
        "R_ohm": np.linspace(900, 100, 9),
    }
    assert [sensor.parts[0].load_n.size for sensor in read_loaded(table)] == [4, 5]


#: A falling staircase in newtons, as a load cell reads it every 20 s.
CELL_N = [0.004, -0.003, 7.91, 7.93, 7.90, 5.21, 5.19, 5.22, 2.6, 2.62, 2.61, 0.002]


def rows_of(load_n: list[float], *, times: list[float] | list[str]) -> dict[str, Any]:
    return {
        "time_s" if isinstance(times[0], float) else "Zeit": times,
        "load_n": load_n,
        "R_ohm": [5e4 / (1.0 + max(one, 0.0)) for one in load_n],
    }


@pytest.mark.parametrize(
    ("load_n", "times", "is_settled"),
    [
        (CELL_N, [20.0 * row for row in range(12)], False),
        (CELL_N, [f"14:{row:02}:30" for row in range(12)], False),
        # A load that always moves, as of a slow testing machine and of a hand.
        ([0.07 * row for row in range(90)], [6.0 * row for row in range(90)], False),
        (
            [0.0, *np.random.default_rng(8).uniform(0.5, 9.0, 70)],
            [30.0 * row for row in range(71)],
            False,
        ),
        # Weights: one by one, three times each, at any time, and there and back.
        ([0.0, 0.7, 1.9, 3.3, 6.0], [45.0 * row for row in range(5)], True),
        ([0.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0], [15.0 * row for row in range(7)], True),
        (CELL_N, [float(9 * row * row) for row in range(12)], True),
        ([0.0, 2.0, 4.0, 8.0, 4.0, 2.0, 0.0], [f"9:{5 * row:02}" for row in range(7)], True),
    ],
)
def test_slow_rows_are_weights_or_the_log_of_a_load_cell(
    load_n: list[float], times: list[float] | list[str], is_settled: bool
) -> None:
    (sensor,) = read_loaded(rows_of(load_n, times=times))
    assert sensor.is_settled is is_settled
    assert sum("settled reading" in text for text in sensor.taken) == 1


def test_a_chosen_clock_makes_slow_rows_a_log() -> None:
    table = rows_of([0.0, 0.7, 1.9, 3.3], times=[60.0, 120.0, 180.0, 240.0])
    (sensor,) = read_loaded(table, options=TableOptions(time_column="time_s"))
    assert not sensor.is_settled


def test_a_row_without_a_date_does_not_make_the_others_a_log() -> None:
    days = ["2026-03-14", "2026-03-14", "", "2026-03-15"]
    (sensor,) = read_loaded(rows_of([0.0, 1.0, 2.0, 4.0], times=days))
    assert sensor.is_settled


@pytest.mark.parametrize("noted_s", [-1.5, 2.0, 4.9])
@pytest.mark.parametrize("head", ["time_s", "noted at"])
def test_times_of_weights_are_those_of_laying_reading_or_lifting(noted_s: float, head: str) -> None:
    time_s = np.arange(0.0, 44.0, 0.05)
    load_n = np.where((time_s % 11 > 5) & (time_s % 11 < 9.5), 1.5 + time_s // 11, 0.0)
    clock = [f"08:15:{one:06.3f}" for one in time_s] if head == "noted at" else time_s
    log = {"time": clock, "R_ohm": 7000.0 / (1.0 + 3.0 * load_n)}
    laid_s = [5.0 + 11.0 * number + noted_s for number in range(4)]
    noted = [f"08:15:{one:04.1f}" for one in laid_s] if head == "noted at" else laid_s
    weights = {head: noted, "load_n": [1.5, 2.5, 3.5, 4.5]}
    (sensor,) = read_loaded(log, weights=weights)
    for begin_s, end_s, weight_n in sensor.parts[0].weighed:
        assert set(load_n[(time_s >= begin_s) & (time_s <= end_s)]) == {weight_n}


def test_a_column_is_chosen_without_its_unit() -> None:
    table = {
        "t [ms]": [0.0, 40.0, 80.0],
        "Pad [LSB]": [9.0, 8.0, 7.0],
        "Last [g]": [0.0, 50.0, 90.0],
    }
    options = TableOptions(
        time_column="t", value_columns=["pad"], load_column="last", load_unit="g"
    )
    (sensor,) = read_loaded(table, options=options)
    assert sensor.columns == ("Pad [LSB]",)
    assert np.nanmax(sensor.parts[0].load_n) == pytest.approx(0.8826, rel=1e-3)


def test_weights_in_another_sheet_of_the_workbook_of_readings(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["pad 3, bench A"])
    log, list_of = book.create_sheet("Messung"), book.create_sheet("Gewichte")
    log.append(["time_s", "R_ohm", "Akku [V]"])
    for row in range(600):
        at_s = 0.05 * row
        load = 1.0 + at_s // 10 if 3 < at_s % 10 < 8 else 0.0
        log.append([at_s, 9000.0 / (1.0 + 4.0 * load), 3.7])
    list_of.append(["Nr", "Masse [kg]"])
    for number, kilograms in enumerate([0.1, 0.2, 0.3]):
        list_of.append([number, kilograms])
    path = tmp_path / "bench.xlsx"
    book.save(path)
    (sensor,) = read_loaded(path, weights=path)
    assert sensor.columns == ("R_ohm",)
    loads = [load for _, _, load in sensor.parts[0].weighed]
    assert loads == pytest.approx([0.980665, 1.96133, 2.941995])


def test_weights_with_their_units_are_read(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("n;Gewicht;Wert\n1;0;41 kΩ\n2;250 g;830,5 Ω\n3;1,25 kg;0,2604 kΩ\n")
    (sensor,) = read_loaded(path)
    np.testing.assert_allclose(sensor.parts[0].load_n, np.array([0, 0.25, 1.25]) * 9.80665)
    np.testing.assert_allclose(sensor.parts[0].values.ravel(), [41e3, 830.5, 260.4])
    assert sensor.unit == "ohm"
    (same,) = read_loaded({"Gewicht": ["0", "250 g", "1.25 kg"], "R": ["41k", "830.5", ".2604k"]})
    np.testing.assert_allclose(same.parts[0].load_n, sensor.parts[0].load_n)
    np.testing.assert_allclose(same.parts[0].values, sensor.parts[0].values)
    # The first line is no name of the others.
    path.write_text("3 x 20 g\n100 g\n200 g\n")
    with pytest.raises(InputError, match="'3 x 20 g' above line 2"):
        read_weights(path)


def test_names_of_weights_are_no_weights(tmp_path: Path) -> None:
    path = tmp_path / "weights.csv"
    path.write_text("what,mass_g\nnone,0\nwasher,7.5\nnut,30\n")
    np.testing.assert_allclose(read_weights(path).load_n, np.array([0, 7.5, 30]) * 9.80665e-3)


def test_unit_of_weights_stands_in_a_row_of_its_own(tmp_path: Path) -> None:
    text = "nr\tMasse\n\tkg\n1\t0.0764787\n2\t0.152957\n3\t0.229436\n"
    path = tmp_path / "weights.csv"
    path.write_text(text, encoding="utf-8")
    at_s = np.arange(0.0, 33.0, 0.05)
    load_n = np.where((at_s % 10 > 4) & (at_s % 10 < 8.5), 0.75 * (1 + at_s // 10), 0.0)
    epoch_ms = 1.7551e12 + 1e3 * at_s
    log = {"epoch_ms": epoch_ms, "R_ohm": 12e3 / (1 + 6 * load_n), "Akku": 3.9 - at_s / 1e3}
    (sensor,) = read_loaded(log, weights=path)
    assert sensor.columns == ("R_ohm",)
    loads = [load for _, _, load in sensor.parts[0].weighed]
    assert loads == pytest.approx([0.75, 1.5, 2.25], rel=1e-4)
