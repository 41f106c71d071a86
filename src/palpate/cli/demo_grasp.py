"""The grasp of `palpate demo`: live in the terminal, or as lines in a pipe, then its picture."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from palpate.cli.grasp_card import print_card
from palpate.cli.live_view import curve_block
from palpate.cli.output import SIMULATED, make_card
from palpate.demo.grasp import OBJECT, RIG, SEED, TARGET_N, GraspMoment, run_demo_grasp
from palpate.files import atomic_path
from palpate.grasp.phases import Phase
from palpate.measurement import Measurement
from palpate.plots.grasp_picture import draw_grasp
from palpate.plots.pixel_colors import terminal_style
from palpate.terminal_table import make_console

#: Upper end of the force scale, newtons, and its number of characters.
_SCALE_N, _COLUMNS = 4.0, 48
#: Time of a column of the curve, and between two lines in a pipe, seconds.
_COLUMN_S, _LINE_S = 0.16, 0.5
_PHASES = tuple(phase for phase in Phase if phase is not Phase.DONE)


def write_grasp(folder: Path) -> list[Path]:
    """Show the simulated grasp, and write its recording and its picture.

    `folder`: created if absent.
    Writes `grasp.mcap`, the recording, and `grasp.svg`, which plays the grasp in a browser.
    """
    folder.mkdir(parents=True, exist_ok=True)
    recording, picture = folder / "grasp.mcap", folder / "grasp.svg"
    recording.unlink(missing_ok=True)
    console = make_console()
    with _show(console) as (follow, speed):
        grasp = run_demo_grasp(follow=follow, record=recording, speed=speed)
    print_card(grasp.document, title=f"[bold]{OBJECT}[/] on {RIG}", seed=SEED)
    with atomic_path(picture) as partial:
        partial.write_text(draw_grasp(grasp, moving=True), encoding="utf-8")
    return [picture, recording]


@contextmanager
def _show(console: Console) -> Iterator[tuple[Callable[[GraspMoment], None], float | None]]:
    """Yield what shows each moment, and the speed of the grasp; no limit without a terminal."""
    if not console.is_terminal:
        yield _Lines(console).add, None
        return
    view = _View(console)
    with Live(console=console, transient=True, auto_refresh=False) as live:
        yield lambda moment: live.update(view.add(moment), refresh=True), 1.0


class _Lines:
    """A line at the start of each phase and every half second."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._phase: Phase | None = None
        self._due_s = -math.inf

    def add(self, moment: GraspMoment) -> None:
        """Print a moment, if it is due."""
        if moment.phase is self._phase and moment.time_s < self._due_s:
            return
        self._phase, self._due_s = moment.phase, moment.time_s + _LINE_S
        self._console.print(
            f"{moment.time_s:5.1f} s  {moment.phase.value:<8}  {moment.width_mm:5.1f} mm  "
            f"{_newtons(moment.force_n)}".rstrip()
        )


class _View:
    """The live card: phases, pixels, and the force with its interval."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._curve: deque[float] = deque(maxlen=_COLUMNS)

    def add(self, moment: GraspMoment) -> RenderableType:
        """Return the card after a moment."""
        if moment.time_s >= len(self._curve) * _COLUMN_S:
            self._curve.append(0.0 if moment.force_n is None else moment.force_n.middle)
        phases = Text("  ").join(
            Text(phase.value, style="bold reverse green" if phase is moment.phase else "dim")
            for phase in _PHASES
        )
        scale = f"0 N{f'{_SCALE_N:g} N':>{_COLUMNS - 3}}"
        return make_card(
            self._console,
            phases,
            None,
            _draw_pixels(moment),
            None,
            Text.assemble(("grip force  ", "dim"), (_newtons(moment.force_n), "bold")),
            _draw_interval(moment.force_n),
            Text(scale, style="dim"),
            None,
            Text("".join(curve_block(n / _SCALE_N) for n in self._curve), style="dark_orange"),
            title=f"[bold]{OBJECT}[/] on {RIG}, to {TARGET_N:g} N",
            subtitle=f"{SIMULATED}, {moment.time_s:.1f} s",
            style="green",
        )


def _draw_pixels(moment: GraspMoment) -> RenderableType:
    """Draw the pixels row by row, and the width between the fingers."""
    lines = []
    for row in moment.change_percent.tolist():
        line = Text()
        for change in row:
            shown, style = "open", "white on rgb(90,90,90)"
            if not math.isnan(change):
                shown, style = f"{change:+.0f} %", terminal_style(change)
            line.append(f"{shown:^9}", style=style)
        lines.append(line)
    lines.append(Text(f"{moment.width_mm:.1f} mm between the fingers", style="dim"))
    return Group(*lines)


def _draw_interval(force: Measurement | None) -> Text:
    """Draw the interval as a bar on the scale, with the value and the target in it."""
    cells = [" "] * (_COLUMNS + 1)
    if force is not None:
        low, middle, high = (_column(n) for n in (force.low, force.middle, force.high))
        cells[low : high + 1] = "━" * (high + 1 - low)
        cells[middle] = "●"
    target = _column(TARGET_N)
    bar = Text("".join(cells), style="bold cyan")
    if cells[target] in " ━":
        bar = Text.assemble(bar[:target], ("│", "bold yellow"), bar[target + 1 :])
    return bar


def _column(force_n: float) -> int:
    return round(_COLUMNS * min(max(force_n / _SCALE_N, 0.0), 1.0))


def _newtons(force: Measurement | None) -> str:
    if force is None:
        return ""
    return f"{force.middle:.2f} N (90 %: {force.low:.2f} to {force.high:.2f})"
