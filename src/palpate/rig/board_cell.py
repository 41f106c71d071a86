"""Load cells on the board's HX711 amplifiers: the reference force of a calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.clock import Clock
from palpate.errors import DeviceError, InputError
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.byte_stream import POLL_S
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import NO_READING, CellSample

#: Five readings of an HX711 at its slower rate; the board also reports a cell as silent then.
_SILENT_S = 0.5
#: Maximum age of a frame; an older frame waited in a buffer between reads.
_MAX_AGE_S = 0.2
#: Output settles 50 ms after a load at 80 readings a second, 400 ms at 10 (HX711 data sheet, table
#: of electrical characteristics). The sheet is read 420 ms after a step: 10 readings/s are too few.
_MIN_HZ = 40.0
#: Averaging time of readings; at 80 readings/s their sequence numbers wrap after 3 s.
_MEAN_S = 1.0
#: Limits of a signed 24-bit converter.
_LOWEST, _HIGHEST = -(2**23), 2**23 - 1


class BoardLoadCell:
    """The mean force of one or two load cells of a board.

    `array`: a board whose frames contain the load cells.
    `newtons_per_count`: scale of each cell in use, cell 0 first; negative if the counts fall under
        load.
    """

    def __init__(
        self, array: SerialArray, *, clock: Clock, newtons_per_count: Sequence[float]
    ) -> None:
        self._array, self._clock = array, clock
        self._scale = np.array(newtons_per_count)
        self._used = tuple(range(len(newtons_per_count)))
        self._zero = np.zeros(len(newtons_per_count))
        self._samples: list[int] = []
        self._updated_s = [-math.inf] * len(newtons_per_count)
        self._checked_s = -math.inf

    def tare(self) -> None:
        """Use the mean reading over the next second as zero force.

        Raises `DeviceError` as `measure_mean_counts` does.
        """
        self._zero = np.array(measure_mean_counts(self._array, cells=self._used, clock=self._clock))

    def read_n(self) -> float:
        """Return the present mean of the cells' forces, newtons.

        Raises `DeviceError` if the board or a cell is silent, or a cell is saturated.
        """
        deadline_s = self._clock.now_s() + _SILENT_S
        while not (found := self._read_fresh_samples()):
            if self._clock.now_s() > deadline_s:
                self._raise_silence()
            self._clock.sleep_s(POLL_S)
        raw = np.array([_check_sample(found, cell) for cell in self._used])
        return float(np.mean((raw - self._zero) * self._scale))

    def _read_fresh_samples(self) -> tuple[CellSample, ...]:
        """Return the newest readings if they are recent and no load cell is stuck."""
        self._array.read_newest()
        now_s, found = self._clock.now_s(), self._array.load_cells
        if not now_s - self._array.newest_s < _MAX_AGE_S or not found:
            return ()
        samples = [found[cell].sample for cell in self._used]
        # Sequence numbers wrap at 256, so they are compared only across short pauses.
        if now_s - self._checked_s < _SILENT_S:
            for cell, (sample, before) in enumerate(zip(samples, self._samples, strict=True)):
                if sample != before:
                    self._updated_s[cell] = now_s
        self._samples, self._checked_s = samples, now_s
        are_updating = all(now_s - updated_s < _SILENT_S for updated_s in self._updated_s)
        return found if are_updating else ()

    def _raise_silence(self) -> None:
        now_s = self._clock.now_s()
        if not now_s - self._checked_s < _MAX_AGE_S:
            raise DeviceError(
                f"no frame with load cells from {self._array.name} in {_SILENT_S:g} s; check its "
                "cable and power, then run `palpate doctor`"
            )
        ages_s = [now_s - updated_s for updated_s in self._updated_s]
        raise _silence_error(int(np.argmax(ages_s)))


def measure_mean_counts(array: SerialArray, *, cells: Sequence[int], clock: Clock) -> list[float]:
    """Return the mean reading of load cells over the next second, counts.

    `array`: the board; waiting frames are read and dropped.
    `cells`: indices of the cells, 0 or 1.
    Raises `DeviceError` if the board is silent, or a cell is missing, stuck, too slow or saturated;
    `InputError` if the frames contain no load cells.
    """
    begin_s = clock.now_s()
    raw, samples = list[list[int]](), list[list[int]]()
    while array.read(timeout_s=FRAME_TIMEOUT_S).time_s < begin_s + _MEAN_S:
        found = array.load_cells
        if array.newest_s < begin_s:
            continue
        if not found:
            raise InputError(
                f"the frames of the board at {array.name} contain no load cells; set "
                "`load_cells = true` in [array] of the rig file"
            )
        raw.append([_check_sample(found, cell) for cell in cells])
        samples.append([found[cell].sample for cell in cells])
    if len(raw) < 2:
        raise DeviceError(
            f"fewer than 2 frames from {array.name} in {_MEAN_S:g} s; raise its frame rate"
        )
    for cell, first, last in zip(cells, samples[0], samples[-1], strict=True):
        readings_hz = (last - first) % 256 / _MEAN_S
        if readings_hz == 0:
            raise _silence_error(cell)
        if readings_hz < _MIN_HZ:
            raise DeviceError(
                f"load cell {cell} sends {readings_hz:.0f} readings per second, about half a "
                "second late; connect the RATE pin of its HX711 to the supply (80 per second)"
            )
    return [float(mean) for mean in np.mean(raw, axis=0)]


def require_board(array: PressureArray) -> SerialArray:
    """Return the array as a board with palpate's firmware.

    Raises `InputError` for another type of array.
    """
    if isinstance(array, SerialArray):
        return array
    raise InputError(
        "load cells are read through a board with palpate's firmware: [array] of the rig file "
        'needs open = "palpate.sensor.board_array:open_board"'
    )


def _check_sample(found: Sequence[CellSample], cell: int) -> int:
    raw = found[cell].raw
    if raw == NO_READING:
        raise DeviceError(
            f"load cell {cell} sends no reading; check the wires and the supply of its HX711 "
            "(hardware/README.md names the pins)"
        )
    if not _LOWEST < raw < _HIGHEST:
        raise DeviceError(
            f"load cell {cell} is at the end of its range ({raw}); remove the load, and check its "
            "four wires"
        )
    return raw


def _silence_error(cell: int) -> DeviceError:
    return DeviceError(
        f"load cell {cell} is stuck: no new reading for {_SILENT_S:g} s; check the wires and the "
        "supply of its HX711"
    )
