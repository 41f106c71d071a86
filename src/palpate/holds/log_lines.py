"""Lines of terminals and sketches, rewritten as rows of fields.

A terminal puts the time in front of each line (``12:34:50.120 -> 620``, ``[12:34:50.120] 620``). A
sketch labels its numbers (``A0:146``, ``Voltage = 3.03 V``) or prints JSON. The first lines of a
file decide; all lines are then rewritten in the same way, each as one line, so that line numbers
remain.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from palpate.holds.decimals import MISSING, OPEN
from palpate.holds.moments import MOMENT, join_spaced, mask_dates
from palpate.holds.units import TIME_UNITS, find_unit

#: Name of the column with the terminal's times.
STAMP = "terminal time"
#: Smallest fraction of lines that a form must explain.
_MOST = 0.8
_FEWEST = 3
_STAMP = re.compile(
    r"\s*(?:[EWIDV] \((?P<ticks>\d+)\)(?=\s)"
    rf"|[\[(<] *(?P<inside>{MOMENT}|\d+\.\d+) *[\])>] ?(?:-+>|→|=>|>>?|[:|-](?=\s))?"
    rf"|(?P<bare>{MOMENT}) ?(?:-+>|→|=>|>>?|[:-](?=\s)))"
    r"[ ]?(?P<body>.*)",
    re.IGNORECASE,
)
_WORDS = "|".join(re.escape(word) for word in sorted(MISSING | OPEN, key=len, reverse=True) if word)
_LABELLED = re.compile(
    r"(?<!\w)(?P<label>[^\W\d_][^,;|\t:=\"{}]{0,60}?)\s*[:=]\s*"
    rf"(?P<value>[-+\u2212]?(?:\d[\d.,]*\d|\d|[.,]\d+)(?:e[+-]?\d+)?(?![\d:])|{MOMENT}|(?:{_WORDS}))"
    r"(?:[ ]?(?P<unit>[^\s,;|:=\d]{1,6}))?(?=$|[\s,;|])(?!\s*[:=])",
    re.IGNORECASE,
)
_IN_BRACKETS = re.compile(r"\([^()\[\]]+\)|\[[^()\[\]]+\]")
_OWN_CLOCK = re.compile(r"\s*(?P<value>[-+]?\d+(?:[.,]\d+)?)[\s,;|:]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class LineForm:
    """How the lines of a file become rows."""

    #: Whether a terminal's time is in front of each line.
    stamped: bool = False
    #: Names of the labelled numbers, and whether a number without a label precedes them.
    labels: tuple[str, ...] = ()
    own_clock: bool = False
    #: Whether the lines are JSON objects.
    is_json: bool = False
    #: Whether each line is in brackets, as Python prints a list.
    in_brackets: bool = False
    #: Number of rewritten lines with each label that has no column.
    left_out: Counter[str] = field(default_factory=Counter, compare=False)

    @property
    def names(self) -> list[str] | None:
        """Names of the columns, or None if the file decides."""
        if not self.labels:
            return None
        return [STAMP] * self.stamped + ["1"] * self.own_clock + [*self.labels]

    def split(self, line: str) -> tuple[str, str] | None:
        """Return the terminal's time and the rest of a line, or None without a time."""
        found = _STAMP.fullmatch(line.strip("\r\n"))
        if found is None:
            return None
        # ESP-IDF writes a letter and milliseconds.
        stamp = (found["ticks"] or found["inside"] or found["bare"]).strip()
        stamp = re.sub(r"(?<=\d),(?=\d{1,9}$)", ".", stamp)
        if " " in stamp:
            stamp = join_spaced(stamp).replace(" ", "")
        return stamp, found["body"].rstrip()

    def rewrite(self, line: str, *, separator: str | None) -> str:
        """Return a line as fields with the separator (None: a space) between them."""
        mark = separator or " "
        head, body = "", line
        if self.stamped:
            parts = self.split(line)
            if parts is None:
                return line
            head, body = parts[0] + mark, parts[1] + "\n"
        if self.in_brackets:
            body = body.strip().strip("()[]") + "\n"
        if not self.labels:
            return head + body
        row = self._json_row(body) if self.is_json else self._row_of_labels(body)
        if row is None:
            # A line without numbers, such as one of hyphens, holds no reading.
            return line if any(map(str.isdigit, body)) else "\n"
        return head + mark.join(row) + "\n"

    def _json_row(self, body: str) -> list[str] | None:
        found = _read_json(body)
        if found is None:
            return None
        self.left_out.update(found.keys() - {*self.labels})
        return [found.get(label, "") for label in self.labels]

    def _row_of_labels(self, body: str) -> list[str] | None:
        found = dict(_named_value(pair, {*self.labels}) for pair in _find_pairs(body))
        self.left_out.update(found.keys() - {*self.labels})
        if not found.keys() & {*self.labels}:
            return None
        own = _OWN_CLOCK.match(body)
        first = [own["value"] if own else ""] if self.own_clock else []
        return [*first, *(found.get(label, "") for label in self.labels)]


#: Lines without times and labels.
PLAIN = LineForm()


def find_line_form(lines: Sequence[str]) -> LineForm:
    """Return the form of the first lines of a file.

    >>> form = find_line_form(["12:00:01.5 -> A0:7 A1:8\\n"] * 3)
    >>> form.names, form.rewrite("12:00:01.5 -> A0:7 A1:8\\n", separator="\\t")
    (['terminal time', 'A0', 'A1'], '12:00:01.5\\t7\\t8\\n')
    """
    form = PLAIN
    filled = [line for line in lines if line.strip()]
    stamps = [form.split(line) for line in filled]
    stamped = _is_most(sum(part is not None for part in stamps), len(filled))
    bodies = [part[1] for part in stamps if part] if stamped else filled
    found = [_read_json(body) for body in bodies]
    rows = [row for row in found if row]
    if _is_most(len(rows), len(bodies)):
        keys = tuple(dict.fromkeys(key for row in rows for key in row))
        return LineForm(stamped=stamped, labels=keys, is_json=True)
    pairs = [_find_pairs(body) for body in bodies]
    labelled = [index for index, one in enumerate(pairs) if one]
    if not _is_most(len(labelled), len(bodies)):
        wrapped = sum(_IN_BRACKETS.fullmatch(body.strip()) is not None for body in bodies)
        return LineForm(stamped=stamped, in_brackets=_is_most(wrapped, len(bodies)))
    counts = Counter(_name(pair) for index in labelled for pair in pairs[index])
    names = tuple(name for name, count in counts.items() if is_repeated(count, len(labelled)))
    # A meter that changes its range writes several units behind one label.
    plain = Counter(_label(name) for name in names)
    names = tuple(dict.fromkeys(_label(n) if plain[_label(n)] > 1 else n for n in names))
    own = [_OWN_CLOCK.match(bodies[index]) is not None for index in labelled]
    return LineForm(stamped=stamped, labels=names, own_clock=sum(own) > _MOST * len(own))


def is_repeated(count: int, lines: int) -> bool:
    """Return whether a label belongs to readings; a note such as "baud: 9600" is not repeated."""
    return count > 0.02 * lines + 1


def _find_pairs(body: str) -> list[re.Match[str]]:
    """Return the labelled numbers of a line; the hour of a date is not one."""
    return [*_LABELLED.finditer(mask_dates(body))]


def _is_most(count: int, total: int) -> bool:
    return count >= _FEWEST and count >= _MOST * total


def _label(name: str) -> str:
    """Return the name of a labelled number without its unit."""
    return name.partition(" [")[0]


def _named_value(pair: re.Match[str], names: set[str]) -> tuple[str, str]:
    """Return the name and value of a labelled number, with the unit in either of them."""
    name, value = _name(pair), str(pair["value"])
    if name not in names and _label(name) in names:
        return _label(name), f"{value} {pair['unit']}"
    return name, value


def _name(pair: re.Match[str]) -> str:
    label = " ".join(pair["label"].split()).strip("-*#> ")
    unit = pair["unit"]
    known = unit and (find_unit(unit) is not None or unit.lower() in TIME_UNITS)
    return f"{label} [{unit}]" if known else label


def _read_json(body: str) -> dict[str, str] | None:
    """Return the numbers and texts of a JSON object by key, or None."""
    if not body.lstrip().startswith("{"):
        return None
    try:
        found = json.loads(body)
    except (ValueError, RecursionError):
        return None
    return dict(_flatten(found, ""))


def _flatten(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield the key and text of each number and text in a JSON value."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flatten(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _flatten(inner, f"{name}.{place}" if name else str(place))
    elif isinstance(value, str) and (inner := _read_json(value)) is not None:
        # A message may contain another as text.
        yield from ((f"{name}.{key}", text) for key, text in inner.items())
    else:
        text = "" if value is None else str(value)
        yield name, " ".join(text.split())
