"""One style for every plot: colour-blind safe colours, units on every axis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import InputError, require_extra
from palpate.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Okabe and Ito, "Color universal design" (2008), without its yellow, which is faint on white.
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
PURPLE, SKY, AMBER = "#CC79A7", "#56B4E9", "#E69F00"
INK, GREY = "#222222", "#8A8A8A"

#: The same method has the same colour and marker in every figure.
METHOD_STYLES: dict[str, tuple[str, str]] = {
    "relaxation": (BLUE, "o"),
    "calibrated": (GREEN, "D"),
    "exponential": (ORANGE, "s"),
    "log_law": (PURPLE, "^"),
    "recorded": (GREY, "v"),
}
SPARE_LOOKS = ((SKY, "P"), (AMBER, "X"), (INK, "*"))

PLOT_ENDINGS = (".png", ".svg", ".pdf")
#: Dots per inch of PNG files: sharp in print.
DPI = 300
#: Width of the text of a journal's page: a wider figure would be shrunk, and its letters with it.
PAGE_WIDTH_IN = 7.2
#: Between two powers of ten these are labelled; all that have room where an axis has one decade.
_LABELLED_DIGITS, _LABELLED_WITHIN_A_DECADE = "125", "1234568"
#: Beyond this ratio of its ends an axis has room for powers of ten alone.
_CROWDED = 3e3

#: matplotlib's own label of the axes of a colour bar, which is no panel.
COLORBAR = "<colorbar>"
#: Width of a legend's entry, with its handle, at our size of letters.
_ENTRY_IN = 1.75

_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "figure.titlesize": 9,
    "axes.edgecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    # Ticks between powers of ten are shorter; their numbers stand in one line with the others.
    "xtick.minor.pad": 5.0,
    "ytick.minor.pad": 5.0,
    "lines.linewidth": 1.4,
    "lines.markersize": 5,
    "svg.hashsalt": "palpate",
    # Text stays text: it can be searched, and edited for print. Type 42 is what journals take.
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "axes.unicode_minus": True,
}


def look_of(method: str) -> tuple[str, str]:
    """Return the colour and marker of a method; others get one by their name.

    Examples
    --------
    >>> look_of("relaxation")
    ('#0072B2', 'o')
    """
    spare = SPARE_LOOKS[sum(method.encode()) % len(SPARE_LOOKS)]
    return METHOD_STYLES.get(method, spare)


@contextmanager
def new_figure(
    *,
    rows: int = 1,
    columns: int = 1,
    width_in: float = 7.0,
    height_in: float = 4.0,
    shared: bool = False,
) -> Iterator[tuple[Figure, Any]]:
    """Yield a figure in palpate's style and its axes, shape (rows, columns).

    A figure wider than a page is made as wide as that. `shared` axes have one scale, and numbers
    at the outer ones alone.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    require_plots()
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        # Not pyplot: it keeps every figure alive and looks for a display.
        figure = Figure(figsize=(min(width_in, PAGE_WIDTH_IN), height_in), layout="constrained")
        yield figure, figure.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared)


def legend_below(figure: Figure, axes: Any, *, entry_in: float = _ENTRY_IN) -> None:
    """Put one legend for all axes below the figure, in as many columns as fit."""
    entries: dict[str, Any] = {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    most = min(len(entries), max(1, int(figure.get_figwidth() / entry_in)))
    for columns in range(most, 0, -1):
        # A legend is filled column by column.
        labels = [label for first in range(columns) for label in [*entries][first::columns]]
        handles = [entries[label] for label in labels]
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def letter_panels(figure: Figure) -> None:
    """Letter the panels of a figure row by row; a single panel stays plain."""
    panels = [axis for axis in figure.axes if axis.get_visible() and axis.get_label() != COLORBAR]
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


def log_axis(axis: Axis) -> None:
    """Make an axis logarithmic, with plain numbers at 1, 2 and 5 of a decade."""

    def between_decades(value: float, _: object) -> str:
        low, high = axis.get_view_interval()
        digits = _LABELLED_WITHIN_A_DECADE if high < 10.0 * low else _LABELLED_DIGITS
        crowded = high > _CROWDED * low
        return "" if crowded or f"{value:e}"[0] not in digits else plain_number(value)

    scale = axis.axes.set_xscale if axis is axis.axes.xaxis else axis.axes.set_yscale
    scale("log")
    axis.set_major_formatter(lambda value, _: plain_number(value))
    axis.set_minor_formatter(between_decades)


def plain_number(value: float) -> str:
    """Return a number as labels have it, with a minus that is no hyphen.

    Examples
    --------
    >>> plain_number(-0.25), plain_number(1000.0)
    ('\N{MINUS SIGN}0.25', '1000')
    """
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def require_plots() -> None:
    """Refuse early, before any long work, where plots can't be drawn.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    with require_extra("a plot", extra="plots"):
        import matplotlib as mpl
    del mpl


def check_plot(path: Path | None) -> None:
    """Refuse, before any work, a plot that can't be drawn or written.

    Raises
    ------
    InputError
        If the ending is not one of `PLOT_ENDINGS`, or the folder does not exist.
    MissingExtraError
        If matplotlib is not installed.

    Examples
    --------
    >>> check_plot(Path("plot.bmp"))
    Traceback (most recent call last):
    palpate.errors.InputError: plot.bmp: a plot ends in .png, .svg or .pdf
    """
    if path is not None:
        _check_plot_path(path)
        require_plots()


def _check_plot_path(path: Path) -> None:
    if path.suffix.lower() not in PLOT_ENDINGS:
        raise InputError(f"{path}: a plot ends in .png, .svg or .pdf")
    if not path.parent.is_dir():
        raise InputError(f"{path}: no folder {path.parent}; create it first")


def save_figure(figure: Figure, path: Path, *, dpi: int | None = None) -> None:
    """Write a figure whole or not at all; the ending chooses the format.

    `dpi` is of a PNG file, `DPI` by default.
    """
    import matplotlib as mpl

    _check_plot_path(path)
    # Without dates the same plot is the same file.
    dated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with atomic_path(path) as partial, mpl.rc_context(_STYLE):
        figure.savefig(partial, dpi=dpi or DPI, metadata=dated.get(path.suffix.lower()))
