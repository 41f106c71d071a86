"""The files that are written of each figure of a study, as the command line asks for them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.plots.style import PLOT_ENDINGS, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureFiles:
    """The files that are written of each figure of a study."""

    #: Of `PLOT_ENDINGS`.
    endings: tuple[str, ...] = PLOT_ENDINGS
    #: Dots per inch of the PNG file; None: `DPI`.
    dpi: int | None = None


EVERY_FORMAT = FigureFiles()
#: What the command line asked for. The options are the verb's, so that no study has to have them.
FIGURE_FILES: ContextVar[FigureFiles] = ContextVar("FIGURE_FILES", default=EVERY_FORMAT)


@contextmanager
def figure_files(files: FigureFiles) -> Iterator[None]:
    """Have `save_figures` write these files."""
    before = FIGURE_FILES.set(files)
    try:
        yield
    finally:
        FIGURE_FILES.reset(before)


def save_figures(figure: Figure, stem: Path) -> None:
    """Write a figure of a study in every format that was asked for, all by default."""
    files = FIGURE_FILES.get()
    for ending in files.endings:
        dpi = files.dpi if ending == ".png" else None
        save_figure(figure, stem.with_name(stem.name + ending), dpi=dpi)
