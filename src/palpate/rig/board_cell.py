"""Load cells on the board's HX711 amplifiers, as the reference force of a calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.clock import Clock
from palpate.errors import DeviceError, InputError
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.board_link import POLL_S
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import NO_READING, CellSample

#: Five readings of an HX711 at its slower rate: the board itself calls a cell silent after that.
_SILENT_S = 0.5
#: An older frame waited in a buffer between reads.
_OLD_S = 0.2
#: Output settles 50 ms after a load at 80 readings a second, 400 ms at 10 (HX711 data sheet, table
#: of electrical characteristics). The sheet is read 420 ms after a step: 10 a second are too few.
_LEAST_HZ = 40.0
#: Readings are averaged over this; at 80 a second their numbers wrap after 3 s.
_MEAN_S = 1.0
#: 24 bits with a sign.
_LOWEST, _HIGHEST = -(2**23), 2**23 - 1


class BoardLoadCell:
    """One or two load cells of a board: the mean of their forces.

    `array`: the board, asked for its load cells.
    `newtons_per_count`: one for each cell in use, cell 0 first; negative where a cell counts down
        under load.
    """

    def __init__(
        self, array: SerialArray, *, clock: Clock, newtons_per_count: Sequence[float]
    ) -> None:
        self._array, self._clock = array, clock
        self._scale = np.array(newtons_per_count)
        self._used = tuple(range(len(newtons_per_count)))
        self._zero = np.zeros(len(newtons_per_count))
        self._samples: list[int] = []
        self._advanced_s = [-math.inf] * len(newtons_per_count)
        self._looked_s = -math.inf

    def tare(self) -> None:
        """Take what the cells read over the next second as no force.

        Raises `DeviceError` as `mean_counts` does.
        """
        self._zero = np.array(mean_counts(self._array, cells=self._used, clock=self._clock))

    def read_n(self) -> float:
        """Return the mean of the cells' forces now, newtons.

        Raises `DeviceError` if the board or a cell is silent, or a cell is at the end of its range.
        """
        give_up_s = self._clock.now_s() + _SILENT_S
        while not (found := self._look()):
            if self._clock.now_s() > give_up_s:
                self._refuse_silent()
            self._clock.sleep_s(POLL_S)
        raw = np.array([_check_sample(found, cell) for cell in self._used])
        return float(np.mean((raw - self._zero) * self._scale))

    def _look(self) -> tuple[CellSample, ...]:
        """Return the newest readings if they are fresh and each load cell works."""
        self._array.newest()
        now_s, found = self._clock.now_s(), self._array.load_cells
        if not now_s - self._array.newest_s < _OLD_S or not found:
            return ()
        samples = [found[cell].sample for cell in self._used]
        # Numbers of readings wrap at 256: they are compared only where nothing was missed.
        if now_s - self._looked_s < _SILENT_S:
            for cell, (sample, before) in enumerate(zip(samples, self._samples, strict=True)):
                if sample != before:
                    self._advanced_s[cell] = now_s
        self._samples, self._looked_s = samples, now_s
        alive = all(now_s - advanced_s < _SILENT_S for advanced_s in self._advanced_s)
        return found if alive else ()

    def _refuse_silent(self) -> None:
        now_s = self._clock.now_s()
        if not now_s - self._looked_s < _OLD_S:
            raise DeviceError(
                f"no frame with load cells from {self._array.name} in {_SILENT_S:g} s; check its "
                "cable and power, then run `palpate doctor`"
            )
        ages_s = [now_s - advanced_s for advanced_s in self._advanced_s]
        raise _silence_error(int(np.argmax(ages_s)))


def mean_counts(array: SerialArray, *, cells: Sequence[int], clock: Clock) -> list[float]:
    """Return the mean reading of load cells over the next second, counts.

    `array`: the board; frames that waited are read and dropped.
    `cells`: which cells, 0 or 1.
    Raises `DeviceError` if the board is silent, or a cell gives no reading, none that is new, too
    few a second, or one at the end of its range.
    """
    begin_s = clock.now_s()
    raw, samples = list[list[int]](), list[list[int]]()
    while array.read(timeout_s=FRAME_TIMEOUT_S).time_s < begin_s + _MEAN_S:
        found = array.load_cells
        if array.newest_s < begin_s:
            continue
        if not found:
            raise InputError(
                f"the board at {array.name} was not asked for its load cells: put "
                "`load_cells = true` into [array] of the rig file"
            )
        raw.append([_check_sample(found, cell) for cell in cells])
        samples.append([found[cell].sample for cell in cells])
    if len(raw) < 2:
        raise DeviceError(
            f"hardly a frame from {array.name} in {_MEAN_S:g} s; is it set to 1 frame a second?"
        )
    for cell, first, last in zip(cells, samples[0], samples[-1], strict=True):
        readings_hz = (last - first) % 256 / _MEAN_S
        if readings_hz == 0:
            raise _silence_error(cell)
        if readings_hz < _LEAST_HZ:
            raise DeviceError(
                f"load cell {cell} gives {readings_hz:.0f} readings a second, which lag by half a "
                "second; tie the RATE pin of its HX711 to the supply (80 a second)"
            )
    return [float(mean) for mean in np.mean(raw, axis=0)]


def board_with_cells(array: PressureArray) -> SerialArray:
    """Return the array if it is a board with palpate's firmware.

    Raises `InputError` if it is of another kind.
    """
    if isinstance(array, SerialArray):
        return array
    raise InputError(
        "load cells are read through the board: [array] of the rig file needs "
        'open = "palpate.sensor.board_array:open_board"'
    )


def _check_sample(found: Sequence[CellSample], cell: int) -> int:
    raw = found[cell].raw
    if raw == NO_READING:
        raise DeviceError(
            f"load cell {cell} gives no reading; check the wires and the supply of its HX711 "
            "(hardware/README.md names the pins)"
        )
    if not _LOWEST < raw < _HIGHEST:
        raise DeviceError(
            f"load cell {cell} is at the end of its range ({raw}); take the load off, and check "
            "its four wires"
        )
    return raw


def _silence_error(cell: int) -> DeviceError:
    return DeviceError(
        f"load cell {cell} is stuck: no new reading for {_SILENT_S:g} s; check the wires and the "
        "supply of its HX711"
    )
