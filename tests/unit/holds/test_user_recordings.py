"""Recording formats of users: every format yields the same holds or a one-line error."""

from __future__ import annotations

import gzip
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.commands import Command
from tests.touches import TOUCHES, counts, resistance_ohm

from palpate import cut_holds, read_recording
from palpate.demo.recordings import write_recordings
from palpate.errors import InputError

TIME_S = np.arange(0, 88, 0.04)
OHM = resistance_ohm(TIME_S)
#: Values of the three holds 20 s after their start.
SETTLED = [355.9, 322.0, 291.3]


def table(
    time: np.ndarray,
    values: np.ndarray,
    *,
    header: str = "time_s,resistance_ohm",
    row_format: str = "{:.3f},{:.4f}",
    comma: bool = False,
) -> str:
    rows = [row_format.format(t, v) for t, v in zip(time, values, strict=True)]
    if comma:
        rows = [row.replace(".", ",") for row in rows]
    return "\n".join([header, *rows]) + "\n"


def text_formats() -> dict[str, str | bytes]:
    german = table(
        TIME_S, OHM, header="Zeit [s];Widerstand [Ohm]", row_format="{:.3f};{:.3f}", comma=True
    )
    plain = table(TIME_S, OHM)
    lines = plain.splitlines()
    return {
        "plain.csv": plain,
        "windows.csv": plain.replace("\n", "\r\n"),
        "ms.csv": table(TIME_S * 1e3, OHM, header="time,R", row_format="{:.0f},{:.3f}"),
        "wraps.tsv": table(
            (TIME_S * 1e6 + 4.25e9) % 2**32, OHM, header="micros\tR", row_format="{:.0f}\t{:.3f}"
        ),
        "unix-ms.csv": table(
            TIME_S * 1e3 + 1717149000e3, OHM, header="timestamp,R", row_format="{:.0f},{:.3f}"
        ),
        "comments.csv": "# by hand\n% more\nSensor: strip 3\n\n"
        + "\n".join([*lines[:700], "# a pause", "// and on", *lines[700:]]),
        "decimal-quoted.csv": '"time","R"\n'
        + "".join(
            f'"{t:.3f}","{v:.3f}"\n'.replace(".", ",") for t, v in zip(TIME_S, OHM, strict=True)
        ),
        "latin.csv": german.replace("Zeit", "Zeit für").encode("cp1252"),
        "utf16.txt": german.replace(";", "\t").replace("Ohm", "Ω").encode("utf-16"),
        "spaces.dat": "\n".join(line.replace(",", "   ") for line in lines[1:]),
        "zipped.csv.gz": gzip.compress(plain.encode(), mtime=0),
        "with-force.csv": "time_s,force_n,resistance_ohm\n"
        + "".join(f"{t:.3f},3.1,{v:.3f}\n" for t, v in zip(TIME_S, OHM, strict=True)),
    }


FORMATS = text_formats()


def run_settle(
    path: Path, palpate: Command, *options: object
) -> tuple[list[float | None], list[str], str]:
    printed = palpate("settle", path, "--json", "--method", "recorded", *options)
    rows = printed.document["rows"]
    return [row["settled"] for row in rows], [row["hold_id"] for row in rows], printed.err


def run_refused(path: Path, palpate: Command, *options: object) -> str:
    error = palpate.refused("settle", path, "--json", *options)
    assert str(path) in error or path.stem in error
    return error


@pytest.mark.parametrize("name", FORMATS)
def test_settle_every_text_format_has_same_holds(
    name: str, tmp_path: Path, palpate: Command
) -> None:
    path, content = tmp_path / name, FORMATS[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found, holds, _ = run_settle(path, palpate)
    assert found == pytest.approx(SETTLED, rel=1e-3)
    stem = name.split(".")[0]
    assert [hold.split(":")[0] for hold in holds] == [stem] * 3
    assert [hold.rsplit(":", 1)[1] for hold in holds] == ["1", "2", "3"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "per_ohm", "unit"),
    [
        ("S1 [kOhm]", 1e-3, "ohm"),
        ("R (MΩ)", 1e-6, "ohm"),
        ("ch1 mV", 1e3, "volt"),
        ("pressure_kPa", 1e-3, "pascal"),
    ],
)
def test_settle_prefixed_unit_is_converted_and_reported(
    name: str, per_ohm: float, unit: str, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "prefixed.csv"
    path.write_text(
        table(TIME_S, per_ohm * OHM, header=f"time_s,{name}", row_format="{:.3f},{:.9g}")
    )
    found, holds, message = run_settle(path, palpate)
    assert found == pytest.approx(SETTLED, rel=1e-3)
    assert holds[0] == f"prefixed:{name}:1"
    assert f"{name} was converted to {unit}" in message


def test_settle_unit_option_disables_prefix_conversion(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "given.csv"
    path.write_text(table(TIME_S, OHM, header="time_s,R_kOhm"))
    found, _, message = run_settle(path, palpate, "--unit", "ohm")
    assert found == pytest.approx(SETTLED, rel=1e-3)
    assert "converted" not in message


def test_settle_prints_column_names_with_brackets(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "two.csv"
    frame = pd.DataFrame({"time_s": TIME_S, "S1 [kOhm]": OHM / 1e3, "S2 [kOhm]": OHM / 1e3})
    frame.to_csv(path, index=False)
    assert "two:S1 [kOhm]:1" in palpate("settle", path).out


@pytest.mark.parametrize("ending", ["xlsx", "parquet"])
def test_settle_reads_pandas_files_with_time_index(
    ending: str, tmp_path: Path, palpate: Command
) -> None:
    index = pd.to_datetime(TIME_S, unit="s", origin="2024-01-01")
    frame = pd.DataFrame({"sensor A": OHM, "sensor B": 2 * OHM, "note": "x"}, index=index)
    path = tmp_path / f"both.{ending}"
    write: dict[str, Callable[[Path], object]] = {
        "xlsx": frame.to_excel,
        "parquet": frame.to_parquet,
    }
    write[ending](path)
    found, holds, _ = run_settle(path, palpate)
    assert found == pytest.approx([*SETTLED, *(2 * value for value in SETTLED)], rel=1e-3)
    assert holds[::3] == ["both:sensor A:1", "both:sensor B:1"]


@pytest.mark.parametrize("leg", ["upper", "lower"])
def test_settle_divider_options_convert_counts_to_ohm(
    leg: str, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "board.csv"
    read = counts(OHM, leg=leg, reference_ohm=1000.0)
    path.write_text(table(TIME_S * 1e3, read, header="ms,A0", row_format="{:.0f},{:.0f}"))
    circuit = ("--adc-bits", "10", "--reference-ohm", "1000", "--sensor-leg", leg)
    found, _, message = run_settle(path, palpate, *circuit)
    assert found == pytest.approx(SETTLED, rel=0.01)
    assert message == ""
    found, _, message = run_settle(path, palpate)
    assert all(value == pytest.approx(round(value), abs=1) for value in found)
    assert "interpreted as counts" in message
    assert "0 to 255" in run_refused(path, palpate, "--adc-bits", "8", *circuit[2:])
    assert "give all three" in palpate("settle", path, *circuit[:2], status=2).err


def test_settle_saturated_converter_is_refused(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "low.csv"
    read = np.clip(counts(OHM, leg="upper", reference_ohm=1000.0) * 1.6, 0, 1023)
    path.write_text(table(TIME_S * 1e3, read, header="ms,A0", row_format="{:.0f},{:.0f}"))
    assert "at the end of the converter's range" in run_refused(path, palpate)


@pytest.mark.parametrize(
    "values", [-OHM, 100 * (OHM / 2000 - 1), 100 * (1 - OHM / 2000), 4e6 / OHM]
)
def test_settle_finds_holds_for_any_sign_and_direction(
    values: np.ndarray, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "sign.csv"
    path.write_text(table(TIME_S, values))
    found, _, _ = run_settle(path, palpate)
    ends = [values[np.argmin(np.abs(TIME_S - close_s - 20))] for close_s, _ in TOUCHES]
    assert found == pytest.approx(ends, rel=0.02)


def test_settle_reports_dropouts_loose_wire_and_broken_lines(
    tmp_path: Path, palpate: Command
) -> None:
    ohm = OHM.copy()
    ohm[1300:1303] = 0
    recorded = (TIME_S < 40) | (TIME_S > 41.5)
    lines = table(TIME_S[recorded], ohm[recorded]).splitlines()
    lines[300] = lines[300].split(",")[0] + ","
    lines[301] = lines[301].split(",")[0] + ",NaN"
    lines[400] = lines[400].split(",")[0] + ",ERR"
    lines[-1] = "87.9"
    path = tmp_path / "lost.csv"
    path.write_text("\n".join(lines))
    found, _, message = run_settle(path, palpate)
    assert found == pytest.approx(SETTLED, rel=1e-3)
    assert "1 row was omitted" in message
    assert "line 401" in message
    assert "3 readings at or below 0 ohm" in message


def test_settle_finds_holds_despite_noise_drift_or_truncation(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "r.csv"
    path.write_text(table(TIME_S, resistance_ohm(TIME_S, noise=0.08)))
    assert run_settle(path, palpate)[0] == pytest.approx(SETTLED, rel=0.05)
    path.write_text(table(TIME_S, resistance_ohm(TIME_S, drift=0.3)))
    assert len(run_settle(path, palpate)[0]) == 3
    one = TIME_S < 24
    path.write_text(table(TIME_S[one], OHM[one]))
    assert run_settle(path, palpate)[0] == pytest.approx(SETTLED[:1], rel=1e-3)


def test_settle_recording_beginning_under_load_omits_first_hold(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "middle.csv"
    later = TIME_S > 5
    path.write_text(table(TIME_S[later], OHM[later]))
    found, _, message = run_settle(path, palpate)
    assert found == pytest.approx(SETTLED[1:], rel=1e-3)
    assert "begins during a hold" in message


def test_settle_cut_option_replaces_contact_search(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "held.csv"
    held = (TIME_S > 2.2) & (TIME_S < 25)
    path.write_text(table(TIME_S[held], OHM[held]))
    assert run_settle(path, palpate)[0] == pytest.approx(SETTLED[:1], rel=0.01)
    late = (TIME_S > 4) & (TIME_S < 25)
    path.write_text(table(TIME_S[late], OHM[late]))
    message = run_refused(path, palpate)
    assert "no contact found" in message
    assert "--cut none" in message
    assert run_settle(path, palpate, "--cut", "none")[0] == pytest.approx(SETTLED[:1], rel=0.01)
    assert run_settle(path, palpate, "--cut", "4.5")[0] == pytest.approx(SETTLED[:1], rel=0.01)
    assert "the recording ends at" in run_refused(path, palpate, "--cut", "99")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("hello\nno table here\n", "no table found"),
        ("value\n1\n2\n3\n", "only one column"),
        ("time,value\n" + "".join(f"{k},{k % 7}\n" for k in range(50)), "--time-unit"),
        ("a,b\n" + "".join(f"{k % 9},{k}\n" for k in range(50)), "no time column recognised"),
        (table(TIME_S, 2000 + 500 * np.sin(TIME_S / 3)), "no contact found"),
        (table(TIME_S[::-1], OHM), "time decreases"),
        (table(TIME_S[:99], OHM[:99]) + "x,y\n" * 9, "no time in column time_s"),
        (table(TIME_S[:99], OHM[:99]) + "1,2,3\n" * 9, "line 101: 3 fields instead of 2"),
    ],
)
def test_settle_unusable_table_prints_one_line_error(
    content: str, message: str, tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(content)
    assert message in run_refused(path, palpate)


def test_settle_missing_column_error_lists_available_columns(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "r.csv"
    path.write_text(table(TIME_S, OHM, header="when,what"))
    assert "available: when, what" in run_refused(path, palpate, "--time-column", "x")
    assert "available: what" in run_refused(
        path, palpate, "--time-column", "when", "--value-column", "y"
    )
    options = ("--time-column", "when", "--time-unit", "s", "--value-column", "what")
    assert run_settle(path, palpate, *options)[0] == pytest.approx(SETTLED, rel=1e-3)


def test_settle_folder_reads_all_recordings(tmp_path: Path, palpate: Command) -> None:
    (tmp_path / "b.csv").write_text(FORMATS["plain.csv"])
    (tmp_path / "a.tsv").write_text(FORMATS["wraps.tsv"])
    (tmp_path / "notes.txt").write_text("all well\n")
    (tmp_path / "picture.png").write_bytes(b"ignored")
    found, holds, message = run_settle(tmp_path, palpate)
    assert found == pytest.approx(2 * SETTLED, rel=1e-3)
    assert holds[::3] == ["a:R:1", "b:resistance_ohm:1"]
    assert message.count("\n") == 1
    assert "notes.txt: no table found" in message


def test_cut_holds_arrays_and_data_frames_match_files(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(FORMATS["plain.csv"])
    from_file = cut_holds(read_recording(path))
    frame = pd.read_csv(path)
    series = frame["resistance_ohm"]
    for holds in (
        cut_holds(frame),
        cut_holds(read_recording(frame)),
        cut_holds(frame["time_s"], series),
        cut_holds({"t": frame["time_s"].to_numpy(), "R": series.to_numpy()}),
    ):
        assert len(holds) == 3
        for one, other in zip(from_file, holds, strict=True):
            np.testing.assert_array_equal(one.time_s, other.time_s)
            np.testing.assert_array_equal(one.values, other.values)
    with pytest.raises(InputError, match="no time column recognised"):
        read_recording({"a": [1.0, 0.0, 2.0], "b": [1.0, 2.0, 3.0]})


def test_cut_holds_start_after_loading_and_end_at_opening() -> None:
    [first, *_] = cut_holds(TIME_S, OHM)
    begin_s = TIME_S[np.flatnonzero(first.values[0] == OHM)[0]]
    end_s = TIME_S[np.flatnonzero(first.values[-1] == OHM)[0]]
    close_s, open_s = TOUCHES[0]
    assert close_s + 0.1 <= begin_s <= close_s + 0.4
    assert open_s - 0.1 <= end_s <= open_s + 0.05


@pytest.mark.slow
def test_settle_plot_titles_state_number_of_holds(tmp_path: Path, palpate: Command) -> None:
    path, plot = tmp_path / "r.csv", tmp_path / "cut.svg"
    path.write_text(FORMATS["plain.csv"])
    run_settle(path, palpate, "--plot", plot)
    assert "r.csv, resistance_ohm: 3 holds" in plot.read_text()


@pytest.mark.slow
def test_cut_holds_finds_every_touch_of_demo_recordings(tmp_path: Path) -> None:
    for path, columns in zip(write_recordings(tmp_path), (1, 1, 2), strict=True):
        assert len(cut_holds(read_recording(path))) == 4 * columns


def test_table_with_id_column_is_split_by_recording_or_hold(
    tmp_path: Path, palpate: Command
) -> None:
    one = pd.DataFrame({"recording_id": "a", "time_s": TIME_S, "R": OHM})
    frame = pd.concat([one, one.assign(recording_id="b")])
    assert [hold.hold_id for hold in cut_holds(frame)][2:4] == [
        *("recording:a:R:3", "recording:b:R:1")
    ]
    held = (TIME_S > 2.2) & (TIME_S < 25)
    path = tmp_path / "holds.xlsx"
    pd.DataFrame({"hold_id": "h", "time_s": TIME_S[held], "value": OHM[held]}).to_excel(path)
    found, holds, _ = run_settle(path, palpate)
    assert found == pytest.approx(SETTLED[:1], rel=0.01)
    assert holds == ["holds:value:1"]


@pytest.mark.parametrize("stated", ["A1", "A1:XFD1048576"])
def test_workbook_with_wrong_stated_size_is_read_completely(tmp_path: Path, stated: str) -> None:
    """Programs that add rows leave the size of an earlier save in place."""
    path, changed = tmp_path / "r.xlsx", tmp_path / "changed.xlsx"
    pd.DataFrame({"time_s": TIME_S, "R": OHM}).to_excel(path, index=False)
    with zipfile.ZipFile(path) as before, zipfile.ZipFile(changed, "w") as after:
        for name in before.namelist():
            content = before.read(name)
            if name == "xl/worksheets/sheet1.xml":
                content, n = re.subn(
                    rb'<dimension ref="[^"]*"', b'<dimension ref="%s"' % stated.encode(), content
                )
                assert n == 1
            after.writestr(name, content)
    found = read_recording(changed)
    assert found.time_s.size == TIME_S.size


@pytest.mark.slow
def test_settle_excel_without_extra_names_the_extra(
    tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "r.xlsx"
    pd.DataFrame({"time_s": TIME_S, "R": OHM}).to_excel(path)
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    assert "pip install 'palpate[data]'" in run_refused(path, palpate)


def test_hold_names_contain_recording_numbers_as_integers(tmp_path: Path) -> None:
    one = pd.DataFrame({"run": 1, "time_s": TIME_S, "R": OHM})
    path = tmp_path / "runs.xlsx"
    pd.concat([one, one.assign(run=2)]).to_excel(path)
    names = [hold.hold_id for hold in cut_holds(path)]
    assert names[2:4] == ["runs:1:R:3", "runs:2:R:1"]
