"""Forms in which loggers, terminals and programs write readings, and what is read of each.

The readers of holds and of known loads are tested on each.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

import numpy as np

#: A recording of two sensors: at rest, a contact at 3 s, a hold.
TIME_S = np.round(np.arange(0.0, 25.0, 0.1), 3)
_HELD = TIME_S >= 3.0
_CREEP = np.log1p(np.maximum(TIME_S - 3.0, 0.0) / 0.3)
ONE = np.where(_HELD, 412 - 9 * _CREEP, 620).round().astype(int)
TWO = np.where(_HELD, 530 - 11 * _CREEP, 806).round().astype(int)
FORCE_N = np.where(_HELD, 6.25 - 0.25 * _CREEP, 0.0).round(3)
#: Ohm with four digits before the decimal mark, and counts that never repeat.
OHM = (100.0 * ONE + 18.7).round(1)
ROWS = range(TIME_S.size)
START = datetime(2024, 5, 31, 12, 34, 50, 120_000)


@dataclass(frozen=True, slots=True)
class Form:
    """One form of a file."""

    #: What writes it.
    what: str
    #: Content of the file, and its ending.
    content: str | bytes
    ending: str = ".txt"
    #: Arguments of `palpate.read_recording` that it needs.
    options: Mapping[str, Any] = field(default_factory=dict)
    #: Readings by column, or by recording and column; empty if the file is refused.
    columns: Mapping[str, Any] = field(default_factory=dict)
    #: Part of the message if the file is refused.
    refused: str = ""


def stamp(row: int, form: str, *, start: datetime = START) -> str:
    """Return the time of a row in a `strftime` form; %f has milliseconds."""
    moment = start + timedelta(seconds=float(TIME_S[row]))
    return moment.strftime(form.replace("%f", f"{moment.microsecond // 1000:03d}"))


def lines(line: Callable[[int], str], *, head: str = "") -> str:
    """Return a line for each row, below a header."""
    return head + "".join(line(row) + "\n" for row in ROWS)


def comma(number: float, digits: int = 1) -> str:
    """Return a number with a decimal comma."""
    return f"{number:.{digits}f}".replace(".", ",")


def archive(name: str) -> bytes:
    """Return a zip archive with one entry."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr(name, b"x")
    return file.getvalue()


def workbook(*sheets: list[list[Any]]) -> bytes:
    """Return a workbook with a sheet for each list of rows."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for number, rows in enumerate(sheets, start=1):
        sheet = book.create_sheet(f"Run {number}")
        for row in rows:
            sheet.append(row)
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()


def _open(words: str) -> str:
    return lines(
        lambda r: f"{TIME_S[r]:.1f},{OHM[r] if _HELD[r] else words}", head="time_s,R_ohm\n"
    )


_SHEET = [["Test time", "Standard force"], ["s", "N"]]
_SHEET += [[float(t), float(f)] for t, f in zip(TIME_S, FORCE_N, strict=True)]
_OPEN_OHM = np.where(_HELD, OHM, np.inf)
_STAMP = "%H:%M:%S.%f -> "

TERMINALS = (
    Form(
        "Arduino IDE, two values",
        lines(lambda r: stamp(r, _STAMP) + f"{ONE[r]},{TWO[r]}"),
        columns={"2": ONE, "3": TWO},
    ),
    Form(
        "Arduino IDE, labels",
        lines(lambda r: stamp(r, _STAMP) + f"A0:{ONE[r]}\tA1:{TWO[r]}"),
        columns={"A0": ONE, "A1": TWO},
    ),
    Form(
        "labels with units",
        lines(lambda r: stamp(r, _STAMP) + f"FSR: {ONE[r]} | Weight: {FORCE_N[r]} g"),
        columns={"FSR": ONE},
    ),
    Form(
        "a label in each line",
        lines(
            lambda r: (
                stamp(r, _STAMP) + f"left = {ONE[r]}\n" + stamp(r, _STAMP) + f"right = {TWO[r]}"
            )
        ),
        columns={"left": ONE, "right": TWO},
    ),
    Form(
        "own clock first",
        lines(lambda r: stamp(r, _STAMP) + f"{54321 + round(1e3 * TIME_S[r])},{ONE[r]}"),
        columns={"3": ONE},
    ),
    Form(
        "header among the lines",
        lines(
            lambda r: stamp(r, _STAMP) + f"{round(1e3 * TIME_S[r])},{ONE[r]}",
            head="12:34:49.800 -> ready\n12:34:49.900 -> ms,fsr\n",
        ),
        columns={"fsr": ONE},
    ),
    Form(
        "over midnight",
        lines(lambda r: stamp(r, _STAMP, start=datetime(2024, 5, 31, 23, 59, 50)) + f"{ONE[r]}"),
        columns={"2": ONE},
    ),
    Form(
        "date and arrow",
        lines(lambda r: stamp(r, "%Y-%m-%d %H:%M:%S.%f -> ") + f"{ONE[r]}"),
        columns={"2": ONE},
    ),
    Form(
        "tio, Tera Term, arduino-cli",
        lines(lambda r: stamp(r, "[%Y-%m-%d %H:%M:%S.%f] ") + f"{ONE[r]} {TWO[r]}"),
        columns={"2": ONE, "3": TWO},
    ),
    Form(
        "PlatformIO",
        lines(lambda r: stamp(r, "%H:%M:%S.%f > ") + f"{ONE[r]}", head="--- Terminal\n"),
        columns={"2": ONE},
    ),
    Form(
        "PuTTY, own clock in ms",
        lines(
            lambda r: f"{54321 + round(1e3 * TIME_S[r])},{ONE[r]}",
            head="=~=~=~=~= PuTTY log 2024.05.31 12:34:50 =~=~=~=~=\n",
        ),
        columns={"2": ONE},
    ),
    Form(
        "comma in the time",
        lines(lambda r: stamp(r, "%H:%M:%S,%f -> ") + f"{ONE[r]},{TWO[r]}"),
        refused="may separate two readings or be a decimal mark",
    ),
    Form(
        "JSON lines",
        lines(
            lambda r: json.dumps(
                {"t_ms": round(1e3 * TIME_S[r]), "fsr": [int(ONE[r]), int(TWO[r])]}
            )
        ),
        columns={"fsr.0": ONE, "fsr.1": TWO},
    ),
    Form(
        "JSON document",
        json.dumps([{"t": float(TIME_S[r]), "fsr": int(ONE[r])} for r in ROWS], indent=1),
        refused="a JSON document",
    ),
)
SENSORS = (
    Form(
        "a row per sensor",
        lines(
            lambda r: f"{TIME_S[r]},S1,{ONE[r]}\n{TIME_S[r]},S2,{TWO[r]}",
            head="time_s,sensor,value\n",
        ),
        columns={"S1": ONE, "S2": TWO},
    ),
    Form(
        "a row per channel number",
        lines(
            lambda r: f"{TIME_S[r]},0,{ONE[r]}\n{TIME_S[r]},1,{TWO[r]}",
            head="time_s,channel,value\n",
        ),
        columns={"0": ONE, "1": TWO},
    ),
    Form(
        "a line per reading, -1 before a frame",
        lines(lambda r: "\n".join(stamp(r, _STAMP) + f"{v}" for v in (-1, ONE[r], TWO[r]))),
        columns={"place 1": ONE, "place 2": TWO},
    ),
    Form(
        "a line per reading, equal times",
        lines(lambda r: "\n".join(stamp(r, _STAMP) + f"{v}" for v in (ONE[r], TWO[r]))),
        columns={"place 1": ONE, "place 2": TWO},
    ),
    Form(
        "the same, readings missing",
        lines(
            lambda r: "\n".join(
                stamp(r, _STAMP) + f"{v}" for v in (ONE[r], TWO[r], TWO[r] + 99)[: 1 + r % 3]
            )
        ),
        refused="rows with the same time have different readings",
    ),
    Form(
        "two readings in a clock tick",
        lines(lambda r: f"{TIME_S[r]},{ONE[r]}\n{TIME_S[r]},{ONE[r]}", head="time_s,fsr\n"),
        columns={"fsr": ONE},
    ),
)
TIMES = (
    Form(
        "ISO date and tab",
        lines(lambda r: stamp(r, "%Y-%m-%d %H:%M:%S.%f\t") + f"{ONE[r]}"),
        columns={"2": ONE},
    ),
    Form(
        "ISO date with T and Z",
        lines(lambda r: stamp(r, "%Y-%m-%dT%H:%M:%S.%fZ,") + f"{ONE[r]}", head="timestamp,fsr\n"),
        columns={"fsr": ONE},
    ),
    Form(
        "month first, AM and PM",
        lines(lambda r: stamp(r, "%m/%d/%Y %I:%M:%S.%f %p,") + f"{ONE[r]}", head="Timestamp,FSR\n"),
        columns={"FSR": ONE},
    ),
    Form(
        "European date",
        lines(lambda r: stamp(r, "%d.%m.%Y %H:%M:%S,%f;") + f"{ONE[r]}", head="Datum;fsr\n"),
        columns={"fsr": ONE},
    ),
    Form(
        "days or months, over months",
        "date,fsr\n"
        + "".join(f"{d:02d}/{m:02d}/2024,{620 - m}\n" for m in range(1, 13) for d in (1, 6, 11)),
        refused="may be day/month or month/day",
    ),
    Form(
        "the clock restarts",
        lines(
            lambda r: f"{round(1e3 * TIME_S[r])},{ONE[r]}",
            head="ms,fsr\n" + "".join(f"{54321 + 100 * k},620\n" for k in range(8)),
        ),
        columns={"part 1": {"fsr": np.full(8, 620)}, "part 2": {"fsr": ONE}},
    ),
    Form(
        "total and cycle time",
        lines(
            lambda r: f"{TIME_S[r] % 5:.1f};{TIME_S[r]:.1f};{ONE[r]}",
            head="Cycle time;Total time;fsr\n",
        ),
        columns={"fsr": ONE},
    ),
    Form(
        "seconds and nanoseconds",
        lines(
            lambda r: f"{1_700_000_000 + int(TIME_S[r])},{1e9 * (TIME_S[r] % 1):.0f},{ONE[r]}",
            head="header.stamp.sec,header.stamp.nanosec,data\n",
        ),
        columns={"data": ONE},
    ),
    Form(
        "time of day and milliseconds",
        lines(lambda r: f"{stamp(r, '%H:%M:%S')};{stamp(r, '%f')};{ONE[r]}", head="Time;ms;fsr\n"),
        columns={"fsr": ONE},
    ),
    Form(
        "no clock",
        lines(lambda r: f"{ONE[r]},{TWO[r]}", head="left,right\n"),
        refused="no time column recognised",
    ),
    Form(
        "no clock, one column",
        lines(lambda r: f"{ONE[r]}"),
        options={"interval_s": 0.1},
        columns={"1": ONE},
    ),
)
NUMBERS = (
    Form(
        "German",
        lines(lambda r: f"{comma(TIME_S[r])};{comma(OHM[r])}", head="Zeit [s];Widerstand [Ohm]\n"),
        columns={"Widerstand [Ohm]": OHM},
    ),
    Form(
        "thousands with points",
        lines(
            lambda r: f"{comma(TIME_S[r])};{OHM[r] // 1000:.0f}.{comma(OHM[r] % 1000).zfill(5)}",
            head="time_s;R_ohm\n",
        ),
        columns={"R_ohm": OHM},
    ),
    Form(
        "thousands in quotes",
        lines(lambda r: f'{TIME_S[r]},"{OHM[r]:,.1f}"', head="time_s,R_ohm\n"),
        columns={"R_ohm": OHM},
    ),
    Form(
        "thousands with spaces",
        lines(
            lambda r: f"{comma(TIME_S[r])};" + f"{OHM[r]:,.1f}".replace(",", " ").replace(".", ","),
            head="time_s;R_ohm\n",
        ),
        columns={"R_ohm": OHM},
    ),
    Form(
        "points and decimal commas",
        lines(lambda r: f"{comma(TIME_S[r])};{ONE[r] // 10}.018", head="time_s;R_ohm\n"),
        refused="say --decimal comma if '.' separates thousands",
    ),
    Form(
        "two decimal marks",
        lines(lambda r: f"{TIME_S[r]};{comma(OHM[r] / 1e3, 2)}", head="time_s;R_kohm\n"),
        refused="have different decimal marks",
    ),
    Form(
        "row of units",
        lines(
            lambda r: f"{comma(TIME_S[r])};{comma(FORCE_N[r], 3)};3,00",
            head="Time;Force;Extension\ns;N;mm\n",
        ),
        columns={"Force [N]": FORCE_N},
    ),
    Form(
        "row of other units",
        lines(
            lambda r: f"{TIME_S[r] / 60:.6f},{FORCE_N[r] / 1e3:.6f},4.5",
            head="time,load,strain\nmin,kN,%\n",
        ),
        columns={"load [kN]": FORCE_N},
    ),
    Form("blank at rest", _open(""), columns={"R_ohm": np.where(_HELD, OHM, np.nan)}),
    Form("OL at rest", _open("OL"), columns={"R_ohm": _OPEN_OHM}),
    Form("9.9E37 at rest", _open("9.90000E+37"), columns={"R_ohm": _OPEN_OHM}),
)
FILES = (
    Form(
        "note without a header",
        lines(lambda r: f"{TIME_S[r]:.1f} {ONE[r]}", head="Velostat pad number three\n"),
        columns={"2": ONE},
    ),
    Form(
        "LabVIEW .lvm",
        lines(
            lambda r: f"{TIME_S[r]:.6f}\t{ONE[r]:.6f}",
            head="LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n"
            "Channels\t1\t\nDelta_X\t0.100000\n***End_of_Header***\t\nX_Value\tVoltage\n",
        ),
        ending=".lvm",
        columns={"Voltage": ONE},
    ),
    Form(
        "Excel, several sheets",
        workbook([["Series", "Fmax"], ["n = 3", "N"], ["x", 1.07]], _SHEET, _SHEET),
        ending=".xlsx",
        columns={"Standard force [N]": FORCE_N},
    ),
    Form(
        "Excel, a note in a far cell",
        workbook([[*row, "", "checked"] if k == 8 else row for k, row in enumerate(_SHEET)]),
        ending=".xlsx",
        columns={"Standard force [N]": FORCE_N},
    ),
    Form("NumPy .npz", archive("t.npy"), ending=".npz", refused="a NumPy archive"),
    Form("ROS 1 bag", b"#ROSBAG V2.0\n\x45\0\0\0", ending=".bag", refused="a ROS 1 bag"),
    Form(
        "MATLAB .mat",
        b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(128),
        ending=".mat",
        refused="a MATLAB file",
    ),
    Form(
        "LabVIEW .tdms",
        b"TDSm\x0e\0\0\0".ljust(64, b"\0"),
        ending=".tdms",
        refused="a LabVIEW .tdms file",
    ),
)
CELLS = (
    Form(
        "unit in each cell",
        lines(lambda r: f"{comma(TIME_S[r])} s;{comma(OHM[r] / 1e3, 4)} kOhm", head="Zeit;Wert\n"),
        columns={"Wert [kOhm]": OHM},
    ),
    Form(
        "a meter that changes its range",
        lines(
            lambda r: (
                f"{TIME_S[r]},{FORCE_N[r]} N"
                if FORCE_N[r] > 5.9
                else f"{TIME_S[r]},{1e3 * FORCE_N[r]:.0f} mN"
            ),
            head="time_s,push\n",
        ),
        columns={"push [N]": FORCE_N},
    ),
    Form(
        "the same behind a label",
        lines(
            lambda r: f"U: {ONE[r] / 1e3:.3f} V" if ONE[r] > 600 else f"U: {ONE[r]} mV",
        ),
        options={"interval_s": 0.1},
        columns={"U [V]": ONE / 1e3},
    ),
    Form(
        "a prefix without a unit",
        lines(lambda r: f"{TIME_S[r]}\t{OHM[r] / 1e6:.7f}M", head="t\tR\n"),
        columns={"R": OHM},
    ),
    Form(
        "a column of units",
        lines(lambda r: f"{TIME_S[r]},{FORCE_N[r] * 1e3:.0f},mN,OK", head="t_s,kraft,Einheit,\n"),
        columns={"kraft [mN]": FORCE_N},
    ),
    Form(
        "columns of signs and units",
        lines(lambda r: stamp(r, "%H:%M:%S.%f") + f"  {'+-'[int(_HELD[r])]}  {FORCE_N[r]} N"),
        columns={"3 [N]": -FORCE_N},
    ),
    Form(
        "open with a unit",
        lines(lambda r: f"{TIME_S[r]};{f'{OHM[r]} Ω' if _HELD[r] else 'OL MΩ'}", head="t;read\n"),
        columns={"read [Ohm]": _OPEN_OHM},
    ),
    Form(
        "a unit in some cells",
        lines(lambda r: f"{TIME_S[r]},{ONE[r]}{' mV' * (r % 3 == 0)}", head="t,U\n"),
        refused="write the unit in each cell",
    ),
    Form(
        "two quantities in a column",
        lines(lambda r: f"{TIME_S[r]},{ONE[r]} {('mV', 'g')[r % 2]}", head="t,U\n"),
        refused="can't be converted to one",
    ),
    Form(
        "a checksum that ends like a unit",
        lines(lambda r: f"{TIME_S[r]},{ONE[r]},{37 * r % 256:02X}", head="time_s,A0,crc\n"),
        columns={"A0": ONE},
    ),
    Form(
        "above the range with a unit",
        lines(lambda r: f"{TIME_S[r]},{f'{OHM[r]} Ω' if _HELD[r] else '9.9E37 Ω'}", head="t,R\n"),
        columns={"R": _OPEN_OHM},
    ),
    Form(
        "a counter next to texts",
        lines(lambda r: f"{TIME_S[r]},{r + 1},0x{ONE[r]:X}", head="time_s,number,fsr\n"),
        refused="fsr has texts such as '0x26C'",
    ),
)
HEADERS = (
    Form(
        "in a comment, with other separators",
        lines(
            lambda r: f"{TIME_S[r] / 60:.6f} {OHM[r] / 1e3}",
            head="# NumPy\n# columns: time [min], R [kOhm]\n",
        ),
        columns={"R[kOhm]": OHM},
    ),
    Form(
        "units in a comment above the names",
        lines(lambda r: f"{TIME_S[r] / 60:.6f},{FORCE_N[r] / 10}", head="# min, daN\ntime,F\n"),
        columns={"F [daN]": FORCE_N},
    ),
    Form(
        "behind another mark",
        lines(lambda r: f"{TIME_S[r] / 60:.6f} {OHM[r] / 1e3}", head="! t_min R_kohm\n"),
        columns={"R_kohm": OHM},
    ),
    Form(
        "with separators for empty columns",
        lines(lambda r: f"{TIME_S[r] / 60:.6f};{OHM[r] / 1e3};;;;;", head="t_min;R_kohm;;;;;\n"),
        columns={"R_kohm": OHM},
    ),
    Form(
        "separated by other marks than the rows",
        lines(lambda r: f"{TIME_S[r] / 60:.6f};{FORCE_N[r] * 1e3:.1f}", head="time_min|F_mN\n"),
        columns={"F_mN": FORCE_N},
    ),
    Form(
        "without a name for the number of the row",
        lines(lambda r: f'"{r + 1}" {TIME_S[r]} {OHM[r]}', head='"time_s" "R_ohm"\n'),
        columns={"R_ohm": OHM},
    ),
    Form(
        "longer than the rows",
        lines(lambda r: f"{TIME_S[r]},{OHM[r]}", head="time_min,R_kohm,humidity\n"),
        refused="the header has 3 names",
    ),
    Form(
        "another one in the middle",
        lines(
            lambda r: "ms,volt\n" * (r == 90) + f"{TIME_S[r]},{FORCE_N[r]}", head="time_s,force_n\n"
        ),
        refused="line 92: another header",
    ),
)
MORE = (
    Form(
        "days and times",
        lines(
            lambda r: (
                f"{(d := divmod(86395 + TIME_S[r], 86400))[0]:.0f} days "
                f"{d[1] // 3600:02.0f}:{d[1] // 60 % 60:02.0f}:{d[1] % 60:06.3f},{ONE[r]}"
            ),
            head="elapsed,adc\n",
        ),
        columns={"adc": ONE},
    ),
    Form(
        "hours, minutes and seconds in columns",
        lines(
            lambda r: f"{(TIME_S[r] + 50) // 60:.0f};{(TIME_S[r] + 50) % 60:.1f};{ONE[r]}",
            head="min;s;adc\n",
        ),
        columns={"adc": ONE},
    ),
    Form(
        "hours, minutes and seconds in one number",
        lines(
            lambda r: f"{1159 + (TIME_S[r] > 9.9) * 41:.0f}{(TIME_S[r] + 50) % 60:04.1f},{ONE[r]}",
            head="time,adc\n",
        ),
        refused="hours, minutes and seconds in one number",
    ),
    Form(
        "a first line that has lost its beginning",
        lines(lambda r: f"{954321 + round(1e3 * TIME_S[r])} {ONE[r]}", head="21 620\n"),
        columns={"2": ONE},
    ),
    Form(
        "ticks of 100 ns",
        lines(
            lambda r: f"{639_126_000_000_000_000 + round(1e7 * TIME_S[r])},{ONE[r]}",
            head="timestamp,adc\n",
        ),
        refused="may be ticks of 100 ns",
    ),
    Form(
        "a clock in another language",
        lines(lambda r: f"{TIME_S[r] / 60:.6f};{ONE[r]}", head="Czas [min];adc\n"),
        columns={"adc": ONE},
    ),
    Form(
        "seconds and microseconds without a header",
        lines(
            lambda r: f"{1_700_000_000 + int(TIME_S[r])} {1e6 * (TIME_S[r] % 1):.0f} {ONE[r]}",
        ),
        columns={"3": ONE},
    ),
    Form(
        "numbers of the sensors without a header",
        lines(lambda r: f"{100 * r}\t7\t{ONE[r]}\n{100 * r}\t8\t{TWO[r]}"),
        columns={"7": ONE, "8": TWO},
    ),
    Form(
        "groups of two digits",
        lines(
            lambda r: f'{TIME_S[r]},"{OHM[r] // 1000:.0f},{ONE[r] % 90 + 10},{ONE[r]}.5"',
            head="time_s,R_ohm\n",
        ),
        columns={"R_ohm": OHM // 1000 * 1e5 + (ONE % 90 + 10) * 1e3 + ONE + 0.5},
    ),
    Form(
        "thousands with spaces between tabs",
        lines(lambda r: f"{TIME_S[r]}\t{OHM[r] // 1000:.0f} {ONE[r]}", head="time_s\tR_ohm\n"),
        columns={"R_ohm": OHM // 1000 * 1000 + ONE},
    ),
    Form(
        "JSON in a text of JSON lines",
        lines(
            lambda r: json.dumps(
                {
                    "tst": stamp(r, "%Y-%m-%dT%H:%M:%S.%fZ"),
                    "payload": json.dumps({"p": int(ONE[r])}),
                }
            )
        ),
        columns={"payload.p": ONE},
    ),
)
FORMS = (*TERMINALS, *SENSORS, *TIMES, *NUMBERS, *CELLS, *HEADERS, *MORE, *FILES)
