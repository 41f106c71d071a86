"""Check of the pixel order: the resistance of the pressed pixel must fall the most.

The monitor receives frames and selects the next pixel to press. It has no clock and no I/O, so that
it works with live frames and with a recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.sensor.divider_leg import is_risen
from palpate.sensor.findings import Finding, pixel_name
from palpate.sensor.sample import relative_change_percent

PixelIndex: TypeAlias = tuple[int, int]

#: Press: one pixel falls the most for this time, by at least twice the paper's contact threshold.
_PRESSED_PERCENT, _HELD_S = -20.0, 0.25
#: Release: a rise to half of the depth of the press. The sheet recovers slowly, so that the
#: baseline of the next press is taken after this delay.
_RELEASED_FRACTION, _RELEASED_S = 0.5, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """The requested pixel, and the pixel that fell the most; None after a timeout."""

    expected: PixelIndex
    answered: PixelIndex | None


class PressMonitor:
    """Detects presses of all pixels, requested one at a time, row by row.

    `rest_ohm`, shape (rows, cols): rest values; dead pixels (inf or 0) are skipped.
    `timeout_s`: time limit for a press.

    >>> monitor = PressMonitor(np.full((1, 2), 1000.0))
    >>> monitor.next_pixel
    (0, 0)
    >>> for k in range(10):
    ...     monitor.add_frame(0.1 * k, np.array([[1000.0, 300.0]]))
    >>> monitor.presses
    (Press(expected=(0, 0), answered=(0, 1)),)
    """

    def __init__(self, rest_ohm: FloatArray, *, timeout_s: float = 20.0) -> None:
        usable = np.isfinite(rest_ohm) & (rest_ohm > 0)
        self._remaining: list[PixelIndex] = [(int(r), int(c)) for r, c in np.argwhere(usable)]
        self._base_ohm = np.where(usable, rest_ohm, np.nan)
        self._timeout_s = timeout_s
        self._presses: list[Press] = []
        self._since_s: float | None = None
        self._leader: PixelIndex | None = None
        self._leader_since_s = 0.0
        self._depth = 0.0
        self._released_s: float | None = None
        self._risen_s: float | None = None
        #: Whether the first press raised the resistance, so that none can be recognised.
        self.has_risen = False

    @property
    def next_pixel(self) -> PixelIndex | None:
        """The pixel to press next; None when done or while a pixel is pressed."""
        is_waiting = self._leader is None or self._depth == 0.0
        return self._remaining[0] if self._remaining and is_waiting else None

    @property
    def is_done(self) -> bool:
        """Whether all pixels have been requested."""
        return not self._remaining

    @property
    def presses(self) -> tuple[Press, ...]:
        """The presses recorded so far."""
        return tuple(self._presses)

    def add_frame(self, time_s: float, ohm: FloatArray) -> None:
        """Process a frame with resistances `ohm`, shape (rows, cols)."""
        if self.is_done:
            return
        self._since_s = time_s if self._since_s is None else self._since_s
        change = relative_change_percent(ohm, rest_ohm=self._base_ohm)
        change = np.where(np.isnan(change), 0.0, change)
        # Later rises may be the recovery from a press.
        if not self._presses:
            self._follow_rise(time_s, change)
        if self._depth < 0.0:
            self._await_release(time_s, change, ohm)
        else:
            self._await_press(time_s, change)

    def finish(self) -> None:
        """Record the remaining pixels as unresponsive; call after the last frame."""
        self._presses += [Press(expected=pixel, answered=None) for pixel in self._remaining]
        self._remaining.clear()

    def _follow_rise(self, time_s: float, change: FloatArray) -> None:
        if not is_risen(change):
            self._risen_s = None
            return
        self._risen_s = time_s if self._risen_s is None else self._risen_s
        self.has_risen |= time_s - self._risen_s >= _HELD_S

    def _await_press(self, time_s: float, change: FloatArray) -> None:
        row, col = divmod(int(change.argmin()), change.shape[1])
        leader = (row, col) if change[row, col] <= _PRESSED_PERCENT else None
        if leader != self._leader:
            self._leader, self._leader_since_s = leader, time_s
        if leader is not None and time_s - self._leader_since_s >= _HELD_S:
            self._depth = float(change[row, col])
            self._presses.append(Press(expected=self._remaining.pop(0), answered=leader))
            self._since_s, self._released_s = time_s, None
        elif self._since_s is not None and time_s - self._since_s > self._timeout_s:
            self._presses.append(Press(expected=self._remaining.pop(0), answered=None))
            self._since_s = time_s

    def _await_release(self, time_s: float, change: FloatArray, ohm: FloatArray) -> None:
        self._depth = min(self._depth, float(change.min()))
        if change.min() < _RELEASED_FRACTION * self._depth:
            self._released_s = None
        elif self._released_s is None:
            self._released_s = time_s
        is_overdue = self._since_s is not None and time_s - self._since_s > self._timeout_s
        is_released = self._released_s is not None and time_s - self._released_s >= _RELEASED_S
        if is_released or is_overdue:
            self._base_ohm = np.where(np.isnan(self._base_ohm), np.nan, ohm)
            self._depth, self._leader, self._since_s = 0.0, None, time_s


def order_findings(presses: Sequence[Press], *, layout: ArrayLayout) -> list[Finding]:
    """Return findings for pixels without a response and for swapped pixels.

    Swapped rows or columns are reported as one finding per line.

    >>> pair = ArrayLayout(name="pair", rows=2, cols=1, finger_of_row=(0, 1))
    >>> crossed = [Press(expected=(0, 0), answered=(1, 0)), Press(expected=(1, 0), answered=(0, 0))]
    >>> [(found.where, found.text) for found in order_findings(crossed, layout=pair)]
    [('row R0', 'answers as row R1'), ('row R1', 'answers as row R0')]
    """
    findings = [
        Finding("silent", "did not respond when pressed", pixel_name(*press.expected))
        for press in presses
        if press.answered is None
    ]
    answers = {p.expected: p.answered for p in presses if p.answered is not None}
    rows = _map_lines(answers, axis=0)
    cols = _map_lines(answers, axis=1)
    has_only_swapped_lines = all(
        (rows.get(r, r), cols.get(c, c)) == answered for (r, c), answered in answers.items()
    )
    if has_only_swapped_lines:
        findings += _line_findings("row R", rows)
        findings += _line_findings("column C", cols)
        return findings
    for expected, answered in answers.items():
        if expected != answered:
            text = f"answers as {pixel_name(*answered)}"
            findings.append(Finding("swapped", text, pixel_name(*expected)))
    return findings


def _map_lines(answers: dict[PixelIndex, PixelIndex], *, axis: int) -> dict[int, int]:
    """Map each expected line to the answering line, if all pixels of the line agree."""
    answering: dict[int, set[int]] = {}
    for expected, answered in answers.items():
        answering.setdefault(expected[axis], set()).add(answered[axis])
    return {line: others.pop() for line, others in answering.items() if len(others) == 1}


def _line_findings(name: str, lines: dict[int, int]) -> Iterator[Finding]:
    for line, answered in lines.items():
        if line != answered:
            yield Finding("swapped", f"answers as {name}{answered}", f"{name}{line}")
