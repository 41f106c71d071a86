"""The result card of a grasp: values, intervals and, on the twin, true values."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table
from rich.text import Text

from palpate.cli.output import print_card as print_frame
from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import verdict
from palpate.measurement import Measurement, Status
from palpate.object.firmness import is_determined
from palpate.terminal_table import make_console, make_table

#: Name of the measurement, label with unit, decimal places.
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
    Status.FELL_BACK: "fallback value",
}


def print_card(document: GraspDocument, *, title: str, seed: int | None) -> None:
    """Print the card on standard output; `seed`: that of a simulated rig."""
    result, truth = document.result, document.truth
    summary = verdict(result, target_force_n=document.target_force_n)
    damaged = truth is not None and bool(truth.get("damaged"))
    good = result.outcome is Outcome.HELD and not damaged
    headline = Text(str(summary["text"]).capitalize(), style="bold green" if good else "bold red")
    if summary["firmness"]:
        headline.append(f"  ·  {summary['firmness']}", style="bold")
    if summary["on_target"] is not None:
        target = "target within the interval" if summary["on_target"] else "off target"
        headline.append(f"  ·  {target} ({summary['target_force_n']:g} N)", style="bold")
    console = make_console()
    parts: list[Text | Table | None] = [headline]
    if damaged:
        damage = "The object was damaged: the force exceeded its yield force."
        parts.append(Text(damage, style="bold red"))
    parts += [None, _measurements(result, truth), None]
    parts.append(_timings(result))
    if document.limit is not None:
        parts.append(Text(_limit_text(document.limit.to_dict(result, low_n=document.damage_low_n))))
    notes = {_note_text(m): None for name, _, _ in _ROWS if (m := getattr(result, name))}
    parts += [Text(f"* {note}", style="yellow") for note in notes if note]
    parts += [Text(f"! {fault}", style="yellow") for fault in result.faults]
    if (pull := document.pull) is not None:
        parts.append(
            Text(f"{pull.verdict}: a pull of {pull.pull_n:g} N at friction {pull.friction:g}")
        )
    print_frame(
        console,
        *parts,
        title=title,
        subtitle=f"[bold yellow]SIMULATED on the twin, seed {seed}[/]"
        if document.is_simulated
        else "measured",
        style="green" if good else "red",
    )


def _measurements(result: GraspResult, truth: Mapping[str, object] | None) -> Table:
    """Return the table of measurements; true values outside the interval are red."""
    table = make_table(["", ">value", "90 % interval", *[">true"] * (truth is not None)])
    for column in table.columns:
        column.no_wrap = True
    table.columns[2].justify = "center"
    for name, label, digits in _ROWS:
        measured: Measurement | None = getattr(result, name)
        if measured is None:
            table.add_row(label, "-")
            continue
        value, interval = "-", measured.text(digits=digits)
        if measured.has_value:
            if name != "firmness" or is_determined(measured):
                value = f"[bold]{measured.value:.{digits}f}[/]"
            interval = f"{measured.low:.{digits}f} … {measured.high:.{digits}f}"
        true = "-"
        if truth is not None and isinstance(known := truth.get(name), int | float):
            true = f"{known:.{digits}f}"
            if measured.has_value:
                is_inside = measured.low <= known <= measured.high
                true = f"[{'green' if is_inside else 'red'}]{true}[/]"
        note = " [yellow]*[/]" if _note_text(measured) else ""
        table.add_row(label + note, value, interval, *[true] * (truth is not None))
    return table


def _note_text(measured: Measurement) -> str:
    return measured.reason or _NOTES.get(measured.status, str(measured.status))


def _timings(result: GraspResult) -> Text:
    parts = []
    if result.decision_time_s is not None:
        parts.append(f"answer {result.decision_time_s:.1f} s after first contact")
    if result.peak_force_n is not None:
        parts.append(f"peak force {result.peak_force_n:.1f} N")
    skipped = f", {result.frames_skipped} skipped" if result.frames_skipped else ""
    parts.append(f"{result.frames} frames{skipped}, {result.frames_lost} lost")
    return Text("  ·  ".join(parts), style="dim")


def _limit_text(limit: Mapping[str, object]) -> str:
    """Return the damage limit and its effect as one line."""
    learned = f"{limit['kind'] or 'unknown kind'}, {limit['closings']} closings"
    if limit["low_n"] is None:
        why = "not measurable in this closing, so the gripper closed only slightly further"
        return f"Damage limit ({learned}): {why}"
    effect = ""
    if limit["passed"]:
        # The sheet can't resolve small forces, so the limit may be known too late.
        effect = ": known only after the force had exceeded it; the closing then stopped"
    elif limit["kept_below_target"]:
        effect = ": the force stayed below the target because of it"
    return f"Damage limit {limit['low_n']:.1f} N ({learned}){effect}"
