"""Every form of a logger is read right, or refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from tests.logger_forms import (
    FORCE_N,
    FORMS,
    OHM,
    ONE,
    ROWS,
    TIME_S,
    TWO,
    Form,
    comma,
    lines,
    stamp,
    workbook,
)

from palpate.errors import InputError
from palpate.holds.recordings import read_recordings


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.what)
def test_form_is_read_or_refused(form: Form, tmp_path: Path) -> None:
    path = tmp_path / f"log{form.ending}"
    content = form.content
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if form.refused:
        with pytest.raises(InputError) as refusal:
            read_recordings(path, **form.options)
        assert form.refused in str(refusal.value)
        assert str(refusal.value).count("\n") == 0
        return
    found = read_recordings(path, **form.options)
    parts = {one.name.partition(":")[2]: one for one in found}
    wanted = form.columns if len(found) > 1 else {"": form.columns}
    assert {name: [*one.columns] for name, one in parts.items()} == {
        name: [*columns] for name, columns in wanted.items()
    }
    for name, columns in wanted.items():
        for column, values in columns.items():
            np.testing.assert_allclose(parts[name].columns[column], values, rtol=1e-9)
            if len(values) == len(ROWS):
                since_s = parts[name].time_s - parts[name].time_s[0]
                np.testing.assert_allclose(since_s, TIME_S, atol=1e-4)


def write(path: Path, head: str, line: Callable[[int], str]) -> Path:
    path.write_text(lines(line, head=head))
    return path


@pytest.mark.parametrize(
    ("head", "line", "refused"),
    [
        ("time_s,R_ohm\n", lambda r: f'{TIME_S[r]},"{OHM[r]:,.0f}"', "--decimal point if ','"),
        ("ms;R_ohm\n", lambda r: f"{100 * r};{ONE[r] // 10}.018", "--decimal comma if '.'"),
        (
            "time_s,R\n",
            lambda r: f"{comma(TIME_S[r])},{comma(ONE[r])}",
            "may separate two readings",
        ),
        ("sample,fsr\n", lambda r: f"{r},{ONE[r]}", "--interval"),
        ("time,gap\ns,mm\n", lambda r: f"{TIME_S[r]},{ONE[r]}", "--value-column"),
        ("Test of 3 May, pad 2\n", lambda r: f"{TIME_S[r]},{ONE[r]}", "--time-column"),
        ("ms,fsr\n", lambda r: f"{100 * r},{ONE[r]}\n{100 * r + 4},{TWO[r]}", "alternate"),
        ("", lambda r: stamp(r, "%H:%M:%S,%f,") + f"{ONE[r]}", "seems to be a decimal mark"),
        ("ms,fsr\n", lambda r: f"{100 * (r ^ (r % 50 < 2))},{ONE[r]}", "sort the rows"),
        ("Time [0.1 s],fsr\n", lambda r: f"{r},{ONE[r]}", "'0.1 s' can't be converted"),
        ("Time [cs],fsr\n", lambda r: f"{10 * r},{ONE[r]}", "'cs' can't be converted"),
        ("time_s,R [k]\n", lambda r: f"{TIME_S[r]},{ONE[r]}", "'k' can't be converted"),
        ("time_s,Force [10 N]\n", lambda r: f"{TIME_S[r]},{ONE[r]}", "'10 N' can't be converted"),
        (
            "time,fsr\n",
            lambda r: f"{0.4 + TIME_S[r] / 86400:.9f},{ONE[r]}",
            "too short for seconds",
        ),
        (
            "time,fsr\n",
            lambda r: stamp(r, "%Y%m%d%H%M%S") + f",{ONE[r]}",
            "a date and a time of day",
        ),
        (
            "t,A0,t,A1\n",
            lambda r: f"{TIME_S[r]},{ONE[r]},{TIME_S[r] + 2:.1f},{TWO[r]}",
            "clocks of different readings",
        ),
        (
            "",
            lambda r: f"{2 * r}00 {ONE[r]} {TWO[r]}\n{2 * r + 1}00 {ONE[r] + 9} {TWO[r] + 9}\n",
            "blocks of 2 lines",
        ),
    ],
)
def test_form_with_two_meanings_is_refused(
    head: str, line: Callable[[int], str], refused: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as refusal:
        read_recordings(write(tmp_path / "log.txt", head, line))
    assert refused in str(refusal.value)


@pytest.mark.parametrize(
    ("decimal", "line", "values"),
    [
        ("comma", lambda r: f"{comma(TIME_S[r])};{ONE[r]}.018", 1000 * ONE + 18),
        ("point", lambda r: f"{TIME_S[r]};{ONE[r]},018", 1000 * ONE + 18),
        ("point", lambda r: f"{TIME_S[r]};{ONE[r]}.018", ONE + 0.018),
        ("comma", lambda r: f"{comma(TIME_S[r])};{ONE[r]},018", ONE + 0.018),
    ],
)
def test_decimal_option_decides(
    decimal: Literal["point", "comma"],
    line: Callable[[int], str],
    values: np.ndarray,
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "log.csv", "time_s;R_ohm\n", line)
    [found] = read_recordings(path, decimal=decimal)
    if values[0] > 1e5:
        # The user learns that a mark was taken as that of thousands.
        assert any("separates thousands" in remark for remark in found.remarks)
    np.testing.assert_allclose(found.columns["R_ohm"], values)
    other: Literal["point", "comma"] = "point" if decimal == "comma" else "comma"
    with pytest.raises(InputError, match="contradicts --decimal"):
        read_recordings(path, decimal=other)


@pytest.mark.parametrize(
    ("head", "unit", "factor"),
    [
        ("time_s,Load (lbf)\n", "newton", 4.4482216),
        ("time_s,weight_g\n", "newton", 9.80665e-3),
        ("time_s,Kraft [kN]\n", "newton", 1e3),
        ("time_s,p [mbar]\n", "pascal", 100.0),
        ("time,force\ns,cN\n", "newton", 0.01),
        ("time_s,force_daN\n", "newton", 10.0),
        ("s,kN\ntime,force\n", "newton", 1e3),
        ("time_s,load_mg\n", "newton", 9.80665e-6),
        ("time_s,p [hPa]\n", "pascal", 100.0),
        ("time_s,p [kgf/cm²]\n", "pascal", 98066.5),
        ('"TOA5","x"\n"TIMESTAMP","F"\n"TS","mN"\n"","Avg"\n', "newton", 1e-3),
    ],
)
def test_force_or_pressure_alone_is_read_in_newton_or_pascal(
    head: str, unit: str, factor: float, tmp_path: Path
) -> None:
    [found] = read_recordings(
        write(tmp_path / "a.csv", head, lambda r: f"{TIME_S[r]},{FORCE_N[r]}")
    )
    assert [*found.units.values()] == [unit]
    np.testing.assert_allclose([*found.columns.values()], [factor * FORCE_N], rtol=1e-6)


def test_interval_replaces_a_clock_and_needs_no_decimal_mark(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", "time_s,A0\n", lambda r: f"{TIME_S[r]},{ONE[r]}")
    [found] = read_recordings(path, interval_s=0.5)
    assert any("time_s" in remark for remark in found.remarks)
    path = write(tmp_path / "log.csv", "A0,A1\n", lambda r: f"{ONE[r]},{TWO[r]}")
    [found] = read_recordings(path, interval_s=0.1)
    np.testing.assert_allclose([*found.columns.values()], [ONE, TWO])


def test_rows_of_a_coarse_clock_are_spread_over_its_tick(tmp_path: Path) -> None:
    path = write(tmp_path / "log.txt", "", lambda r: stamp(r, "[%Y-%m-%d %H:%M:%S] ") + f"{ONE[r]}")
    [found] = read_recordings(path)
    np.testing.assert_allclose(found.columns["2"], ONE)
    np.testing.assert_allclose(np.diff(found.time_s), 0.1, atol=0.02)


def test_each_restart_of_a_clock_begins_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    once = lines(lambda r: f"{100 * r},{ONE[r]}")
    path.write_text("ms,fsr\n" + 3 * once)
    assert [one.name for one in read_recordings(path)] == [f"log:part {k}" for k in (1, 2, 3)]
    # A 16-bit count overflows instead.
    wraps = write(tmp_path / "w.csv", "ms,A0\n", lambda r: f"{(60000 + 100 * r) % 65536},{ONE[r]}")
    [found] = read_recordings(wraps)
    np.testing.assert_allclose(found.time_s - found.time_s[0], TIME_S)


@pytest.mark.parametrize(
    ("head", "line", "columns"),
    [
        ("Time,adc\n", lambda r: stamp(r, "%a %b %d %H:%M:%S.%f %Y,") + f"{ONE[r]}", ["adc"]),
        ("Time;adc\n", lambda r: stamp(r, "%a, %d %b %Y %H:%M:%S.%f;") + f"{ONE[r]}", ["adc"]),
        ("when,adc\n", lambda r: stamp(r, "%Y%m%dT%H%M%S.%f,") + f"{ONE[r]}", ["adc"]),
        ("Date,adc\n", lambda r: f"{45443.5 + TIME_S[r] / 86400:.10f},{ONE[r]}", ["adc"]),
        ("", lambda r: stamp(r, "%I:%M:%S.%f %p -> ") + f"{ONE[r]}", ["2"]),
        (
            "time,adc\n",
            lambda r: (
                stamp(r, "%I:%M:%S.%f,", start=datetime(2024, 5, 31, 12, 59, 50)) + f"{ONE[r]}"
            ),
            ["adc"],
        ),
        ("", lambda r: f"({round(1e3 * TIME_S[r])}, {ONE[r]})", ["2"]),
        ("", lambda r: f"\x1b[0;32mI ({round(1e3 * TIME_S[r])}) FSR: {ONE[r]}\x1b[0m", ["FSR"]),
        ("Reading\tTime [s]\tLeft\n", lambda r: f"{r + 1}\t{TIME_S[r]}\t{ONE[r]}", ["Left"]),
        (
            "SourceTimestamp,NodeId,Value,Status\n",
            lambda r: stamp(r, "%Y-%m-%dT%H:%M:%S.%fZ") + f",ns=2;s=P1,{ONE[r]},Good",
            ["Value"],
        ),
        ("t,adc\n", lambda r: stamp(r, "%d-%b-%y %H:%M:%S.%f,") + f"{ONE[r]}", ["adc"]),
        ("t,adc\n", lambda r: f"{round(1e9 * TIME_S[r])},{ONE[r]}", ["adc"]),
        # The board's own clock restarts; that of the terminal doesn't.
        ("", lambda r: stamp(r, "%H:%M:%S.%f -> ") + f"{100 * (r % 90)};{ONE[r]}", ["3"]),
        # A board that restarts prints its header again.
        (
            "ms,adc\n",
            lambda r: f"{round(1e3 * TIME_S[r])},{ONE[r]}" + "\nms,adc" * (r % 40 == 9),
            ["adc"],
        ),
    ],
)
def test_clocks_and_lines_of_loggers_are_read(
    head: str, line: Callable[[int], str], columns: list[str], tmp_path: Path
) -> None:
    [found] = read_recordings(write(tmp_path / "log.txt", head, line))
    assert [*found.columns] == columns
    np.testing.assert_allclose(found.columns[columns[0]], ONE)
    np.testing.assert_allclose(found.time_s - found.time_s[0], TIME_S, atol=1e-3)


def test_frames_of_two_lines_from_a_terminal_are_split_by_place(tmp_path: Path) -> None:
    def frame(row: int) -> str:
        at = stamp(row, "%H:%M:%S.%f -> ")
        return f"{at}{ONE[row]} {TWO[row]}\n{at}{ONE[row] + 90} {TWO[row] + 90}\n{at}"

    [found] = read_recordings(write(tmp_path / "log.txt", "", frame))
    [*each] = found.columns.values()
    np.testing.assert_allclose(each, [ONE, ONE + 90, TWO, TWO + 90])


def test_summary_and_empty_rows_of_a_workbook_do_no_harm(tmp_path: Path) -> None:
    rows = [[float(TIME_S[r]), float(OHM[r])] for r in ROWS]
    path = tmp_path / "log.xlsx"
    summary = [["Test", "Time", "Fmax"], *([k, 1.0 + k, 3.0] for k in range(4))]
    path.write_bytes(workbook(summary, [["time_s", "R_ohm"], *rows, [], [], [], ["mean", 4.5]]))
    [found] = read_recordings(path)
    np.testing.assert_allclose(found.columns["R_ohm"], OHM)


def test_zeros_after_a_loss_of_power_are_omitted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(
        lines(lambda r: f"{TIME_S[r]},{ONE[r]}", head="time_s,A0\n").encode() + bytes(4096)
    )
    [found] = read_recordings(path)
    np.testing.assert_allclose(found.columns["A0"], ONE)
