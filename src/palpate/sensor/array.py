"""Frames of pixel readings, the layout of the pixels, and the interface of a sensor."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from typing import Literal, Protocol, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.clock import Clock
from palpate.errors import DeviceError
from palpate.signal.circuit import Divider

#: A sensor counts as silent after this long without a frame.
FRAME_TIMEOUT_S = 2.0
#: Largest number of rows or columns; FlexiTac's board, the largest supported, has 16 x 32.
MAX_LINES = 64
#: Longest duration of a read that returns a waiting frame, and age of the newest frame.
_PROMPT_S = 0.002
#: No finger has pixels a metre apart, and no lead or multiplexer has a megohm.
LARGEST_PITCH_MM, LARGEST_LINE_OHM = 1000.0, 1e6
#: Connection of the unselected lines; see `ArrayLayout`.
IdleLines: TypeAlias = Literal["isolated", "floating", "held"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayLayout:
    """The pixels of a sensor: rows, columns, wiring and fingers.

    Attributes
    ----------
    name : str
        Short name, e.g. ``"rigid-2x2"``.
    rows, cols : int
        Size of the scanned matrix, 1 to 64 each. A board with palpate's firmware reads up to 16.
    finger_of_row : tuple of int, length rows
        Finger of each row. A row of the matrix never spans two fingers.
    pitch_mm : float
        Distance between the centres of adjacent pixels.
    divider : Divider
        The readout circuit.
    idle_lines : {"isolated", "floating", "held"}
        State of the unselected lines during a reading; it determines the crosstalk correction
        (`palpate.sensor.sample`). *Isolated*: each pixel has its own line or a diode,
        and there is no crosstalk. *Floating*: rows and columns connect only to two multiplexers,
        and current also flows through other pixels. *Held*: idle rows are tied to the same rail
        as the reference resistor.
    line_ohm : float
        Resistance in series with every pixel (multiplexers and leads). It is subtracted.

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
                f"layout {self.name}: idle_lines {self.idle_lines!r} must be one of "
                f"{', '.join(get_args(IdleLines))}"
            )
        if not 0 <= self.line_ohm <= LARGEST_LINE_OHM:
            raise ValueError(
                f"layout {self.name}: line_ohm {self.line_ohm!r} must be 0 or more, at most "
                f"{LARGEST_LINE_OHM:g}"
            )
        if not (1 <= self.rows <= MAX_LINES and 1 <= self.cols <= MAX_LINES):
            raise ValueError(f"layout {self.name}: rows and cols must be 1 to {MAX_LINES}")
        if len(self.finger_of_row) != self.rows:
            raise ValueError(
                f"layout {self.name}: finger_of_row has {len(self.finger_of_row)} entries "
                f"for {self.rows} rows"
            )
        if set(self.finger_of_row) != set(range(self.fingers)):
            raise ValueError(
                f"layout {self.name}: finger_of_row {list(self.finger_of_row)} must number the "
                "fingers from 0 without gaps"
            )
        if not 0 < self.pitch_mm <= LARGEST_PITCH_MM:
            raise ValueError(
                f"layout {self.name}: pitch_mm is {self.pitch_mm:g}; it must be above 0 and at "
                f"most {LARGEST_PITCH_MM:g}"
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
        """Return the mask of the pixels on `finger`, shape (rows, cols)."""
        on_finger = np.array(self.finger_of_row) == finger
        return np.repeat(on_finger[:, None], self.cols, axis=1)

    def describe_difference(self, other: ArrayLayout) -> str:
        """Describe the differences from `other`; return an empty string if there are none.

        The names of the layouts are not compared.

        Examples
        --------
        >>> from dataclasses import replace
        >>> RIGID_LAYOUT.describe_difference(replace(RIGID_LAYOUT, idle_lines="floating"))
        "idle_lines 'isolated' instead of 'floating'"
        >>> RIGID_LAYOUT.describe_difference(replace(RIGID_LAYOUT, name="left gripper"))
        ''
        """
        own, others = ({**asdict(layout), **asdict(layout.divider)} for layout in (self, other))
        return ", ".join(
            f"{name} {own[name]!r} instead of {others[name]!r}"
            for name in own
            if name not in ("name", "divider") and own[name] != others[name]
        )


#: Two rigid fingers with a 2x2 array each (paper, section 3.1).
RIGID_LAYOUT = ArrayLayout(name="rigid-2x2", rows=4, cols=2, finger_of_row=(0, 0, 1, 1))
#: Two soft fingers with a 3x2 array each (paper, section 4.2).
SOFT_LAYOUT = ArrayLayout(name="soft-3x2", rows=6, cols=2, finger_of_row=(0, 0, 0, 1, 1, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One scan of all pixels.

    Attributes
    ----------
    time_s : float
        Scan time: device time mapped to the host's clock. It increases from frame to frame.
    sequence : int
        Unwrapped frame number from the device. Gaps are lost frames.
    counts : ndarray of int, shape (rows, cols)
        Raw ADC counts, summed over `oversampling` conversions; read-only.
    oversampling : int
        Conversions summed per pixel.
    ceiling_tripped : bool
        Whether a pixel has reached the board's ceiling since the ceiling was armed.
    skipped : int
        Frames before this one that were received and not used, because a newer one had arrived.
    """

    time_s: float
    sequence: int
    counts: NDArray[np.int32]
    oversampling: int = 1
    ceiling_tripped: bool = False
    skipped: int = 0

    def __post_init__(self) -> None:
        counts = np.array(self.counts, dtype=np.int32)
        counts.flags.writeable = False
        object.__setattr__(self, "counts", counts)


def find_impossible_count(frame: Frame, *, layout: ArrayLayout) -> str | None:
    """Describe a reading outside the range of the layout's converter; None if all are valid.

    >>> frame = Frame(time_s=0.0, sequence=0, counts=np.full((4, 2), 1024))
    >>> find_impossible_count(frame, layout=RIGID_LAYOUT)
    'pixel R0 C0 reads 1024; valid readings are 0 to 1023 (10 bits x 1); check the layout'
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
        f"pixel R{row} C{col} reads {counts[row, col]}; valid readings are 0 to {top} "
        f"({divider.adc_bits} bits x {frame.oversampling}); check the layout"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCounters:
    """Frames, losses and errors counted on the link to a board."""

    #: Frames received.
    frames: int = 0
    #: Missing frames, from gaps in the frame numbers or in time.
    lost: int = 0
    #: Packets or lines rejected.
    corrupt: int = 0
    #: Frames older than 5 periods and 100 ms on arrival, because the host or the adapter stalled.
    late: int = 0
    #: Oldest frames removed from a full queue, because no program read them.
    dropped: int = 0
    #: Streams after the first: the board was reset or the stream was started again.
    restarts: int = 0
    #: Times that the port was reopened.
    reconnects: int = 0
    #: Excess of a board second over a host second, parts per million; None if unknown.
    drift_ppm: float | None = None

    def count_since(self, before: LinkCounters) -> LinkCounters:
        """Return the counts since `before`, with the current drift."""
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
        """Layout of the frames."""
        ...

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, oldest first.

        With a timeout of 0, only a frame that has arrived.

        Raises
        ------
        DeviceTimeoutError
            If no frame arrived within `timeout_s`.
        DeviceError
            If the source is permanently lost.
        """
        ...

    def close(self) -> None:
        """Release the source; calling it again does nothing."""
        ...


def read_waiting(
    array: PressureArray, *, clock: Clock, timeout_s: float, fresh_s: float = _PROMPT_S
) -> list[Frame]:
    """Return the frames that have arrived, oldest first; wait for one if there is none.

    The newest frame is the last. A program that was busy thus continues with the present.

    `clock`: clock of the frames' times.
    `fresh_s`: a frame of at most this age is taken as the newest. A larger value preserves the
        frames that an adapter delivers in bursts.
    Raises `DeviceError` as `PressureArray.read`.
    """
    frames = [array.read(timeout_s=timeout_s)]
    while (asked_s := clock.now_s()) - frames[-1].time_s > fresh_s:
        try:
            frames.append(array.read(timeout_s=0.0))
        except DeviceError:
            break  # none is waiting; a lost array is reported by the next read
        if clock.now_s() - asked_s > _PROMPT_S:
            break  # an array that ignores the timeout has waited for the next frame
    return frames


def read_newest(
    array: PressureArray, *, clock: Clock, timeout_s: float, fresh_s: float = _PROMPT_S
) -> Frame:
    """Return the newest frame; its `skipped` counts the older ones (`read_waiting`)."""
    frames = read_waiting(array, clock=clock, timeout_s=timeout_s, fresh_s=fresh_s)
    return replace(frames[-1], skipped=len(frames) - 1) if len(frames) > 1 else frames[0]


def get_link_counters(array: PressureArray) -> LinkCounters | None:
    """Return the counters of an array's link; None for an array without one."""
    counters = getattr(array, "counters", None)
    return counters if isinstance(counters, LinkCounters) else None
