"""Common style of all plots, with colour-blind safe colours."""

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

#: Okabe and Ito, "Color universal design" (2008), without yellow, which has low contrast on white.
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
PURPLE, SKY, AMBER = "#CC79A7", "#56B4E9", "#E69F00"
INK, GREY = "#222222", "#8A8A8A"

#: Colour and marker of each method, the same in every figure.
METHOD_STYLES: dict[str, tuple[str, str]] = {
    "relaxation": (BLUE, "o"),
    "calibrated": (GREEN, "D"),
    "exponential": (ORANGE, "s"),
    "log_law": (PURPLE, "^"),
    "recorded": (GREY, "v"),
}
SPARE_STYLES = ((SKY, "P"), (AMBER, "X"), (INK, "*"))

PLOT_ENDINGS = (".png", ".svg", ".pdf")
#: Dots per inch of PNG files, for print.
DPI = 300
#: Text width of a journal page; a wider figure would be scaled down with its text.
PAGE_WIDTH_IN = 7.2
#: Labelled digits between powers of ten, on a long axis and on an axis below one decade.
_LABELLED_DIGITS, _LABELLED_WITHIN_A_DECADE = "125", "1234568"
#: Ratio of the limits of an axis above which only powers of ten are labelled.
_CROWDED = 3e3

#: Width of a legend entry with its handle, inches.
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
    # Minor ticks are shorter; the padding aligns their labels with the major labels.
    "xtick.minor.pad": 5.0,
    "ytick.minor.pad": 5.0,
    "lines.linewidth": 1.4,
    "lines.markersize": 5,
    "svg.hashsalt": "palpate",
    # Keep text searchable and editable. Journals require Type 42 fonts.
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "axes.unicode_minus": True,
}


def method_style(method: str) -> tuple[str, str]:
    """Return the colour and marker of a method; an unknown method gets a spare style.

    Examples
    --------
    >>> method_style("relaxation")
    ('#0072B2', 'o')
    """
    spare = SPARE_STYLES[sum(method.encode()) % len(SPARE_STYLES)]
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

    The width is limited to the page width. With `shared`, all axes have the same scale, and only
    the outer axes have tick labels.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    require_plots()
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        # pyplot would keep every figure in memory and require a display.
        figure = Figure(figsize=(min(width_in, PAGE_WIDTH_IN), height_in), layout="constrained")
        yield figure, figure.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared)


def legend_below(figure: Figure, axes: Any, *, entry_in: float = _ENTRY_IN) -> None:
    """Add one legend for all axes below the figure, with as many columns as fit."""
    entries: dict[str, Any] = {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    most = min(len(entries), max(1, int(figure.get_figwidth() / entry_in)))
    for columns in range(most, 0, -1):
        # matplotlib fills a legend column by column.
        labels = [label for first in range(columns) for label in [*entries][first::columns]]
        handles = [entries[label] for label in labels]
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def log_axis(axis: Axis) -> None:
    """Make an axis logarithmic, with plain numbers as labels.

    The labels are at 1, 2 and 5 of each decade, and at more digits of an axis below one decade.
    """

    def format_minor(value: float, _: object) -> str:
        low, high = axis.get_view_interval()
        digits = _LABELLED_WITHIN_A_DECADE if high < 10.0 * low else _LABELLED_DIGITS
        crowded = high > _CROWDED * low
        return "" if crowded or f"{value:e}"[0] not in digits else plain_number(value)

    scale = axis.axes.set_xscale if axis is axis.axes.xaxis else axis.axes.set_yscale
    scale("log")
    axis.set_major_formatter(lambda value, _: plain_number(value))
    axis.set_minor_formatter(format_minor)


def plain_number(value: float) -> str:
    """Return a number as label text, with a minus sign instead of a hyphen.

    Examples
    --------
    >>> plain_number(-0.25), plain_number(1000.0)
    ('\N{MINUS SIGN}0.25', '1000')
    """
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def require_plots() -> None:
    """Check before any long calculation that plots can be drawn.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    with require_extra("a plot", extra="plots"):
        import matplotlib as mpl
    del mpl


def check_plot(path: Path | None) -> None:
    """Check before any calculation that a plot can be drawn and written.

    Raises
    ------
    InputError
        If the suffix is not one of `PLOT_ENDINGS`, or the folder does not exist.
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
    """Write a figure atomically; the suffix determines the format.

    `dpi`: resolution of a PNG file; `DPI` by default.
    """
    import matplotlib as mpl

    _check_plot_path(path)
    # Without dates, equal plots give identical files.
    without_date = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with atomic_path(path) as partial, mpl.rc_context(_STYLE):
        figure.savefig(partial, dpi=dpi or DPI, metadata=without_date.get(path.suffix.lower()))
