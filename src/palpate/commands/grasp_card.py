"""The result card of a grasp: what was measured, how sure, and on the twin how right."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from palpate.commands.grasp_limit import limit_text
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult, Outcome
from palpate.rig import Rig
from palpate.settling.result import Status

_BAR = 20
#: Narrower terminals have no room for the bars next to the numbers.
_WIDE = 80
#: Name of the measurement, label with its unit, digits after the point.
_ROWS = (
    ("size_mm", "Size, mm", 1),
    ("force_n", "Grip force, N", 2),
    ("firmness", "Firmness, 0 to 100", 0),
    ("stiffness_n_per_mm", "Stiffness, N/mm", 2),
    ("settled_percent", "Settled, %", 1),
)
_NOTES = {
    Status.OK: "",
    Status.UNPROVEN: "unproven shape",
    Status.TOO_SHORT: "short hold",
    Status.NOT_SETTLING: "not settling",
    Status.SATURATED: "outside range",
    Status.FELL_BACK: "fell back",
}


def print_card(
    result: GraspResult,
    *,
    summary: Mapping[str, object],
    rig: Rig,
    seed: int,
    truth: Mapping[str, object] | None,
    limited: Mapping[str, object] | None = None,
) -> None:
    """Print the card on standard output; `limited` is what a learned damage limit did."""
    damaged = truth is not None and bool(truth["damaged"])
    good = result.outcome is Outcome.HELD and not damaged
    headline = Text(str(summary["text"]).capitalize(), style="bold green" if good else "bold red")
    if summary["firmness"]:
        headline.append(f"  ·  {summary['firmness']}", style="bold")
    if summary["on_target"] is not None:
        met = "target within the interval" if summary["on_target"] else "off target"
        headline.append(f"  ·  {met} ({summary['target_force_n']:g} N)", style="bold")
    console = Console(highlight=False)
    passed = Text("The object was damaged: its force passed the yield.", style="bold red")
    parts: list[RenderableType] = [
        headline,
        *([passed] if damaged else []),
        Text(""),
        _measurements(result, truth, bars=console.width >= _WIDE),
        Text(""),
        _timings(result),
    ]
    if limited is not None:
        parts.append(Text(limit_text(limited)))
    notes = {_note(m): None for name, _, _ in _ROWS if (m := getattr(result, name))}
    parts += [Text(f"* {note}", style="yellow") for note in notes if note]
    parts += [Text(f"! {fault}", style="yellow") for fault in result.faults]
    title = f"[bold]{rig.subject or 'unknown object'}[/] on {rig.name}"
    subtitle = f"SIMULATED on the twin, seed {seed}" if rig.simulated else "measured"
    console.print(
        Panel(
            Group(*parts),
            title=title,
            subtitle=f"[bold yellow]{subtitle}[/]" if rig.simulated else subtitle,
            border_style="green" if good else "red",
            padding=(1, 2),
            expand=False,
        )
    )


def _measurements(result: GraspResult, truth: Mapping[str, object] | None, *, bars: bool) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), show_edge=False, header_style="dim")
    table.add_column("", no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("90 % interval", justify="center", no_wrap=True)
    if truth is not None:
        if bars:
            table.add_column("", no_wrap=True)
        table.add_column("[green]▼[/] true", justify="right", no_wrap=True)
    for name, label, digits in _ROWS:
        measured: Measurement | None = getattr(result, name)
        if measured is None:
            table.add_row(label, "-")
            continue
        note = _note(measured)
        cells = [
            f"{label} [yellow]*[/]" if note else label,
            f"[bold]{measured.value:.{digits}f}[/]" if measured.number else "-",
            f"{measured.low:.{digits}f} … {measured.high:.{digits}f}"
            if measured.number
            else measured.text(digits=digits),
        ]
        if truth is not None:
            true = truth.get(name)
            known = float(true) if isinstance(true, int | float) else None
            cells += [_bar(measured, known) if measured.number else ""] * bars
            cells += ["-" if known is None else f"{known:.{digits}f}"]
        table.add_row(*cells)
    return table


def _note(measured: Measurement) -> str:
    return measured.reason or _NOTES.get(measured.status, str(measured.status))


def _bar(measured: Measurement, true: float | None) -> str:
    """Draw interval, estimate and truth on one line: `├──●──┤` and `▼` for the truth."""
    marks = [measured.low, measured.middle, measured.high, *([] if true is None else [true])]
    low, high = min(marks), max(marks)
    margin = 0.08 * (high - low) or 1.0
    low, span = low - margin, high - low + 2 * margin

    def column(value: float) -> int:
        return min(_BAR - 1, int(_BAR * (value - low) / span))

    cells = [" "] * _BAR
    left, right = column(measured.low), column(measured.high)
    cells[left : right + 1] = "─" * (right + 1 - left)
    cells[left], cells[right] = "├", "┤"
    cells[column(measured.middle)] = "●"
    if true is not None:
        inside = measured.low <= true <= measured.high
        cells[column(true)] = f"[{'green' if inside else 'red'}]▼[/]"
    return "".join(cells)


def _timings(result: GraspResult) -> Text:
    parts = []
    if result.decision_time_s is not None:
        parts.append(f"answer {result.decision_time_s:.1f} s after first contact")
    if result.peak_force_n is not None:
        parts.append(f"peak force read {result.peak_force_n:.1f} N")
    parts.append(f"{result.frames} frames, {result.frames_lost} lost")
    return Text("  ·  ".join(parts), style="dim")
