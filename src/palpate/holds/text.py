"""Reader of text tables: encoding, lines, layout and conversion to columns of numbers."""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BufferedReader, RawIOBase, TextIOWrapper
from itertools import chain, islice, pairwise
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds import table
from palpate.holds.cells import CellUnits, join_parts
from palpate.holds.columns import (
    find_named_unit,
    find_recording_column,
    time_unit_of,
    unit_of,
)
from palpate.holds.decimals import MarkEvidence, NumberFormat, is_missing, is_number, split_cell
from palpate.holds.log_lines import PLAIN, STAMP, LineForm, find_line_form, is_repeated
from palpate.holds.moments import is_moment, join_spaced
from palpate.holds.table import LONGEST_LINE, OPEN_NUMBER, Table, report_bad_rows
from palpate.holds.units import find_unit, is_unit_field

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

#: Rows of fields, and for each row the number of its first line in the file.
NumberedRows: TypeAlias = tuple[list[list[str]], Sequence[int]]

#: Enough to detect the encoding, notes, header and first rows.
SAMPLE_BYTES, SAMPLE_ROWS = 65536, 400
#: Separators in the order in which they are tried; None is any run of spaces.
SEPARATORS = ("\t", ";", ",", "|", None)
#: Separator of the texts of a column while they are collected; no text contains it.
_JOIN = "\x1f"
#: A column without a name and with fewer readings than this fraction of rows is a note.
_NOTE_FRACTION = 0.02
#: Number of consecutive data rows that mark the start of the data.
_DATA_RUN = 3
#: A field that is a number with a decimal comma or two numbers.
_TWO_PARTS = re.compile(r"[-+]?\d+,\d+")
#: A name of a column, such as "A0" or "R (kOhm)", but no note with numbers.
_COLUMN_NAME = re.compile(r"\D*|\s*[^\W\d_]+[ _]?\d{1,3}[^,\d]*")
#: Beginning of a comment.
_COMMENT = re.compile(r"#+|%+|//+")
#: The same, and beginnings of comments that are not skipped.
_MARKED = re.compile(r"^\s*(?:#+|%+|//+|!+|;+|\*+|'|>+|REM\s)", re.IGNORECASE)
#: Codes of colors for a terminal.
_COLORS = re.compile(r"\x1b\[[\d;]*[A-Za-z]")
#: Fields of a row below the units that states how a logger reduced its samples.
_REDUCTIONS = {"", "Smp", "Avg", "Max", "Min", "Std", "Tot", "Med"}
_TIME_FRACTION = re.compile(r"[^,]*\d:\d\d,(\d{3}|\d{6}),")
_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_ERRORS = (EOFError, zlib.error, gzip.BadGzipFile)
_GZIP_REMEDY = "the gzip data are truncated or damaged here; copy the file again"


@contextmanager
def open_text(file: BufferedReader, *, name: str) -> Iterator[TextIO]:
    r"""Open a file as decompressed, decoded text; ``\ufffd`` replaces bytes that can't be decoded.

    `file`: read once and in order, so it may be a pipe.
    Raises `InputError` if the file isn't text, or its gzip data are damaged.
    """
    try:
        binary = file
        if file.peek(2)[:2] == _GZIP_MAGIC:
            binary = BufferedReader(cast(RawIOBase, gzip.GzipFile(fileobj=file)), SAMPLE_BYTES)
        encoding = _encoding(binary.peek(SAMPLE_BYTES), name=name)
        with TextIOWrapper(binary, encoding=encoding, errors="replace", newline="") as text:
            yield text
    except _GZIP_ERRORS as error:
        raise InputError(f"{name} line 1: {_GZIP_REMEDY}") from error


def _encoding(start: bytes, *, name: str) -> str:
    """Return the encoding of a text from its first bytes."""
    if start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    # A logger that loses power leaves zeros at the end of its file.
    if b"\0" in start.rstrip(b"\0"):
        raise InputError(
            f"{name}: not a text file; give CSV, TSV, Excel (.xlsx), Parquet or an .mcap recording"
        )
    try:
        # An incremental decoder accepts a sample that ends in the middle of a character.
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def read_lines(text: TextIO) -> Iterator[str]:
    """Return an iterator over the lines, each of at most `LONGEST_LINE` characters."""
    return iter(lambda: text.readline(LONGEST_LINE), "")


def split_lines(lines: Iterable[str], *, separator: str | None, strict: bool = False) -> CsvReader:
    """Return a reader that splits lines into fields at a separator (None: spaces)."""
    if separator is None:
        spaced = (" ".join(line.split()) for line in lines)
        return csv.reader(spaced, delimiter=" ", quoting=csv.QUOTE_NONE)
    return csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=strict)


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the fields of one line; no fields if the line is not CSV."""
    try:
        return next(split_lines([line], separator=separator), [])
    except csv.Error:
        return []


def split_rows(
    lines: Iterable[str],
    *,
    separator: str | None,
    first_number: int,
    name: str,
    strict: bool = False,
) -> Iterator[NumberedRows]:
    """Yield the fields of each row, chunk by chunk; blank lines are rows without fields.

    `lines`: with line endings, as the csv module requires.
    `separator`: between fields; None for runs of spaces.
    `first_number`: number of the first line in the file.
    `strict`: whether to refuse stray and unclosed quotes.
    Raises `InputError` at a line that isn't CSV or whose gzip data are damaged, after yielding all
    previous rows.
    """
    reader = split_lines(lines, separator=separator, strict=strict)
    rows, starts, number = list[list[str]](), list[int](), first_number
    failure: Exception | None = None
    try:
        for row in reader:
            rows.append(row)
            starts.append(number)
            # Quoted fields may contain line breaks.
            number = first_number + reader.line_num
            if len(rows) == table.ROWS_AT_A_TIME:
                yield rows, starts
                rows, starts = [], []
    except (csv.Error, *_GZIP_ERRORS) as error:
        failure = error
    if rows:
        yield rows, starts
    if failure is not None:
        reason = _GZIP_REMEDY
        if isinstance(failure, csv.Error):
            reason = f"not CSV ({failure}); check for an unclosed quote"
        raise InputError(f"{name} line {number}: {reason}") from failure


def parse_numbers(fields: Sequence[str], *, comma: bool) -> FloatArray:
    """Return fields as finite numbers; NaN for a field that is not a usable number.

    `comma`: whether numbers have decimal commas.

    >>> parse_numbers(["1,5", "ERR", "1_000", "2e300"], comma=True).tolist()
    [1.5, nan, nan, nan]
    """
    numbers = NumberFormat(decimal="," if comma else ".").parse(fields)
    numbers[~np.isfinite(numbers)] = np.nan
    return numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Layout of a text table, detected from its first lines."""

    #: Separator between fields; None for runs of spaces.
    separator: str | None
    #: Column names from the header, or ``1``, ``2``, ... without a header; unique, not empty.
    names: list[str]
    #: Index of the first row of data.
    first: int
    #: Count of numbers found with this layout.
    score: int
    #: Form of the lines before they are split at the separator.
    form: LineForm = PLAIN
    #: One sentence for each assumption.
    remarks: tuple[str, ...] = ()
    #: Fields of the header, which a board that restarts repeats, without a terminal's time.
    header: tuple[list[str], ...] = ()

    def has_others(self, rows: Sequence[Sequence[str]]) -> bool:
        """Return whether some rows have no fields, or repeat the header."""
        own = rows if not self.form.stamped else [row[1:] for row in rows]
        return any(line in own for line in self.header) or "" in map("".join, rows)

    def is_data(self, row: Sequence[str]) -> bool:
        """Return whether a row has fields and doesn't repeat the header."""
        own = [*row[self.form.stamped :]]
        # A terminal's time without a reading is a row if there is one sensor, else an empty line.
        filled = own if len(self.names) > 2 else row
        return any(field.strip() for field in filled) and own not in self.header


def read_text(
    file: BufferedReader, *, name: str, decimal: str | None = None, without_clock: bool = False
) -> Table:
    """Read a table from a text file.

    Separators are commas, semicolons, tabs, bars or spaces; numbers have decimal points or commas;
    the encoding is UTF-8, UTF-16 or a Western code page. Notes before the header and lines that
    begin with ``#``, ``%`` or ``//`` are skipped, unless the last of them above the data are the
    only header. Lines of terminals and sketches may have times
    and labels (`palpate.holds.log_lines`).

    `decimal`: decimal mark; by default found in the numbers.
    `without_clock`: whether a single column is a table.
    Raises `InputError` if the file isn't text, contains no table, or has too many unusable rows.
    """
    with open_text(file, name=name) as text:
        plain = (_COLORS.sub("", line) if "\x1b" in line else line for line in read_lines(text))
        raw = list(islice(plain, SAMPLE_ROWS))
        # Comments become empty lines to preserve the line numbers.
        lines = ("\n" if _COMMENT.match(line) else line for line in chain(raw, plain))
        sample = list(islice(lines, SAMPLE_ROWS))
        layout = find_layout(sample, name=name, decimal=decimal, without_clock=without_clock)
        if not (layout.form.names or layout.form.stamped):
            names = _find_names(raw[: layout.first], layout, name=name)
            layout = replace(layout, names=names)
        rest = chain(sample[layout.first :], lines)
        rows = split_rows(
            (prepare_line(line, layout.form, layout.separator) for line in rest),
            separator=layout.separator,
            first_number=layout.first + 1,
            name=name,
        )
        layout.form.left_out.clear()
        found = gather_rows(rows, layout, name=name, decimal=decimal)
        found = _fill_clock(found, raw[: layout.first])
        found.omissions.extend(
            f"{label} has no reading in the first {SAMPLE_ROWS} lines; its later ones were omitted"
            for label, count in layout.form.left_out.items()
            if is_repeated(count, found.rows)
        )
        return found


def _fill_clock(found: Table, above: Sequence[str]) -> Table:
    """Return a table with the times of an empty X_Value, from the interval that LabVIEW states."""
    clock = found.columns.get("X_Value")
    stated = {"X0": {0.0}, "Delta_X": set[float]()}
    for line in above:
        key, _, rest = line.partition("\t")
        if key in stated:
            stated[key] = {float(one) for one in rest.replace(",", ".").split() if is_number(one)}
    if clock is None or clock.dtype != np.float64 or np.isfinite(clock).any():
        return found
    starts, steps = stated.values()
    # Channels of different rates have no common clock.
    if not len(starts) == len(steps) == 1:
        return found
    times = starts.pop() + steps.pop() * np.arange(found.rows)
    return replace(found, columns={**found.columns, "X_Value": times})


def _find_names(lines: Sequence[str], layout: Layout, *, name: str) -> list[str]:
    """Return the column names in the last lines above the data, or those of the layout.

    The lines may be comments, as of `numpy.savetxt`, or have another separator than the data. A
    comment may have the units of a header.

    Raises `InputError` if there are more names than columns.
    """
    marked = [line for line in lines if _COMMENT.match(line)]
    above = marked[-1:] if layout.header else [line for line in lines if line.strip()]
    above = [_MARKED.sub("", line).strip("\r\n") for line in above]
    width, found = len(layout.names), list[list[str]]()
    for line in above[-2:]:
        # "# columns: time [ms], R [kOhm]"
        body = re.sub(r"^\s*\w+:(?=\s)|\s+(?=[\[(])", "", line)
        for separator in (layout.separator, *SEPARATORS):
            row = [field.strip() for field in split_line(body, separator)]
            is_names = all(_COLUMN_NAME.fullmatch(f) and not re.search("[:=]", f) for f in row)
            is_units = all(map(is_unit_field, row)) and not any(map(find_named_unit, layout.names))
            if not (is_units if layout.header else is_names and _states_meaning(row)):
                continue
            if len(row) == width:
                found.append(row)
                break
            if width < len(row) <= width + 2 and separator is not None and line == above[-1]:
                raise InputError(
                    f"{name}: the header has {len(row)} names ({', '.join(row)[:60]}), but the "
                    f"rows have {width} fields; write one name for each field"
                )
    if layout.header and found:
        found.insert(0, layout.names)
    return _parse_header(found, width, stamped=False)[0] if found else layout.names


def _states_meaning(names: Sequence[str]) -> bool:
    """Return whether names state a clock or units, which a note of as many words may not."""
    is_units = all(unit_of(name) is not None or is_unit_field(name) for name in names)
    return is_units or any(time_unit_of(name) is not None for name in names)


def prepare_line(line: str, form: LineForm, separator: str | None) -> str:
    """Return a line whose fields are separated by the separator only."""
    line = form.rewrite(line, separator=separator)
    return join_spaced(line) if separator is None else line


def find_layout(
    lines: Sequence[str], *, name: str, decimal: str | None = None, without_clock: bool = False
) -> Layout:
    """Return the layout that yields the most numbers in the first lines of a file.

    Raises `InputError` if no separator yields rows of at least two fields with numbers.

    >>> find_layout(["my log", "time;value", "0,0;5,5", "0,1;5,4"], name="a.csv").names
    ['time', 'value']
    """
    form = find_line_form(lines)
    narrowest = 1 if without_clock else 2
    best = _find_best(lines, form, decimal=decimal, narrowest=narrowest)
    if best is None and form.labels:
        # The labels may be in a column of a table.
        plain = replace(form, labels=(), own_clock=False, is_json=False)
        best = _find_best(lines, plain, decimal=decimal, narrowest=narrowest)
    if best is None:
        if lines and re.match(r"\s*(\[\s*([\[{]|$)|\{\s*(\"|$))", lines[0]):
            raise InputError(
                f"{name}: a JSON document; write one object per line, or save the table as CSV"
            )
        has_one_column = sum(is_number(line) for line in lines if line.strip()) > 1
        raise InputError(
            f"{name}: only one column; a recording needs a column of times and a column of "
            "readings; for readings at equal intervals say --interval SECONDS"
            if has_one_column
            else f"{name}: no table found in the first lines; expected rows of times and "
            "readings, such as time,value"
        )
    if decimal is None and not form.labels and best.separator == ",":
        best = _check_commas(best, lines, name=name, without_clock=without_clock)
    return best


def _find_best(
    lines: Sequence[str], form: LineForm, *, decimal: str | None, narrowest: int
) -> Layout | None:
    found: list[Layout] = []
    for separator in ["\t"] if form.labels else SEPARATORS:
        # A comma that the user calls a decimal mark separates no fields.
        if decimal is not None and separator == decimal and not form.labels:
            continue
        rows = [split_line(prepare_line(line, form, separator), separator) for line in lines]
        layout = detect_layout(rows, separator=separator, form=form, narrowest=narrowest)
        found += [layout] if layout else []
    best = max(found, key=lambda layout: layout.score, default=None)
    if best is not None and best.separator is None and best.names[-1].startswith("column "):
        # Spaces between groups of thousands leave fields without a name.
        named = [one for one in found if one.header and 2 * one.score > best.score]
        best = next((one for one in named if not one.names[-1].startswith("column ")), best)
    return best


def _check_commas(
    layout: Layout, lines: Sequence[str], *, name: str, without_clock: bool
) -> Layout:
    """Return a layout whose commas separate fields, with a remark if that was assumed.

    Raises `InputError` if they may be decimal marks: a header has one name for two fields; a number
    without a clock has two parts; or a terminal writes its own times with commas.
    """
    form = layout.form
    data = [line for line in lines[layout.first :] if line.strip()]
    parts = [form.split(line) for line in data] if form.stamped else []
    bodies = [part[1] for part in parts if part] if form.stamped else data
    fields = len(split_line(bodies[0], ",")) if bodies else 0
    above = [line for line in lines[: layout.first] if line.strip()]
    head = above[-1:] if not form.stamped else [p[1] for p in map(form.split, above[-1:]) if p]
    heads = split_line(head[0], ",") if head else []
    names = len(heads) if all(map(_COLUMN_NAME.fullmatch, heads)) else 0
    pairs = [body for body in bodies if _TWO_PARTS.fullmatch(body.strip())]
    is_pair = bool(pairs) and len(pairs) > 0.5 * len(bodies)
    is_unclear = fields == 2 * names and not any("." in body for body in bodies)
    # 12:34:50,020 is a time with a decimal comma; a reading has no leading 0.
    fractions = [found[1] for line in data if (found := _TIME_FRACTION.match(line))]
    if len(fractions) > 0.9 * len(data) and any(part[0] == "0" for part in fractions):
        raise InputError(
            f"{name}: the first comma in {data[0].strip()[:40]!a} seems to be a decimal mark; "
            "write the times with points, or separate the fields with semicolons"
        )
    if is_pair and names != 2 and (form.stamped or without_clock):
        with_comma = form.stamped and re.search(r"\d,\d+ ?(-+>|[\])>])", data[0])
        # No board prints 05.
        is_unclear = bool(
            without_clock or with_comma or any(re.search(r",0\d", pair) for pair in pairs)
        )
        if not is_unclear:
            return replace(
                layout,
                remarks=("the commas separate readings; --decimal comma makes them decimal marks",),
            )
    firsts = [float(first) for body in bodies if (first := body.split(",")[0].strip()).isdecimal()]
    # The whole part of a reading doesn't increase from line to line, but a clock does.
    is_clock = len(firsts) > 2 and all(a < b for a, b in pairwise(firsts))
    if is_unclear and not is_clock:
        raise InputError(
            f"{name}: the comma in {data[0].strip()[:40]!a} may separate two readings or be a "
            "decimal mark; say --decimal point or --decimal comma"
        )
    return layout


def detect_layout(
    rows: Sequence[Sequence[str]],
    *,
    separator: str | None = None,
    form: LineForm = PLAIN,
    narrowest: int = 2,
) -> Layout | None:
    """Return the layout of rows of fields, or None if the rows form no table.

    `narrowest`: smallest number of columns.
    """
    numbers = [_score_row(row, narrowest=narrowest) for row in rows]
    widths = Counter(
        len(row)
        for row, count in zip(rows, numbers, strict=True)
        if len(row) >= narrowest and count
    )
    width = max(widths, key=lambda each: (widths[each], each), default=0)
    # An empty line from a terminal has the terminal's time.
    skipped = form.stamped and width > 2
    filled = [i for i, row in enumerate(rows) if any(field.strip() for field in row[skipped:])]
    data = {index for index in filled if len(rows[index]) == width and numbers[index]}
    starts = (
        k for place, k in enumerate(filled) if data.issuperset(filled[place : place + _DATA_RUN])
    )
    first = next(starts, None)
    if first is None:
        return None
    if sum(index < first for index in data) > _DATA_RUN + 0.2 * len(data):
        # Other lines among the data leave no run of rows.
        first = min(data)
    # Rows with a number above the first full row are data too, such as those of an open sensor.
    above = [index for index in filled if index < first]
    while above and len(rows[above[-1]]) == width and _has_number(rows[above[-1]], form):
        first = above.pop()
    # A row without its last field is no header either, if one precedes it.
    while len(above) > 1 and len(rows[above[-1]]) > 1 and all(map(is_number, rows[above[-1]])):
        first = above.pop()
    names, header = form.names, list[list[str]]()
    if names is None or len(names) != width:
        heads = [rows[index] for index in above]
        if heads and len(heads[-1]) == width - 1 and not form.stamped:
            first_rows = [rows[index] for index in filled if index in data]
            heads[-1] = ["", *heads[-1]] if _has_row_names(first_rows) else heads[-1]
        names, header = _parse_header(heads, width, stamped=form.stamped)
    return Layout(
        separator=separator,
        names=names,
        header=tuple(header),
        first=first,
        score=sum(numbers[index] for index in data),
        form=form,
    )


def _score_row(row: Sequence[str], *, narrowest: int) -> int:
    """Return the excess of number and time fields over text fields; 0 if not data."""
    number = text = missing = moment = 0
    for field in row:
        if is_number(field) or split_cell(field):
            number += 1
        elif is_moment(field):
            number, moment = number + 1, moment + 1
        elif is_missing(field):
            missing += 1
        elif find_unit(field) is None:
            text += 1
    if not number or number + missing < narrowest:
        return 0
    # A row with a moment or another number may have names and states as well, and a weight a name.
    is_row = (text <= number >= narrowest) or (moment > 0 and number > moment)
    return max(number - text, int(is_row))


def _has_number(row: Sequence[str], form: LineForm) -> bool:
    own = row[form.stamped :]
    # "5V" may be a name.
    with_unit = all(split_cell(field) or is_missing(field) for field in own)
    return any(is_number(field) or is_moment(field) for field in own) or with_unit


def _parse_header(
    above: Sequence[Sequence[str]], width: int, *, stamped: bool
) -> tuple[list[str], list[list[str]]]:
    """Return the column names above the data, and the lines of the header.

    The units may be in a line of their own, below or above the names.
    """
    fitting = [row for row in above if not any(map(_is_name, row[width:]))]
    if fitting and not {*fitting[-1]} - _REDUCTIONS:
        fitting = fitting[:-1]
    lines = [[field.strip(' \t"') for field in row][:width] for row in fitting[-2:]]
    # Spreadsheets write separators for empty columns at the end.
    written = "".join("x" if field else "." for field in lines[-1]) if lines else ""
    spare = len(written) - len(written.rstrip(".")) if len(written) == width else 0
    # The terminal's time in front of a header is no name.
    lines = [(["", *line[1:]] if stamped else line) for line in lines]
    lines = [line + [""] * (width - len(line)) for line in lines]
    units = [""] * width
    of_units = [any(line) and all(map(is_unit_field, line)) for line in lines]
    if len(lines) == 2 and of_units[1] and _is_header(lines[0], stamped=stamped, spare=spare):
        units = [field.strip("[](){}<>-") for field in lines.pop()]
    elif len(lines) == 2 and of_units[0] and 2 * sum(map(bool, lines[0])) >= width - stamped:
        units = [field.strip("[](){}<>-") for field in lines[0]]
    if not lines or not _is_header(lines[-1], stamped=stamped, spare=spare):
        plain = [STAMP] * stamped + [str(number) for number in range(1 + stamped, width + 1)]
        return plain, []
    names: list[str] = []
    for name, unit in zip(lines[-1], units, strict=True):
        name = " ".join((f"{name} [{unit}]" if unit else name).split())
        name = name or (STAMP if stamped and not names else f"column {len(names) + 1}")
        names.append(name if name not in names else f"{name} ({len(names) + 1})")
    return names, [[*row[stamped:]] for row in fitting[-2:]]


def _is_name(field: str) -> bool:
    """Return whether a field beyond the data names a column; one of comments may be empty."""
    return field.strip().lower() not in ("", "comment", "comments", "remark", "remarks")


def _has_row_names(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the first column numbers or names the rows, and the last one has readings.

    R writes such a table with a header that is one name shorter than the rows.
    """
    firsts = [row[0].strip('" ') for row in rows]
    counts = [int(first) for first in firsts if first.isdecimal()]
    numbered = len(counts) == len(rows) and all(b - a == 1 for a, b in pairwise(counts))
    named = not any(is_number(first) or is_moment(first) or is_missing(first) for first in firsts)
    return len(rows) > 1 and (numbered or named) and any(row[-1].strip() for row in rows)


def _is_header(line: Sequence[str], *, stamped: bool, spare: int) -> bool:
    """Return whether a line above the data names at least half of the columns.

    A note has one field. The first column of a table may have no name, if it is an index.
    `spare`: number of empty columns at the end.
    """
    named = sum(map(bool, line[stamped:]))
    is_index = not line[0] and not stamped
    wide = len(line) - stamped
    return 2 * named >= wide - spare and named >= min(2, wide - is_index)


def gather_rows(
    chunks: Iterable[NumberedRows],
    layout: Layout,
    *,
    name: str,
    word: str = "line",
    decimal: str | None = None,
) -> Table:
    """Gather rows into a table that lists its skipped rows and its non-numeric fields.

    The fields remain texts until all numbers have been seen, because the last may decide what a
    mark in the first means. A column is text if at least half of its first chunk is text.

    `word` ("line" or "row"): unit of the row numbers in messages.
    Raises `InputError` if there are no rows, or too many unusable ones.
    """
    names, width = layout.names, len(layout.names)
    texts: dict[str, list[str]] = {column: [] for column in names}
    evidence = MarkEvidence()
    used: list[int] = []
    bad: list[tuple[str, str]] = []
    for rows, numbers in chunks:
        if set(map(len, rows)) != {width} or layout.has_others(rows):
            filled = [i for i, row in enumerate(rows) if layout.is_data(row)]
            complete = [
                i
                for i in filled
                if len(rows[i]) >= width and not any(f.strip() for f in rows[i][width:])
            ]
            bad += [
                (f"{word} {numbers[i]}", f"{len(rows[i])} fields instead of {width}")
                for i in sorted({*filled} - {*complete})
            ]
            rows, numbers = [rows[i][:width] for i in complete], [numbers[i] for i in complete]
        if not rows:
            continue
        places = [f"{word} {number}" for number in numbers]
        for column, fields in zip(names, zip(*rows, strict=True), strict=True):
            evidence.look(fields, places=places)
            joined = _JOIN.join(fields)
            if joined.count(_JOIN) != len(fields) - 1:
                joined = _JOIN.join(text.replace(_JOIN, " ") for text in fields)
            texts[column].append(joined)
        used += numbers
    omissions = report_bad_rows(bad, total=len(used) + len(bad), name=name)
    if not used:
        raise InputError(f"{name}: no rows of numbers; expected times and readings")
    format_ = evidence.decide(name=name, separator=layout.separator, wanted=decimal)
    if format_.group and (evidence.group or evidence.either):
        omissions.append(f"{format_.group!r} separates thousands")
    join_parts(texts, mark=_JOIN)
    columns: dict[str, NDArray[Any]] = {}
    odd: dict[int, list[str]] = {}
    for column in [*texts]:
        units = CellUnits(column=column)
        cells = _parse_column(
            texts.pop(column),
            format_,
            units=units,
            numbers=used,
            word=word,
            omissions=omissions,
            odd=odd,
        )
        if units.rows and cells.dtype != object:
            column = units.convert(cells, place=lambda row: f"{word} {used[row]}", name=name)
        columns[column] = cells
    heads = {field.strip() for line in layout.header for field in line}
    for row, words in odd.items():
        if len(words) > 1 and (heads & {*words} or _states_meaning(words)):
            raise InputError(
                f"{name} {word} {used[row]}: another header ({', '.join(words)[:60]}); save each "
                "table as its own file"
            )
    for column in [c for c in columns if c.startswith("column ") or c.isdigit()]:
        cells = columns[column]
        is_text = cells.dtype == object
        count = sum(map(bool, cells)) if is_text else int(np.isfinite(cells).sum())
        if count < _NOTE_FRACTION * len(used):
            del columns[column]
            if count and not is_text:
                omissions.append(f"{column} has no name and {count} numbers; it was omitted")
    return Table(
        name=name, columns=columns, numbers=used, word=word, omissions=[*layout.remarks, *omissions]
    )


def _parse_column(
    parts: Sequence[str],
    format_: NumberFormat,
    *,
    units: CellUnits,
    numbers: Sequence[int],
    word: str,
    omissions: list[str],
    odd: dict[int, list[str]],
) -> NDArray[Any]:
    """Return a column of numbers, or of texts if half of the first are.

    `units`: receives the units of its cells. `odd`: receives fields that are no numbers, by row.
    """
    column = units.column
    is_text = column == find_recording_column([column])
    found: list[NDArray[Any]] = []
    strange: dict[int, str] = {}
    start = 0
    for part in parts:
        fields = part.split(_JOIN)
        if not is_text:
            parsed = format_.parse(fields)
            others = {
                start + i: fields[i]
                for i in np.flatnonzero(np.isnan(parsed)).tolist()
                if not is_missing(fields[i])
            }
            with_unit = units.split(others, parse=format_.parse)
            for row, number in with_unit.items():
                parsed[row - start] = number
            parsed[parsed >= OPEN_NUMBER] = np.inf
            others = {row: text for row, text in others.items() if row not in with_unit}
            is_text = not found and 2 * len(others) >= len(fields)
            if not is_text:
                strange |= others
                found.append(parsed)
        if is_text:
            found.append(np.array(fields, dtype=object))
        start += len(fields)
    for row, text in strange.items():
        odd.setdefault(row, []).append(text.strip())
    if strange:
        omissions.append(
            f"{column}: {len(strange)} fields are not numbers and count as missing (first at "
            f"{word} {numbers[next(iter(strange))]})"
        )
    return np.concatenate(found)
