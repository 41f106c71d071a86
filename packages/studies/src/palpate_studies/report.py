"""Reports of studies: command-line commands, tables, figures and JSON."""

from __future__ import annotations

import inspect
import json
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_origin, get_type_hints

import typer

from palpate.cli.options import JsonOption
from palpate.errors import InputError
from palpate.files import atomic_path
from palpate.plots.style import PLOT_ENDINGS, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Names in JSON documents -> names on the results page, in tables and texts.
_PUBLIC_NAMES = {"ours": "palpate", "rival": "baseline", "taught on": "trained on"}


def use_public_names(text: str) -> str:
    """Replace the names of JSON documents.

    >>> use_public_names("ours less the rival, hours")
    'palpate less the baseline, hours'
    """
    names = rf"\b({'|'.join(_PUBLIC_NAMES)})\b"
    return re.sub(names, lambda match: _PUBLIC_NAMES[match[0]], text)


def _check_folder(out: Path | None) -> Path | None:
    """Refuse an unwritable folder before the long computation of a study."""
    if out is not None:
        places = (out, *out.absolute().parents)
        existing = next(place for place in places if place.exists())
        if not existing.is_dir():
            raise InputError(f"--out {out}: {existing} is not a folder; give a folder")
        if not os.access(existing, os.W_OK):
            raise InputError(
                f"--out {out}: no permission to write to {existing}; choose another folder"
            )
    return out


OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Folder for the report: JSON, tables and figures.",
        metavar="DIR",
        callback=_check_folder,
    ),
]
#: Option of the studies with a second generator.
SecondOption: TypeAlias = Annotated[
    bool,
    typer.Option("--second", help="Use the second generator, for which no estimator was designed."),
]
#: Formats of figure files and resolution of PNG files, from the options of `palpate study`.
FIGURE_FILES: ContextVar[tuple[tuple[str, ...], int | None]] = ContextVar(
    "FIGURE_FILES", default=(PLOT_ENDINGS, None)
)
#: Key of stored JSON documents -> column head, for keys that are not the field's terms.
_HEADS = {
    "called": "alarms",
    "called_before": "alarms before event",
    "could_bear": "could withstand target",
    "falsely_unknown": "known called unknown",
    "felt": "holds with contact",
    "felt_before": "contact before event",
    "left_over": "not sorted",
    "limited_could_bear": "limited, could withstand target",
    "no_upper_end": "no upper limit",
    "right": "correct",
    "seen": "detected",
    "share_of_settled": "RMS relative to settled",
    "share_ok": "fraction ok",
    "stiffness_bounds_right": "stiffness bounds correct",
    "strangers": "unknown items",
    "strangers_found": "unknown detected",
    "way": "method",
    "within_10_percent": "within 10 %",
    "within_10_percent_of_all": "within 10 %, all objects",
    "worst_mm": "largest error, mm",
}
#: Unit in a key -> unit in a column head.
_UNITS = {
    "n_per_mm": "N/mm",
    "mm_per_s": "mm/s",
    "percent": "%",
    "kpa": "kPa",
    "ohm": "ohm",
    "mm": "mm",
    "n": "N",
    "s": "s",
}
#: Column head -> format string, or function of a row; see `Table.of`.
Columns: TypeAlias = Mapping[str, str | Callable[[Mapping[str, Any]], str]]


def as_command(report: Callable[..., StudyReport]) -> Callable[..., None]:
    """Return the command of a study, with the options of its report, --json and --out.

    Parameters without an `Annotated` option are not available on the command line.

    Examples
    --------
    >>> def report(*, few: Annotated[int, typer.Option()] = 1, seed: int = 0) -> StudyReport:
    ...     '''Do nothing.'''
    >>> list(inspect.signature(as_command(report)).parameters)
    ['few', 'as_json', 'out']
    """

    def command(*, as_json: bool = False, out: Path | None = None, **options: Any) -> None:
        report(**options).emit(as_json=as_json, out=out)

    kind = inspect.Parameter.KEYWORD_ONLY
    hints = get_type_hints(report, include_extras=True)
    shown = [
        one.replace(annotation=hints[name], kind=kind)
        for name, one in inspect.signature(report).parameters.items()
        if get_origin(hints[name]) is Annotated
    ]
    shown += [
        inspect.Parameter("as_json", kind, default=False, annotation=JsonOption),
        inspect.Parameter("out", kind, default=None, annotation=OutOption),
    ]
    vars(command)["__signature__"] = inspect.Signature(shown)
    command.__doc__ = report.__doc__
    return command


def _column_head(key: str) -> str:
    """Return the column head of a key, with its unit at the end.

    >>> [_column_head(key) for key in ("way", "own_holds", "rms_n_loading", "true_n_per_mm", "n")]
    ['method', 'own holds', 'rms loading, N', 'true, N/mm', 'n']
    """
    if key in _HEADS:
        return _HEADS[key]
    found = re.search(rf"_({'|'.join(_UNITS)})(?=_|$)", key)
    if found is None:
        return key.replace("_", " ")
    name = key[: found.start()] + key[found.end() :]
    return f"{name.replace('_', ' ')}, {_UNITS[found[1]]}"


def _format_value(row: Mapping[str, Any], *, key: str) -> str:
    value = row[key]
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


class _UnknownError(Exception):
    """A value in a cell is None."""


class _Cells(Formatter):
    """Formatter with fractions as percent (`{ratio:.0p}`) that rejects None."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        found = super().get_field(field_name, args, kwargs)
        if found[0] is None:
            raise _UnknownError
        return found

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.endswith("p"):
            return f"{100 * value:{format_spec[:-1]}f}"
        return str(super().format_field(value, format_spec))


def _format_cell(form: str | Callable[[Mapping[str, Any]], str], row: Mapping[str, Any]) -> str:
    if not isinstance(form, str):
        return form(row)
    try:
        return _Cells().vformat(form, (), row)
    except _UnknownError:
        return "-"


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A titled table of formatted cells."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]

    @classmethod
    def of(
        cls,
        title: str,
        rows: Sequence[Mapping[str, Any]],
        columns: Columns | Sequence[str] | None = None,
    ) -> Table:
        """Return a table of a study's JSON rows; None is shown as a dash.

        Parameters
        ----------
        title : str
            Title above the table.
        rows : sequence of mapping
            One mapping per line.
        columns : mapping, sequence of str, optional
            Column head -> format of the cells; or keys of the rows, with three digits for numbers.
            By default every key of the first row with a scalar value.

        Examples
        --------
        >>> rows = [{"method": "a", "ratio": 0.51234, "size_mm": None}]
        >>> Table.of("T", rows).columns, Table.of("T", rows).rows
        (('method', 'ratio', 'size, mm'), [['a', '0.512', '-']])
        >>> Table.of("T", rows, {"method": "{method}", "%": "{ratio:.0p}"}).rows
        [['a', '51']]
        """
        if columns is None:
            columns = [key for key, value in rows[0].items() if not isinstance(value, list | dict)]
        if not isinstance(columns, Mapping):
            columns = {_column_head(key): partial(_format_value, key=key) for key in columns}
        cells = [[_format_cell(form, row) for form in columns.values()] for row in rows]
        return cls(title=title, columns=tuple(columns), rows=cells)

    @classmethod
    def wide(
        cls, title: str, rows: Sequence[Mapping[str, Any]], lead: Columns, *, over: str, form: str
    ) -> Table:
        """Return a table with one column per value of a key.

        Values of rows with the same lead and column are joined in one cell.

        Examples
        --------
        >>> rows = [{"by": by, "level": at, "mm": 1} for at in ("lab", "field") for by in "ab"]
        >>> table = Table.wide("T", rows, {"by": "{by}"}, over="level", form="{mm:.1f}")
        >>> table.columns, table.rows
        (('by', 'lab', 'field'), [['a', '1.0', '1.0'], ['b', '1.0', '1.0']])
        """
        found: dict[tuple[str, ...], dict[str, list[str]]] = {}
        for row in rows:
            cells = found.setdefault(tuple(_format_cell(one, row) for one in lead.values()), {})
            cells.setdefault(str(row[over]), []).append(_format_cell(form, row))
        heads = list(dict.fromkeys(str(row[over]) for row in rows))
        return cls(
            title=title,
            columns=(*lead, *heads),
            rows=[
                [*key, *(" / ".join(cells.get(head, ["-"])) for head in heads)]
                for key, cells in found.items()
            ],
        )

    def as_markdown(self) -> str:
        """Return the table and its title as Markdown."""
        lines = [f"**{self.title}**", "", "| " + " | ".join(self.columns) + " |"]
        lines.append("|" + "---|" * len(self.columns))
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join(lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyReport:
    """The outcome of one study.

    Attributes
    ----------
    name, title : str
        Name on the command line, and title.
    provenance : sequence of str
        Which data are real, simulated or published, and which published entries were calibration
        inputs.
    tables : sequence of Table
        Tables for display.
    payload : mapping
        The JSON document without the name of the study.
    figures : mapping of str to callable
        File stem -> function that draws the figure, called only with --out.
    files : mapping of str to callable
        File name -> function that writes an additional file, called only with --out.
    """

    name: str
    title: str
    provenance: Sequence[str]
    tables: Sequence[Table]
    payload: Mapping[str, Any]
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    files: Mapping[str, Callable[[Path], object]] = field(default_factory=dict)

    @property
    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return {"study": self.name, **self.payload}

    def emit(self, *, as_json: bool, out: Path | None) -> None:
        """Print the report as JSON or tables; optionally write it to a folder."""
        if out is not None:
            self.write(out)
        if as_json:
            json.dump(self.document, sys.stdout, allow_nan=False)
            sys.stdout.write("\n")
            return
        from rich.console import Console

        from palpate.terminal_table import print_table

        # A pipe reports 80 columns, which would truncate names in tables.
        console = Console(width=None if sys.stdout.isatty() else 120, emoji=False)
        console.print(f"[bold]{self.title}[/bold]")
        for line in self.provenance:
            console.print(f"[dim]{use_public_names(line)}[/dim]", highlight=False)
        for table in self.tables:
            console.print(f"\n[italic]{use_public_names(table.title)}[/italic]")
            rows = [[use_public_names(cell) for cell in row] for row in table.rows]
            print_table([use_public_names(head) for head in table.columns], rows, console=console)
        if out is not None:
            console.print(f"Written to {out}")

    def write(self, out: Path) -> None:
        """Write `<name>.json`, `<name>.md`, additional files and all figures to a folder."""
        out.mkdir(parents=True, exist_ok=True)
        with atomic_path(out / f"{self.name}.json") as path:
            path.write_text(json.dumps(self.document, allow_nan=False, indent=1) + "\n")
        body = [f"# {self.title}", *self.provenance, *(t.as_markdown() for t in self.tables)]
        with atomic_path(out / f"{self.name}.md") as path:
            path.write_text(use_public_names("\n\n".join(body)) + "\n")
        for name, write in self.files.items():
            write(out / name)
        endings, dpi = FIGURE_FILES.get()
        for stem, draw in self.figures.items():
            figure = draw()
            _letter_panels(figure)
            for ending in endings:
                save_figure(figure, out / f"{stem}{ending}", dpi=dpi if ending == ".png" else None)


def _letter_panels(figure: Figure) -> None:
    """Add a letter to each panel, row by row; a single panel gets none."""
    panels = [axis for axis in figure.axes if axis.get_visible()]
    if len(panels) < 2:
        return
    for number, axis in enumerate(panels):
        letter = "abcdefghijklmnopqrstuvwxyz"[number]
        axis.annotate(
            letter,
            (0.0, 1.0),
            xycoords="axes fraction",
            xytext=(-26, 5),
            textcoords="offset points",
            weight="bold",
            fontsize=10,
        )
