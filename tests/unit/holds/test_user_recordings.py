"""Recording formats of users: every format yields the same holds or a one-line error."""

from __future__ import annotations

import re
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from tests.commands import Command
from tests.touches import counts, resistance_ohm

from palpate import cut_holds, read_recording
from palpate.errors import InputError

TIME_S = np.arange(0, 88, 0.04)
OHM = resistance_ohm(TIME_S)
#: Values of the three holds 20 s after their start.
SETTLED = pytest.approx([355.9, 322.0, 291.3], rel=1e-3)
FIRST = pytest.approx([355.9], rel=0.01)


def table(
    time: np.ndarray,
    values: np.ndarray,
    *,
    header: str = "time_s,resistance_ohm",
    row: str = "{:.3f},{:.4f}",
) -> str:
    rows = [row.format(t, v) for t, v in zip(time, values, strict=True)]
    return "\n".join([header, *rows]) + "\n"


def text_formats() -> dict[str, str | bytes]:
    plain, rounded = table(TIME_S, OHM), table(TIME_S, OHM, row="{:.3f};{:.3f}")
    lines = plain.splitlines()
    german = rounded.replace("time_s,resistance_ohm", "Zeit [s];Widerstand [Ohm]")
    german = german.replace(".", ",")
    quoted = [f'"{row}"'.replace(";", '","') for row in german.splitlines()[1:]]
    return {
        "plain.csv": plain,
        "wraps.tsv": table(
            (TIME_S * 1e6 + 4.25e9) % 2**32, OHM, header="micros\tR", row="{:.0f}\t{:.3f}"
        ),
        "unix-ms.csv": table(
            TIME_S * 1e3 + 1717149000e3, OHM, header="timestamp,R", row="{:.0f},{:.3f}"
        ),
        "comments.csv": "# by hand\n% more\nSensor: strip 3\n\n"
        + "\n".join([*lines[:700], "# a pause", "// and on", *lines[700:]]),
        "decimal-quoted.csv": "\n".join(['"time","R"', *quoted]) + "\n",
        "latin.csv": german.replace("Zeit", "Zeit für").encode("cp1252"),
        "utf16.txt": german.replace(";", "\t").replace("Ohm", "Ω").encode("utf-16"),
    }


FORMATS = text_formats()


class Found(NamedTuple):
    """Settled values and names of the holds of a file, and what was printed beside."""

    settled: list[float | None]
    names: list[str]
    message: str


class Desk:
    """Files of a user, for `palpate settle`."""

    def __init__(self, folder: Path, palpate: Command) -> None:
        self.folder, self.palpate = folder, palpate

    def write(self, content: str | bytes, name: str = "r.csv") -> Path:
        path = self.folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def settle(self, path: Path, *options: object) -> Found:
        printed = self.palpate("settle", path, "--json", "--method", "recorded", *options)
        rows = printed.document["rows"]
        names = [row["hold_id"] for row in rows]
        return Found([row["settled"] for row in rows], names, printed.err)

    def refused(self, path: Path, *options: object) -> str:
        error = self.palpate.refused("settle", path, "--json", *options)
        assert str(path) in error or path.stem in error
        return error


@pytest.fixture
def desk(tmp_path: Path, palpate: Command) -> Desk:
    return Desk(tmp_path, palpate)


@pytest.mark.parametrize("name", FORMATS)
def test_settle_every_text_format_has_same_holds(name: str, desk: Desk) -> None:
    found = desk.settle(desk.write(FORMATS[name], name))
    assert found.settled == SETTLED
    stem = name.split(".")[0]
    assert [hold.split(":")[0] for hold in found.names] == [stem] * 3
    assert [hold.rsplit(":", 1)[1] for hold in found.names] == ["1", "2", "3"]


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["xlsx", "parquet"])
def test_settle_reads_pandas_files_with_time_index(ending: str, desk: Desk) -> None:
    index = pd.to_datetime(TIME_S, unit="s", origin="2024-01-01")
    frame = pd.DataFrame({"sensor A": OHM, "sensor B": 2 * OHM, "note": "x"}, index=index)
    path = desk.folder / f"both.{ending}"
    {"xlsx": frame.to_excel, "parquet": frame.to_parquet}[ending](path)
    found = desk.settle(path)
    assert found.settled[:3] == SETTLED
    assert [value / 2 for value in found.settled[3:]] == SETTLED
    assert found.names[::3] == ["both:sensor A:1", "both:sensor B:1"]


@pytest.mark.parametrize("leg", ["upper", "lower"])
def test_settle_divider_options_convert_counts_to_ohm(leg: str, desk: Desk) -> None:
    read = counts(OHM, leg=leg, reference_ohm=1000.0)
    path = desk.write(table(TIME_S * 1e3, read, header="ms,A0", row="{:.0f},{:.0f}"))
    circuit = ("--adc-bits", "10", "--reference-ohm", "1000", "--sensor-leg", leg)
    found = desk.settle(path, *circuit)
    assert found.settled == pytest.approx([355.9, 322.0, 291.3], rel=0.01)
    assert found.message == ""
    found = desk.settle(path)
    assert all(value == pytest.approx(round(value), abs=1) for value in found.settled)
    assert "interpreted as counts" in found.message
    assert "0 to 255" in desk.refused(path, "--adc-bits", "8", *circuit[2:])
    assert "give all three" in desk.palpate("settle", path, *circuit[:2], status=2).err


def test_settle_saturated_converter_is_refused(desk: Desk) -> None:
    read = np.clip(counts(OHM, leg="upper", reference_ohm=1000.0) * 1.6, 0, 1023)
    path = desk.write(table(TIME_S * 1e3, read, header="ms,A0", row="{:.0f},{:.0f}"))
    assert "at the end of the converter's range" in desk.refused(path)


def test_settle_reports_dropouts_loose_wire_and_broken_lines(desk: Desk) -> None:
    ohm = OHM.copy()
    ohm[1300:1303] = 0
    recorded = (TIME_S < 40) | (TIME_S > 41.5)
    lines = table(TIME_S[recorded], ohm[recorded]).splitlines()
    for number, reading in ((300, ""), (301, "NaN"), (400, "ERR")):
        lines[number] = lines[number].split(",")[0] + f",{reading}"
    lines[-1] = "87.9"
    found = desk.settle(desk.write("\n".join(lines)))
    assert found.settled == SETTLED
    for remark in ("1 row was omitted", "line 401", "3 readings at or below 0 ohm"):
        assert remark in found.message


def test_settle_finds_holds_despite_noise_drift_or_truncation(desk: Desk) -> None:
    path = desk.write(table(TIME_S, resistance_ohm(TIME_S, noise=0.08)))
    assert desk.settle(path).settled == pytest.approx([355.9, 322.0, 291.3], rel=0.05)
    path = desk.write(table(TIME_S, resistance_ohm(TIME_S, drift=0.3)))
    assert len(desk.settle(path).settled) == 3
    path = desk.write(table(TIME_S[TIME_S < 24], OHM[TIME_S < 24]))
    assert desk.settle(path).settled == FIRST


def test_settle_recording_beginning_under_load_omits_first_hold(desk: Desk) -> None:
    found = desk.settle(desk.write(table(TIME_S[TIME_S > 5], OHM[TIME_S > 5])))
    assert found.settled == pytest.approx([322.0, 291.3], rel=1e-3)
    assert "begins during a hold" in found.message


def test_settle_cut_option_replaces_contact_search(desk: Desk) -> None:
    held = (TIME_S > 2.2) & (TIME_S < 25)
    assert desk.settle(desk.write(table(TIME_S[held], OHM[held]))).settled == FIRST
    late = (TIME_S > 4) & (TIME_S < 25)
    path = desk.write(table(TIME_S[late], OHM[late]))
    message = desk.refused(path)
    assert "no contact found" in message
    assert "--cut none" in message
    for cut in ("none", "4.5"):
        assert desk.settle(path, "--cut", cut).settled == FIRST
    assert "the recording ends at" in desk.refused(path, "--cut", "99")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (table(TIME_S, 2000 + 500 * np.sin(TIME_S / 3)), "no contact found"),
        (table(TIME_S[::-1], OHM), "time decreases"),
        (table(TIME_S[:99], OHM[:99]) + "x,y\n" * 9, "no time in column time_s"),
    ],
)
def test_settle_unusable_table_prints_one_line_error(
    content: str, message: str, desk: Desk
) -> None:
    assert message in desk.refused(desk.write(content))


def test_settle_folder_reads_all_recordings(desk: Desk) -> None:
    desk.write(FORMATS["plain.csv"], "b.csv")
    desk.write(FORMATS["wraps.tsv"], "a.tsv")
    desk.write("all well\n", "notes.txt")
    desk.write(b"ignored", "picture.png")
    found = desk.settle(desk.folder)
    assert found.settled[:3] == SETTLED
    assert found.settled[3:] == SETTLED
    assert found.names[::3] == ["a:R:1", "b:resistance_ohm:1"]
    assert found.message.count("\n") == 1
    assert "notes.txt: no table found" in found.message


def test_cut_holds_arrays_and_data_frames_match_files(desk: Desk) -> None:
    path = desk.write(FORMATS["plain.csv"])
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


def test_table_with_id_column_is_split_by_recording_or_hold(desk: Desk) -> None:
    one = pd.DataFrame({"recording_id": "a", "time_s": TIME_S, "R": OHM})
    frame = pd.concat([one, one.assign(recording_id="b")])
    assert [hold.hold_id for hold in cut_holds(frame)][2:4] == [
        *("recording:a:R:3", "recording:b:R:1")
    ]
    one = pd.DataFrame({"run": 1, "time_s": TIME_S, "R": OHM})
    path = desk.folder / "runs.xlsx"
    pd.concat([one, one.assign(run=2)]).to_excel(path)
    assert [hold.hold_id for hold in cut_holds(path)][2:4] == ["runs:1:R:3", "runs:2:R:1"]
    held = (TIME_S > 2.2) & (TIME_S < 25)
    path = desk.folder / "holds.xlsx"
    pd.DataFrame({"hold_id": "h", "time_s": TIME_S[held], "value": OHM[held]}).to_excel(path)
    found = desk.settle(path)
    assert found.settled == FIRST
    assert found.names == ["holds:value:1"]


@pytest.mark.slow
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
    assert read_recording(changed).time_s.size == TIME_S.size


@pytest.mark.slow
def test_settle_excel_without_extra_names_the_extra(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = desk.folder / "r.xlsx"
    pd.DataFrame({"time_s": TIME_S, "R": OHM}).to_excel(path)
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    assert "pip install 'palpate[data]'" in desk.refused(path)
