"""The terminal view of `palpate live`: a heat map per finger, aggregate and link."""

from __future__ import annotations

import math
from collections import deque

from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from palpate.arrays import FloatArray
from palpate.cli.live_reading import LiveReading
from palpate.cli.output import CARD_FRAME, make_card
from palpate.plots.pixel_colors import DEEPEST_PERCENT, terminal_style
from palpate.sensor.array import Frame
from palpate.signal.relative import finger_means, mean_change

DRAW_HZ = 10.0
#: Number of columns of the curve, and duration of a column, seconds.
_CURVE_COLUMNS, _COLUMN_S = 64, 0.25
#: Upper limit of displayed changes: a loose contact can read a hundred times its rest value.
_HIGHEST_PERCENT = 999
#: (maximum columns, characters per pixel) for 80-column terminals; below four characters, only
#: the color is shown.
_CELL_WIDTHS = ((4, 11), (8, 7), (16, 4), (32, 2), (64, 1))
#: Characters of a curve, from the lowest to the highest value.
_BLOCKS = " ▁▂▃▄▅▆▇█"


class LiveView:
    """Renders a reading with a curve of its last seconds."""

    def __init__(self, reading: LiveReading) -> None:
        self._reading, self._layout = reading, reading.source.array.layout
        self._curve: deque[float] = deque(maxlen=_CURVE_COLUMNS)
        self._column = -1
        #: Characters per line inside the frame.
        self._room = _CURVE_COLUMNS

    def add(self, frame: Frame) -> None:
        """Add a frame."""
        self._reading.add(frame)
        change = self._reading.change_percent
        if change is None:
            return
        depth_percent = -float(mean_change(change))
        column = int(frame.time_s / _COLUMN_S)
        if column == self._column and self._curve:
            self._curve[-1] = depth_percent
        else:
            self._curve.append(depth_percent)
        self._column = column

    def render(self, console: Console) -> RenderableType:
        """Return the current view, fitted to the width of a console."""
        self._room = console.width - CARD_FRAME
        simulated = self._reading.source.simulated
        title = f"[bold]palpate live[/]  {self._reading.source.name}"
        return make_card(
            console,
            *self._body(),
            None,
            self._link(),
            title=title,
            subtitle="[bold yellow]SIMULATED: closes and opens[/]" if simulated else "live",
            style="red" if self._reading.is_stale else "green",
        )

    def _body(self) -> list[RenderableType | None]:
        change = self._reading.change_percent
        if change is None:
            return [Text("measuring rest values: do not touch the sensor", style="yellow")]
        fingers = sorted(set(self._layout.finger_of_row))
        means = finger_means(change, finger_of_row=self._layout.finger_of_row)
        maps = [
            self._finger(change, finger, float(mean))
            for finger, mean in zip(fingers, means, strict=True)
        ]
        return [Columns(maps, padding=(0, 4)), None, self._aggregate(change)]

    def _finger(self, change: FloatArray, finger: int, mean: float) -> RenderableType:
        rows = [
            row for row in range(self._layout.rows) if self._layout.finger_of_row[row] == finger
        ]
        tall = len(rows) <= 6
        grid = Table.grid(padding=0)
        for row in rows:
            cells = [self._cell(change, row, col, tall=tall) for col in range(self._layout.cols)]
            grid.add_row(*cells)
        is_touching = finger in self._reading.touching
        state = "[bold green]contact[/]" if is_touching else "[dim]no contact[/]"
        head = Text.from_markup(f"finger {finger}   {_percent(mean)}   {state}")
        return Group(head, grid)

    def _cell(self, change: FloatArray, row: int, col: int, *, tall: bool) -> Text:
        assert self._reading.ohm is not None
        value, ohm = float(change[row, col]), float(self._reading.ohm[row, col])
        if math.isnan(value):
            words = "open" if math.isinf(ohm) else "dead"
            style = "bold white on dark_red"
        else:
            words = f"{min(round(value), _HIGHEST_PERCENT):+d} %"
            style = terminal_style(value)
        cols = self._layout.cols
        width = next((w for most, w in _CELL_WIDTHS if cols <= most and cols * w <= self._room), 1)
        blank = " " * width
        shown = words if width >= 7 else words.removesuffix(" %") if width >= 4 else ""
        middle = f"{shown:^{width}}"
        return Text(f"{blank}\n{middle}\n{blank}" if tall else middle, style=style)

    def _aggregate(self, change: FloatArray) -> RenderableType:
        mean = float(mean_change(change))
        columns = max(1, min(_CURVE_COLUMNS, self._room))
        blocks = [curve_block(depth / DEEPEST_PERCENT) for depth in self._curve]
        curve = "".join(blocks[-columns:]).rjust(columns)
        head = Text.from_markup(f"mean relative change [bold]{_percent(mean)}[/]")
        span = f"0 to -{DEEPEST_PERCENT:.0f} %, last {columns * _COLUMN_S:.0f} s"
        lines = [head, Text(curve, style="dark_orange"), Text(span, style="dim")]
        if (force := self._reading.force_n) is not None:
            # Without contact, only the upper limit is known.
            newtons = f"[bold]at most {force.high:.2f} N[/], no contact"
            if force.value is None:
                unit = " N" if force.known_ends[0] is not None else ""
                newtons = f"[bold]{force.text(digits=2)}{unit}[/], {force.reason}"
            elif self._reading.touching:
                ends = f"{force.low:.2f} to {force.high:.2f}, {force.level:.0%}"
                newtons = f"[bold]{force.value:.2f} N[/] ({ends})"
            lines.append(Text.from_markup(f"force now {newtons}"))
        return Group(*lines)

    def _link(self) -> RenderableType:
        reading = self._reading
        if not reading.frames:
            return Text("no frame yet", style="bold red")
        counters = reading.source.link_counters()
        lost = f"[bold red]{reading.lost} lost[/]" if reading.lost else "0 lost"
        bad = f"[bold red]{counters.corrupt} corrupt[/]" if counters.corrupt else "0 corrupt"
        color = "bold red" if reading.is_stale else "green"
        age = f"[{color}]last frame {1e3 * reading.age_s:.0f} ms ago[/]"
        rest = "calibrated rest" if reading.calibrated else "rest from the first second"
        rate = "" if math.isnan(reading.rate_hz) else f"{reading.rate_hz:.1f} Hz  ·  "
        if reading.is_stale:
            rate = "[bold red]NO FRAMES[/]  ·  "
        return Text.from_markup(
            f"{rate}{reading.frames} frames, {lost}, {bad}  ·  {age}  ·  [dim]{rest}[/]"
        )


def _percent(mean: float) -> str:
    """Format a mean over pixels at fixed width; "no pixel" for NaN."""
    return "no pixel" if math.isnan(mean) else f"{min(mean, _HIGHEST_PERCENT):+6.1f} %"


def curve_block(fraction: float) -> str:
    """Return the character of a curve for a fraction of its height; a space for NaN."""
    if math.isnan(fraction):
        return " "
    return _BLOCKS[round(min(max(fraction, 0.0), 1.0) * (len(_BLOCKS) - 1))]
