"""The page of a benchmark run: one HTML file with ratios, growth and every figure behind them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from palpate.files import atomic_path
from palpate.plots.inline_svg import inline_svg, page_figure
from palpate.plots.report_page import PageTable, Part, render_page
from palpate.plots.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, log_axis
from palpate_studies.benchmarks.protocol import Measured, Ratio
from palpate_studies.benchmarks.report import COLUMNS, machine, row, sized, times
from palpate_studies.catalogue import BENCHMARKS

#: At least this many sizes make a curve of growth.
_CURVE = 3
#: Columns of numbers, which the page sets to the right.
_NUMBERS = ("palpate", "peer's", "times as good")


def write_page(path: Path, measured: Mapping[str, Measured], *, full: bool) -> None:
    """Write the page; it needs no other file and no network."""
    ratios = [ratio for one in measured.values() for ratio in one.ratios]
    body: list[Part] = [_tiles(ratios), [*_figures(measured)]]
    columns = [f">{name}" if name in _NUMBERS else name for name in COLUMNS]
    for name, one in measured.items():
        body.append(PageTable(f"{name}: {BENCHMARKS[name][1]}", columns, [*map(row, one.ratios)]))
        body += one.notes
    text = render_page(
        title="palpate next to its peers",
        chips=[machine(), "full sizes" if full else "quick sizes"],
        simulated=False,
        body=body,
        foot="Processor time of one process, palpate and its peer taking turns in the same run. "
        "More than 1 is better than the peer. Written by: palpate bench --page FILE",
    )
    with atomic_path(path) as whole:
        whole.write_text(text, encoding="utf-8")


def _tiles(ratios: Sequence[Ratio]) -> dict[str, tuple[str, str, str]]:
    """Return the figures that have a wanted value."""
    return {
        f"{ratio.what}, {sized(ratio)}": (
            times(ratio.times),
            "x",
            f"{ratio.peer}; {times(ratio.wanted)} wanted{', missed' * ratio.missed}",
        )
        for ratio in ratios
        if ratio.wanted is not None and ratio.times is not None
    }


def _figures(measured: Mapping[str, Measured]) -> Iterator[tuple[str, str]]:
    for name, one in measured.items():
        known = [ratio for ratio in one.ratios if ratio.times is not None]
        yield f"{name}: times as good as the peer", _dots(name, known)
        for what in dict.fromkeys(ratio.what for ratio in known):
            series = [ratio for ratio in known if ratio.what == what]
            if len({ratio.size for ratio in series}) >= _CURVE:
                yield f"{what}: growth", _growth(what, series)


def _dots(name: str, ratios: Sequence[Ratio]) -> str:
    """Draw each ratio, and what is wanted of it, on one logarithmic axis."""
    with page_figure(height_in=0.9 + 0.19 * len(ratios)) as (figure, (axis,)):
        axis.axvline(1.0, color=GREY, lw=1.0)
        for place, ratio in enumerate(ratios):
            axis.plot(ratio.times, place, "o", color=ORANGE if ratio.missed else BLUE)
            if ratio.wanted is not None:
                axis.plot(ratio.wanted, place, "|", color=INK, ms=9)
        labels = [f"{ratio.what}, {ratio.size:,}; {ratio.peer}" for ratio in ratios]
        axis.set_yticks(range(len(ratios)), labels, fontsize=7)
        log_axis(axis.xaxis)
        axis.set(ylim=(len(ratios) - 0.5, -0.5), xlabel="times (| wanted)")
        return inline_svg(figure, label=f"{name}: ratio of palpate to each peer")


def _growth(what: str, series: Sequence[Ratio]) -> str:
    """Draw what the work takes over its size, with every peer's."""
    with page_figure() as (figure, (axis,)):
        ours = {ratio.size: ratio.ours for ratio in series}
        axis.plot(list(ours), list(ours.values()), "o-", color=BLUE, label="palpate")
        peers = dict.fromkeys(ratio.peer for ratio in series)
        for peer, color in zip(peers, (ORANGE, GREEN, PURPLE, INK), strict=False):
            some = [ratio for ratio in series if ratio.peer == peer]
            axis.plot(
                [ratio.size for ratio in some],
                [ratio.theirs for ratio in some],
                "s--",
                color=color,
                label=peer,
            )
        unit = "processor time (s)" if series[0].unit == "s" else "memory (MB)"
        axis.set(xscale="log", yscale="log", xlabel=series[0].of, ylabel=unit)
        axis.legend()
        return inline_svg(figure, label=f"{what}: growth with the number of {series[0].of}")
