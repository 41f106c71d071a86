"""Frames of pixel readings, their layout, and the interface of a sensor."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Literal, Protocol, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.signal.circuit import Divider

#: A sensor counts as silent after this long without a frame.
FRAME_TIMEOUT_S = 2.0
#: Lines of the largest matrices that people build (FlexiTac's has 12 x 32).
MOST_LINES = 64
#: What the lines that are not selected do: see `ArrayLayout`.
IdleLines: TypeAlias = Literal["isolated", "floating", "held"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayLayout:
    """The pixels of a sensor: rows, columns, wiring, and fingers.

    Attributes
    ----------
    name : str
        Short name, e.g. ``"rigid-2x2"``.
    rows, cols : int
        Size of the scanned matrix, 1 to 64 each; a board with palpate's firmware reads up to 16.
    finger_of_row : tuple of int, length rows
        Finger that the pixels of each row are on: a row of the matrix never spans two fingers.
    pitch_mm : float
        Distance between neighbouring pixel centres.
    divider : Divider
        The readout circuit.
    idle_lines : {"isolated", "floating", "held"}
        What the lines of the other pixels do while one is read. *Isolated*: nothing that matters,
        each pixel has a line of its own, or a diode. *Floating*: rows and columns go to two
        multiplexers and nothing else, so that the reading leaks through detours. *Held*: idle rows
        are tied to the rail that the reference resistor goes to. Decides how crosstalk is solved
        out (`palpate.sensor.pixel_resistance`).
    line_ohm : float
        In series with every pixel: on-resistance of the multiplexers, and leads. Subtracted.

    Examples
    --------
    >>> rigid = ArrayLayout(name="rigid-2x2", rows=4, cols=2, finger_of_row=(0, 0, 1, 1))
    >>> rigid.pixels, rigid.fingers, rigid.finger_mask(1).tolist()
    (8, 2, [[False, False], [False, False], [True, True], [True, True]])
    """

    name: str
    rows: int
    cols: int
    finger_of_row: tuple[int, ...]
    pitch_mm: float = 10.0
    divider: Divider = field(default_factory=Divider)
    idle_lines: IdleLines = "isolated"
    line_ohm: float = 0.0

    def __post_init__(self) -> None:
        if self.idle_lines not in get_args(IdleLines):
            raise ValueError(
                f"layout {self.name}: idle_lines {self.idle_lines!r} is none of "
                f"{', '.join(get_args(IdleLines))}"
            )
        if not (math.isfinite(self.line_ohm) and self.line_ohm >= 0):
            raise ValueError(f"layout {self.name}: line_ohm {self.line_ohm!r} must be 0 or more")
        if not (1 <= self.rows <= MOST_LINES and 1 <= self.cols <= MOST_LINES):
            raise ValueError(f"layout {self.name}: rows and cols must be 1 to {MOST_LINES}")
        if len(self.finger_of_row) != self.rows:
            raise ValueError(
                f"layout {self.name}: finger_of_row has {len(self.finger_of_row)} entries "
                f"for {self.rows} rows"
            )

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.rows * self.cols

    @property
    def fingers(self) -> int:
        """Number of fingers."""
        return len(set(self.finger_of_row))

    def finger_mask(self, finger: int) -> NDArray[np.bool_]:
        """Return which pixels are on `finger`, shape (rows, cols)."""
        on_finger = np.array(self.finger_of_row) == finger
        return np.repeat(on_finger[:, None], self.cols, axis=1)

    def difference(self, other: ArrayLayout) -> str:
        """Describe how this layout differs from `other`; empty if both give the same readings.

        Names don't count.

        Examples
        --------
        >>> from dataclasses import replace
        >>> RIGID_LAYOUT.difference(replace(RIGID_LAYOUT, idle_lines="floating"))
        "idle_lines 'isolated' instead of 'floating'"
        >>> RIGID_LAYOUT.difference(replace(RIGID_LAYOUT, name="left gripper"))
        ''
        """
        mine, its = ({**asdict(layout), **asdict(layout.divider)} for layout in (self, other))
        return ", ".join(
            f"{name} {mine[name]!r} instead of {its[name]!r}"
            for name in mine
            if name not in ("name", "divider") and mine[name] != its[name]
        )


#: Two rigid fingers with a 2x2 array each (paper, section 3.1).
RIGID_LAYOUT = ArrayLayout(name="rigid-2x2", rows=4, cols=2, finger_of_row=(0, 0, 1, 1))
#: Two soft fingers with a 3x2 array each (paper, section 4.2).
SOFT_LAYOUT = ArrayLayout(name="soft-3x2", rows=6, cols=2, finger_of_row=(0, 0, 0, 1, 1, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One scan of all the pixels.

    Attributes
    ----------
    time_s : float
        When it was scanned: device time mapped to the host's clock. Rises from frame to frame.
    sequence : int
        Number given by the device, without the wrap: gaps are lost frames.
    counts : ndarray of int, shape (rows, cols)
        Raw ADC counts, summed over `oversampling` conversions; read-only.
    oversampling : int
        Conversions summed per pixel.
    ceiling_tripped : bool
        Whether a pixel has reached the ceiling that the board checks, since it was armed.
    """

    time_s: float
    sequence: int
    counts: NDArray[np.int32]
    oversampling: int = 1
    ceiling_tripped: bool = False

    def __post_init__(self) -> None:
        counts = np.array(self.counts, dtype=np.int32)
        counts.flags.writeable = False
        object.__setattr__(self, "counts", counts)


def find_impossible_count(frame: Frame, *, layout: ArrayLayout) -> str | None:
    """Describe a reading that layout and converter cannot give; None if all are possible.

    >>> frame = Frame(time_s=0.0, sequence=0, counts=np.full((4, 2), 1024))
    >>> find_impossible_count(frame, layout=RIGID_LAYOUT)
    'pixel R0 C0 reads 1024, and 1 conversion(s) of 10 bit give 0 to 1023; check the layout'
    """
    counts, divider = frame.counts, layout.divider
    if counts.shape != (layout.rows, layout.cols):
        return (
            f"a frame of shape {counts.shape} does not fit layout {layout.name} "
            f"({layout.rows} x {layout.cols}); check the board's configuration"
        )
    top = frame.oversampling * (divider.full_scale - 1)
    wrong = (counts < 0) | (counts > top)
    if not wrong.any():
        return None
    row, col = np.argwhere(wrong)[0].tolist()
    return (
        f"pixel R{row} C{col} reads {counts[row, col]}, and {frame.oversampling} conversion(s) of "
        f"{divider.adc_bits} bit give 0 to {top}; check the layout"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCounters:
    """Frames, losses and errors counted on the link to a board."""

    #: Frames received.
    frames: int = 0
    #: Frames that are missing by their numbers, or by the time between them.
    lost: int = 0
    #: Packets or lines rejected.
    corrupt: int = 0
    #: Frames older than 5 periods and 100 ms when they were read: the host stalled.
    late: int = 0
    #: Streams begun after the first: resets of the board, and resumptions.
    restarts: int = 0
    #: Times that the port was opened again.
    reconnects: int = 0
    #: How much longer a host second is than the board's, parts per million; None if unknown.
    drift_ppm: float | None = None

    def since(self, before: LinkCounters) -> LinkCounters:
        """Return the counts since `before`, with the present drift."""
        counted = {
            f.name: getattr(self, f.name) - getattr(before, f.name)
            for f in fields(self)
            if f.name != "drift_ppm"
        }
        return LinkCounters(**counted, drift_ppm=self.drift_ppm)


class PressureArray(Protocol):
    """A source of frames: hardware, the twin or a recording."""

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames that the array delivers."""
        ...

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, oldest first.

        Raises
        ------
        DeviceTimeoutError
            If none came within `timeout_s`.
        DeviceError
            If the source is gone for good.
        """
        ...

    def close(self) -> None:
        """Release the source; calling it again does nothing."""
        ...


def link_counters(array: PressureArray) -> LinkCounters | None:
    """Return the counters of an array's link; None for an array without one."""
    counters = getattr(array, "counters", None)
    return counters if isinstance(counters, LinkCounters) else None
