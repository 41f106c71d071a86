"""The real firmware on the AVR simulator, with its pins and its serial line in Python's hands.

Needs the images that `make -C firmware` and `make -C firmware/sim` build. Everything it gives is
simulated; the program that runs is the one that goes on the board.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import DeviceError, DeviceNotFoundError

CLOCK_HZ = 16_000_000
BUILD = Path(__file__).resolve().parents[3] / "firmware" / "build"
_SIDE = 16
_OUT_BYTES = 1 << 20
#: Simulated time per call into the simulator: the line must not outrun its buffer of 1 MB.
_LONGEST_RUN_S = 1.0

_SIGNATURES: dict[str, tuple[object, list[object]]] = {
    "board_open": (ctypes.c_void_p, [ctypes.c_char_p, ctypes.c_uint32, ctypes.c_uint64]),
    "board_close": (None, [ctypes.c_void_p]),
    "board_run": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_uint64]),
    "board_cycle": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_conversions": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_misrouted": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_output_duty": (ctypes.c_double, [ctypes.c_void_p]),
    "board_pressure": (ctypes.c_double, [ctypes.c_void_p]),
    "board_safe_line": (ctypes.c_int, [ctypes.c_void_p]),
    "board_reset": (None, [ctypes.c_void_p]),
    "board_hang": (None, [ctypes.c_void_p]),
    "board_set_noise_mv": (None, [ctypes.c_void_p, ctypes.c_float]),
    "board_set_pixels": (None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint64]),
    "board_set_load": (None, [ctypes.c_void_p, ctypes.c_int, ctypes.c_int32]),
    "board_give": (ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32]),
    "board_take": (ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
}


def _library() -> ctypes.CDLL:
    path = BUILD / "libpalpate_board.so"
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise DeviceNotFoundError(
            f"no firmware simulator at {path}: in a source checkout, install gcc-avr, avr-libc, "
            "binutils-avr, libsimavr-dev and libelf-dev, then run `make -C firmware` and "
            "`make -C firmware/sim`"
        ) from error
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


class FirmwareBoard:
    """An Arduino Mega 2560 that runs an image; time passes only in `run_until`.

    Parameters
    ----------
    elf : Path, optional
        Image to run; the one for 1 Mbaud by default.
    baud : int
        Speed of the serial line.
    seed : int
        Seed of the converter's noise.

    Raises
    ------
    DeviceNotFoundError
        If simulator or image have not been built.
    """

    def __init__(self, elf: Path | None = None, *, baud: int = 1_000_000, seed: int = 0) -> None:
        self._board: int | None = None
        self._library = _library()
        path = BUILD / "palpate-mega2560.elf" if elf is None else elf
        if not path.is_file():
            raise DeviceNotFoundError(
                f"no firmware image at {path}: install gcc-avr, avr-libc and binutils-avr, then "
                "run `make -C firmware`"
            )
        self._board = self._library.board_open(str(path).encode(), baud, seed)
        if not self._board:
            raise DeviceNotFoundError(f"{path} is not an image that the simulator can run")
        self._bytes = np.empty(_OUT_BYTES, dtype=np.uint8)
        self._cycles = np.empty(_OUT_BYTES, dtype=np.uint64)

    def now_s(self) -> float:
        """Return the simulated time since power-up, seconds."""
        return float(self._library.board_cycle(self._board)) / CLOCK_HZ

    def run_until(self, time_s: float) -> None:
        """Let the program run up to `time_s`, at most one second on (what it sends is kept).

        Raises
        ------
        ValueError
            If that is more than a second ahead: take the bytes in between.
        DeviceError
            If the program has crashed.
        """
        if time_s > self.now_s() + _LONGEST_RUN_S:
            raise ValueError(f"run at most {_LONGEST_RUN_S} s at a time")
        if self._library.board_run(self._board, round(time_s * CLOCK_HZ)) != 0:
            raise DeviceError(f"the firmware crashed at {self.now_s():.6f} s of simulated time")

    def write_bytes(self, data: bytes) -> int:
        """Put bytes on the line to the board; return how many its queue of 4096 took."""
        return int(self._library.board_give(self._board, data, len(data)))

    def read_bytes(self) -> bytes:
        """Return the bytes that the board has sent since the last call."""
        return self.read_timed()[0]

    def read_timed(self) -> tuple[bytes, NDArray[np.float64]]:
        """Return those bytes, and when each was through, seconds, shape (n_bytes,)."""
        size = self._library.board_take(
            self._board, self._bytes.ctypes.data, self._cycles.ctypes.data
        )
        return self._bytes[:size].tobytes(), self._cycles[:size] / CLOCK_HZ

    def set_pixels_mv(self, voltages_mv: ArrayLike, *, over_s: float = 0.0) -> None:
        """Move the divider's output to new values, in a straight line over `over_s`.

        Parameters
        ----------
        voltages_mv : array_like, shape (rows, cols), at most 16 x 16
            What the converter sees with each row and column selected; the rest sees 0.
        over_s : float
            0 is at once.
        """
        wanted = np.asarray(voltages_mv, dtype=np.float32)
        pixels = np.zeros((_SIDE, _SIDE), dtype=np.float32)
        pixels[: wanted.shape[0], : wanted.shape[1]] = wanted
        arrival = round((self.now_s() + over_s) * CLOCK_HZ)
        self._library.board_set_pixels(self._board, pixels.ctypes.data, arrival)

    def set_noise_mv(self, noise_mv: float) -> None:
        """Set the standard deviation of the converter's noise."""
        self._library.board_set_noise_mv(self._board, noise_mv)

    def set_load(self, index: int, raw: int) -> None:
        """Set what load cell `index` (0 or 1) reads from now on; before, it is absent."""
        self._library.board_set_load(self._board, index, raw)

    def reset(self) -> None:
        """Press the reset button."""
        self._library.board_reset(self._board)

    def hang(self) -> None:
        """Make the program hang where it is; interrupts go on."""
        self._library.board_hang(self._board)

    @property
    def conversions(self) -> int:
        """Conversions of pixels so far."""
        return int(self._library.board_conversions(self._board))

    @property
    def misrouted(self) -> int:
        """Conversions at which multiplexer and direct row lines disagreed."""
        return int(self._library.board_misrouted(self._board))

    @property
    def output_kpa(self) -> float:
        """What the pulse output asks of the regulator now."""
        return float(50.0 * self._library.board_output_duty(self._board))

    @property
    def pressure_kpa(self) -> float:
        """What the regulator gives now."""
        return float(50.0 * self._library.board_pressure(self._board))

    @property
    def safe_line(self) -> bool:
        """Level of the safe line."""
        return bool(self._library.board_safe_line(self._board))

    def close(self) -> None:
        """Switch it off; calling it again does nothing."""
        if self._board:
            self._library.board_close(self._board)
            self._board = None
