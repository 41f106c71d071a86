"""A unit that is not understood, or a function of a reading, is never read as ohms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.calibrate.loaded_readings import read_loaded
from palpate.errors import InputError
from palpate.holds.cutting import cut_holds
from palpate.holds.loads import find_load_column
from palpate.holds.recordings import read_recording
from palpate.holds.table import Table
from palpate.holds.table_files import table_of_arrays

TIMES = np.arange(0.0, 3.0, 0.1)


def write(folder: Path, head: str, *, encoding: str) -> Path:
    path = folder / "log.csv"
    rows = "".join(f"{at:.1f},{9.0 - at:.3f}\n" for at in TIMES)
    path.write_bytes(f"{head}\n{rows}".encode(encoding))
    return path


@pytest.mark.parametrize(
    ("head", "encoding"),
    [
        ("time_s,Resistance (MΩ)", "mac_roman"),
        ("time_s,Widerstand_kΩ", "cp437"),
        ("time_s,Ch1 [kΩ]", "cp737"),
        ("time_s,R1 (kΩ)", "euc_kr"),
        ("t[s],R2[MΩ]", "cp932"),
        ("time_s,R (кОм)", "utf-8"),
        ("time_s,R (千欧)", "utf-8"),
    ],
)
def test_unit_that_is_not_understood_is_refused(head: str, encoding: str, tmp_path: Path) -> None:
    path = write(tmp_path, head, encoding=encoding)
    with pytest.raises(InputError):
        read_recording(path)
    found = read_recording(path, unit="ohm")
    assert [*found.units.values()] == ["ohm"]


@pytest.mark.parametrize(
    ("name", "unit", "scale"),
    [
        ("R außen (kΩ)", "ohm", 1e3),
        ("Widerstand (rechts außen)", "ohm", 1.0),
        ("R / kOhm", "ohm", 1e3),
        ("dR/R0 (%)", "percent", 1.0),
        ("F_norm [N]", "newton", 1.0),
        ("Stress [N/mm²]", "pascal", 1e6),
        ("Resistance, kOhm (S/N: 77, N=4)", "ohm", 1e3),
        ("R_ohm (mean N=8)", "ohm", 1.0),
        ("V (SEN S/N: 3)", "volt", 1.0),
        ("G [µS]", None, 1.0),
    ],
)
def test_unit_is_that_of_the_reading(name: str, unit: str | None, scale: float) -> None:
    found = read_recording({"time_s": TIMES, name: 9.0 - TIMES})
    assert found.units[name] == unit
    np.testing.assert_allclose(found.columns[name], scale * (9.0 - TIMES))


FUNCTIONS = ["log(R/kOhm)", "lg_R_ohm", "R (dBohm)", "ΔR/R", "Rs/Rs0", "V_normalized", "1/R_ohm"]
FUNCTIONS += ["sqrt(R) [kOhm]", "dR/dt [kOhm]", "resistance_ratio"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_of_a_reading_has_no_unit(name: str) -> None:
    found = read_recording({"time_s": TIMES, name: 3.0 - TIMES})
    assert found.units[name] is None
    np.testing.assert_allclose(found.columns[name], 3.0 - TIMES)
    assert any(name in remark for remark in found.remarks)
    with pytest.raises(InputError, match="function"):
        read_loaded({"load_n": [0.0, 1.0, 2.0, 4.0], name: [4.0, 3.0, 2.0, 1.0]})


def test_reading_is_preferred_to_its_logarithm() -> None:
    ohm = 900.0 + TIMES
    assert [*read_recording({"time_s": TIMES, "ln R": np.log(ohm), "R": ohm}).columns] == ["R"]


def test_relative_change_may_be_a_fraction() -> None:
    table = {"time_s": TIMES, "rel_change": -TIMES / 4.0}
    with pytest.raises(InputError, match="--unit percent"):
        read_recording(table)
    assert read_recording(table, unit="percent").units["rel_change"] == "percent"
    assert read_recording({"time_s": TIMES, "rel_change": -30.0 * TIMES}).units == {
        "rel_change": "percent"
    }


def test_loose_wire_ends_no_hold() -> None:
    time_s = np.arange(0.0, 40.0, 0.05)
    for wrong in (9999.0, 999999.0):
        ohm = np.where(time_s < 3.0, 2500.0, 400.0 - 12.0 * np.log(time_s + 1.0))
        ohm[(time_s >= 14.0) & (time_s < 14.4)] = wrong
        (hold,) = cut_holds({"time_s": time_s, "R_ohm": ohm})
        assert hold.values.max() < 500.0
        assert hold.time_s[-1] > 35.0


@pytest.mark.parametrize("mark", [".", ","])
def test_labview_states_the_interval_of_rows_without_times(mark: str, tmp_path: Path) -> None:
    head = f"LabVIEW Measurement\nX_Columns\tNo\n***End_of_Header***\n\nX0\t1{mark}5\t1{mark}5\n"
    head += f"Delta_X\t0{mark}02\t0{mark}02\n***End_of_Header***\nX_Value\tPad A\tPad B\tComment\n"
    rows = "".join(f"\t{9 - at:.2f}\t{9 + at:.2f}\t\n".replace(".", mark) for at in TIMES)
    path = tmp_path / "run.lvm"
    path.write_text(head + rows)
    found = read_recording(path)
    np.testing.assert_allclose(found.time_s, 1.5 + 0.02 * np.arange(TIMES.size))
    assert [*found.columns] == ["Pad A", "Pad B"]


def test_column_in_ohm_is_a_reading_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / "meter.csv"
    rows = "".join(f"{k},{k / 10:.1f},{9 - k / 10:.2f} kOhm,0.1\n" for k in range(20))
    path.write_text(f"No.,time_s,Sample,Duration\n{rows}")
    found = read_recording(path)
    ((name, values),) = found.columns.items()
    assert name.startswith("Sample")
    assert values[0] == pytest.approx(9000.0)


def test_first_row_without_its_last_field_is_no_header(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    rows = "".join(f"{at:.1f};{400 + at:.1f};{500 + at:.1f}\n" for at in TIMES)
    path.write_text(f"time_s;left_ohm;right_ohm\n-0.1;399.9\n{rows}")
    found = read_recording(path)
    assert [*found.columns] == ["left_ohm", "right_ohm"]
    assert found.time_s.size == TIMES.size
    assert any("line 2" in remark for remark in found.remarks)


@pytest.mark.parametrize("hour", [-1, 1])
def test_change_of_the_clock_ends_no_recording(hour: int) -> None:
    clock = np.datetime64("2026-01-05T02:10") + np.arange(60) * np.timedelta64(500, "ms")
    clock[23:] += np.timedelta64(hour, "h")
    found = read_recording({"time": clock.astype(str), "R": np.arange(60.0)})
    np.testing.assert_allclose(found.time_s, 0.5 * np.arange(60))
    assert any("clock" in remark for remark in found.remarks)


def loads_table(name: str) -> Table:
    return table_of_arrays({name: [0.0, 1.0, 2.0], "R": [9.0, 5.0, 4.0]}, name="t")


def test_load_in_a_unit_that_is_not_understood_is_refused() -> None:
    for name in ("Force [0.1 N]", "Load (кгс)"):
        with pytest.raises(InputError, match="--load-unit"):
            find_load_column(loads_table(name))
        assert find_load_column(loads_table(name), unit="g") is not None


def test_swapped_columns_and_pressures_are_no_loads() -> None:
    loads, ohm = np.array([0.0, 0.5, 1.0, 2.0, 5.0]), np.array([8e4, 5e3, 3e3, 2e3, 900.0])
    with pytest.raises(InputError, match="swapped"):
        read_loaded({"F [N]": ohm, "R [kOhm]": loads / 1e3})
    with pytest.raises(InputError, match="pressure"):
        read_loaded({"p [bar]": loads, "R [Ohm]": ohm})
    assert len(read_loaded({"F [N]": loads, "R [Ohm]": ohm})) == 1
