"""Error and coverage against the cut-off, one line for each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate.plots.style import INK, legend_below, look_of, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def errors_by_cutoff(summary: Sequence[Mapping[str, Any]], *, title: str, level: float) -> Figure:
    """Draw median error with its bootstrap interval, its share of the rest, and coverage.

    Parameters
    ----------
    summary : sequence of mapping
        One entry for each method and cut-off, with the names of `palpate settle --json` and
        `median_abs_error_percent_interval`.
    title : str
        Stands above the figure.
    level : float
        Probability that the intervals were to cover.
    """
    panels = (
        ("median_abs_error_percent", "median |error| (% of settled value)"),
        ("median_error_of_remaining_percent", "median |error| (% of change to come)"),
        ("coverage", f"share inside the {100 * level:.0f} % interval"),
    )
    with new_figure(columns=3, width_in=11, height_in=3.6) as (figure, axes):
        for axis, (figure_name, label) in zip(axes[0], panels, strict=True):
            for method in dict.fromkeys(entry["method"] for entry in summary):
                _draw_line(axis, [e for e in summary if e["method"] == method], figure_name)
            axis.set_xscale("log")
            cutoffs_s = sorted({entry["cutoff_s"] for entry in summary})
            axis.set_xticks(cutoffs_s, _apart(cutoffs_s))
            axis.minorticks_off()
            axis.set_xlabel("cut-off (s)")
            axis.set_ylabel(label)
            axis.set_ylim(bottom=0)
        axes[0][2].axhline(level, color=INK, ls="--", lw=1)
        axes[0][2].set_ylim(0, 1.03)
        legend_below(figure, axes)
        figure.suptitle(title)
    return figure


def _apart(cutoffs_s: Sequence[float]) -> list[str]:
    """Return the labels of a logarithmic axis; none where it would lie over the one before."""
    labels, last_s = [], 0.0
    for cutoff_s in cutoffs_s:
        written = cutoff_s >= 1.4 * last_s
        labels.append(f"{cutoff_s:g}" if written else "")
        last_s = cutoff_s if written else last_s
    return labels


def _draw_line(axis: Any, entries: Sequence[Mapping[str, Any]], name: str) -> None:
    shown = [entry for entry in entries if entry[name] is not None]
    if not shown:
        return
    colour, marker = look_of(entries[0]["method"])
    cutoffs_s = [entry["cutoff_s"] for entry in shown]
    # Calibration often changes the interval and not the value: its line must not hide the other.
    hollow = {"ls": "--", "mfc": "none", "ms": 9} if shown[0]["method"] == "calibrated" else {}
    figures = [entry[name] for entry in shown]
    axis.plot(cutoffs_s, figures, color=colour, marker=marker, label=shown[0]["method"], **hollow)
    spans = [entry.get(f"{name}_interval") for entry in shown]
    if all(span is not None and None not in span for span in spans):
        lows, highs = zip(*((span[0], span[1]) for span in spans if span), strict=True)
        axis.fill_between(cutoffs_s, lows, highs, color=colour, alpha=0.12, lw=0)
