"""Every form of a logger is read right, or refused in one line."""

from __future__ import annotations

from collections.abc import Callable
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
    np.testing.assert_allclose(found.columns["R_ohm"], values)
    other: Literal["point", "comma"] = "point" if decimal == "comma" else "comma"
    with pytest.raises(InputError, match="contradicts --decimal"):
        read_recordings(path, decimal=other)


@pytest.mark.parametrize(
    ("header", "unit", "factor"),
    [
        ("Load (lbf)", "newton", 4.4482216),
        ("weight_g", "newton", 9.80665e-3),
        ("Kraft [kN]", "newton", 1e3),
        ("p [mbar]", "pascal", 100.0),
    ],
)
def test_force_alone_is_read_in_newton_and_beside_readings_named(
    header: str, unit: str, factor: float, tmp_path: Path
) -> None:
    alone = write(tmp_path / "a.csv", f"time_s,{header}\n", lambda r: f"{TIME_S[r]},{FORCE_N[r]}")
    [found] = read_recordings(alone)
    assert found.units == {header: unit}
    np.testing.assert_allclose(found.columns[header], factor * FORCE_N, rtol=1e-6)
    both = write(
        tmp_path / "b.csv", f"time_s,{header},A0\n", lambda r: f"{TIME_S[r]},{FORCE_N[r]},{ONE[r]}"
    )
    [found] = read_recordings(both)
    assert [*found.columns] == ["A0"]
    assert any(header in remark for remark in found.remarks)


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
