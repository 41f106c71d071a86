"""The real firmware on the AVR simulator, with pins and serial line controlled from Python.

Requires the images built with `make -C firmware` and `make -C firmware/sim`. The program is that of
the board; all its inputs are simulated.
"""

from __future__ import annotations

import ctypes
import os
import select
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import DeviceError, DeviceNotFoundError
from palpate.firmware_image import BOARDS, IMAGES
from palpate.gripper.hobby_servo import ServoTravel
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.serial_array import SerialArray
from palpate.twin.line_end import open_terminal
from palpate.twin.stage import Stage

CLOCK_HZ = 16_000_000
BUILD = Path(__file__).resolve().parents[3] / "firmware" / "build"
_SIDE = 16
_OUT_BYTES = 1 << 20
_PULSES = 4096
#: Maximum simulated time per call, seconds: the output must fit the buffer of 1 MB.
_LONGEST_RUN_S = 1.0

_SIGNATURES: dict[str, tuple[object, list[object]]] = {
    "board_open": (
        ctypes.c_void_p,
        [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint32, ctypes.c_uint64],
    ),
    "board_load_boot": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p]),
    "board_close": (None, [ctypes.c_void_p]),
    "board_run": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_uint64]),
    "board_cycle": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_conversions": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_misrouted": (ctypes.c_uint64, [ctypes.c_void_p]),
    "board_output_duty": (ctypes.c_double, [ctypes.c_void_p]),
    "board_pressure": (ctypes.c_double, [ctypes.c_void_p]),
    "board_safe_line": (ctypes.c_int, [ctypes.c_void_p]),
    "board_safe_edges": (ctypes.c_uint32, [ctypes.c_void_p]),
    "board_reset": (None, [ctypes.c_void_p]),
    "board_hang": (None, [ctypes.c_void_p]),
    "board_set_memory": (None, [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32]),
    "board_set_noise_mv": (None, [ctypes.c_void_p, ctypes.c_float]),
    "board_set_pixels": (None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint64]),
    "board_set_load": (None, [ctypes.c_void_p, ctypes.c_int, ctypes.c_int32]),
    "board_give": (ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32]),
    "board_take_pulses": (ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
    "board_take": (ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
}

#: Update interval of the pixels' voltages, seconds; a scan of 8 pixels takes 1 ms.
_STEP_S = 0.004
#: MG996R data sheet at 4.8 V: dead band 5 us, 60 degrees in 0.17 s; 500 to 2500 us are 180 degrees.
_SERVO_DEAD_US, _SERVO_US_PER_S = 5.0, 667 / 0.17
#: Timeout for bytes through a pseudo-terminal, which the kernel normally passes at once.
_KERNEL_S = 5.0
_CHUNK = 1024


def _load_library() -> ctypes.CDLL:
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
    """An Arduino that runs an image; time passes only in `run_until`.

    `board`: mega2560, uno or nano.
    `baud`: speed of the serial line, for which the image was built.
    `seed`: seed of the converter's noise.
    `bootloader`: Intel hex file of the bootloader in which the board starts; none by default.
    Raises `DeviceNotFoundError` if the simulator or the image has not been built.
    """

    def __init__(
        self,
        board: str = "mega2560",
        *,
        baud: int = 1_000_000,
        seed: int = 0,
        bootloader: Path | None = None,
    ) -> None:
        self._board: int | None = None
        self._library = _load_library()
        path = BUILD / IMAGES[board, baud].replace(".hex", ".elf")
        if not path.is_file():
            raise DeviceNotFoundError(
                f"no firmware image at {path}: install gcc-avr, avr-libc and binutils-avr, then "
                "run `make -C firmware`"
            )
        chip = BOARDS[board].chip.encode()
        self._board = self._library.board_open(chip, str(path).encode(), baud, seed)
        if not self._board:
            raise DeviceNotFoundError(f"{path} is not a valid image; run `make -C firmware` again")
        if bootloader is not None:
            self._load_bootloader(bootloader)
        self._bytes = np.empty(_OUT_BYTES, dtype=np.uint8)
        self._cycles = np.empty(_OUT_BYTES, dtype=np.uint64)
        self._pulse_cycles = np.empty(_PULSES, dtype=np.uint64)
        self._pulse_lengths = np.empty(_PULSES, dtype=np.uint32)

    def _load_bootloader(self, path: Path) -> None:
        try:
            lines = path.read_text(encoding="ascii").splitlines(keepends=True)
        except (OSError, UnicodeDecodeError) as error:
            raise DeviceNotFoundError(f"{path}: {error}") from error
        # The simulator's reader refuses start addresses (record types 3 and 5).
        readable = [line for line in lines if line[7:9] not in ("03", "05")]
        with NamedTemporaryFile("w", suffix=".hex") as file:
            file.writelines(readable)
            file.flush()
            if self._library.board_load_boot(self._board, file.name.encode()):
                raise DeviceNotFoundError(f"{path} is not a bootloader in Intel hex format")

    def now_s(self) -> float:
        """Return the simulated time since power-up, seconds."""
        return float(self._library.board_cycle(self._board)) / CLOCK_HZ

    def run_until(self, time_s: float) -> None:
        """Run the program up to `time_s`, at most one second ahead; its output is buffered.

        Raises `ValueError` if `time_s` is more than a second ahead; `DeviceError` if the program
        has crashed.
        """
        if time_s > self.now_s() + _LONGEST_RUN_S:
            raise ValueError(f"run at most {_LONGEST_RUN_S} s at a time")
        if self._library.board_run(self._board, round(time_s * CLOCK_HZ)) != 0:
            raise DeviceError(f"the firmware crashed at {self.now_s():.6f} s of simulated time")

    def write_bytes(self, data: bytes) -> int:
        """Send bytes to the board; return the number accepted by its 4096-byte queue."""
        return int(self._library.board_give(self._board, data, len(data)))

    def read_bytes(self) -> bytes:
        """Return the bytes sent by the board since the last call."""
        return self.read_bytes_with_times()[0]

    def read_bytes_with_times(self) -> tuple[bytes, NDArray[np.float64]]:
        """Return the bytes since the last call and their completion times, seconds."""
        size = self._library.board_take(
            self._board, self._bytes.ctypes.data, self._cycles.ctypes.data
        )
        return self._bytes[:size].tobytes(), self._cycles[:size] / CLOCK_HZ

    def set_pixels_mv(self, voltages_mv: ArrayLike) -> None:
        """Set the output of the divider.

        `voltages_mv`, shape (rows, cols): input of the converter for each selected row and column;
            0 elsewhere.
        """
        wanted = np.asarray(voltages_mv, dtype=np.float32)
        pixels = np.zeros((_SIDE, _SIDE), dtype=np.float32)
        pixels[: wanted.shape[0], : wanted.shape[1]] = wanted
        now = self._library.board_cycle(self._board)
        self._library.board_set_pixels(self._board, pixels.ctypes.data, now)

    def set_noise_mv(self, noise_mv: float) -> None:
        """Set the standard deviation of the converter's noise."""
        self._library.board_set_noise_mv(self._board, noise_mv)

    def set_load(self, index: int, raw: int) -> None:
        """Set the reading of load cell `index` (0 or 1); the cell is absent before."""
        self._library.board_set_load(self._board, index, raw)

    def reset(self) -> None:
        """Press the reset button."""
        self._library.board_reset(self._board)

    def hang(self) -> None:
        """Make the program hang; interrupts continue."""
        self._library.board_hang(self._board)

    def set_memory(self, address: int, value: int) -> None:
        """Set a 32-bit variable of the program."""
        self._library.board_set_memory(self._board, address, value)

    def read_pulses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return start times (s) and widths (us) of the servo pulses since the last call."""
        count = self._library.board_take_pulses(
            self._board, self._pulse_cycles.ctypes.data, self._pulse_lengths.ctypes.data
        )
        lengths = self._pulse_lengths[:count].astype(np.float64)
        return self._pulse_cycles[:count] / CLOCK_HZ, lengths * (1e6 / CLOCK_HZ)

    @property
    def conversions(self) -> int:
        """Number of pixel conversions so far."""
        return int(self._library.board_conversions(self._board))

    @property
    def misroute_count(self) -> int:
        """Conversions at which multiplexer and direct row lines disagreed."""
        return int(self._library.board_misrouted(self._board))

    @property
    def output_kpa(self) -> float:
        """The present setpoint of the regulator from the pulse output."""
        return float(50.0 * self._library.board_output_duty(self._board))

    @property
    def pressure_kpa(self) -> float:
        """The regulator's present output."""
        return float(50.0 * self._library.board_pressure(self._board))

    @property
    def safe_line(self) -> bool:
        """Level of the safe line."""
        return bool(self._library.board_safe_line(self._board))

    @property
    def safe_line_edges(self) -> int:
        """Changes of the safe line's level so far."""
        return int(self._library.board_safe_edges(self._board))

    def close(self) -> None:
        """Switch the board off; further calls have no effect."""
        if self._board:
            self._library.board_close(self._board)
            self._board = None


class BoardOnStage:
    """A board that scans the pixels of a world, and moves its fingers with a hobby servo.

    `world`: source of the voltages; the board is powered up at the world's present time and runs
        before the world advances.
    `board`: a new board, which is closed with this object.
    `travel`: travel of a hobby servo that moves the world's fingers with the board's pulses, or
        None.
    """

    def __init__(
        self, world: Stage, *, board: FirmwareBoard, travel: ServoTravel | None = None
    ) -> None:
        self._world, self._board = world, board
        self._travel, self._servo_us = travel, 0.0
        self._power_up_s = world.clock.now_s()
        self._stepped_s = -1.0
        self._is_running = False
        self._backlog = bytearray()
        world.watchers.append(self.run_until)

    def run_until(self, time_s: float) -> None:
        """Run the board up to a time of the world."""
        # Reading the world's voltages calls its watchers, including this method.
        if self._is_running:
            return
        self._is_running = True
        try:
            while self._stepped_s + _STEP_S <= time_s:
                self._stepped_s = max(self._stepped_s + _STEP_S, self._power_up_s)
                self._run_board_until(self._stepped_s)
                if self._travel is not None:
                    self._turn_servo(self._travel)
                self._board.set_pixels_mv(1e3 * self._world.pixel_voltage_v(self._stepped_s))
            self._run_board_until(time_s)
        finally:
            self._is_running = False

    def take_output(self) -> bytes:
        """Return the bytes sent by the board since the last call."""
        sent, self._backlog = bytes(self._backlog), bytearray()
        return sent

    def give(self, data: bytes) -> None:
        """Send bytes to the board."""
        self._board.write_bytes(data)

    def close(self) -> None:
        """Switch the board off."""
        self._world.watchers.remove(self.run_until)
        self._board.close()

    def _turn_servo(self, travel: ServoTravel) -> None:
        """Apply the latest servo pulse to the fingers if the safe line is high."""
        _, width_us = self._board.read_pulses()
        if not self._board.safe_line:
            self._servo_us = 0.0
        elif width_us.size and abs(width_us[-1] - self._servo_us) > _SERVO_DEAD_US / 2:
            self._servo_us = float(width_us[-1])
            rate = _SERVO_US_PER_S * travel.mm_per_us
            width_mm = travel.width_mm(self._servo_us)
            self._world.drive(width_mm, rate=rate, time_s=self._stepped_s)

    def _run_board_until(self, time_s: float) -> None:
        self._board.run_until(time_s - self._power_up_s)
        self._backlog += self._board.read_bytes()


class FirmwareStream:
    """A `ByteStream` to a simulated board that reads the pixels of a world.

    Bytes pass through a real pseudo-terminal and pyserial. Each call runs the board up to the
    world's clock and waits until the kernel has transferred every byte, so runs are reproducible.

    `world`, `board`, `travel`: as in `BoardOnStage`.
    """

    def __init__(
        self, world: Stage, *, board: FirmwareBoard, travel: ServoTravel | None = None
    ) -> None:
        self._clock = world.clock
        self._board = BoardOnStage(world, board=board, travel=travel)
        self._master, slave, self.name = open_terminal()
        self._host = SerialStream(self.name)
        self._slave = slave
        self._open = True

    def read_waiting(self) -> bytes:
        """Return all bytes sent by the board so far."""
        self._board.run_until(self._clock.now_s())
        waiting, received = self._board.take_output(), bytearray()
        for begin in range(0, len(waiting), _CHUNK):
            part = waiting[begin : begin + _CHUNK]
            os.write(self._master, part)
            wanted = len(received) + len(part)
            while len(received) < wanted:
                self._wait_for(self._slave)
                received += self._host.read_waiting()
        return bytes(received)

    def write(self, data: bytes) -> None:
        """Send `data` to the board at the speed of the serial line."""
        self._board.run_until(self._clock.now_s())
        self._host.write(data)
        left = len(data)
        while left:
            self._wait_for(self._master)
            part = os.read(self._master, left)
            self._board.give(part)
            left -= len(part)

    def close(self) -> None:
        """Switch the board off and close the terminal; further calls have no effect."""
        if not self._open:
            return
        self._open = False
        self._host.close()
        os.close(self._slave)
        os.close(self._master)
        self._board.close()

    def _wait_for(self, terminal: int) -> None:
        if not select.select([terminal], [], [], _KERNEL_S)[0]:
            raise DeviceError(f"{self.name}: the kernel transferred no bytes in {_KERNEL_S:g} s")


def open_firmware_array(world: Stage, *, noise_mv: float, rate_hz: float) -> SerialArray:
    """Return the serial array of a board that scans the world's pixels.

    `world`: its clock is advanced while the array waits, as with `TwinArray`.
    `noise_mv`: standard deviation of the converter's noise.
    Raises `DeviceNotFoundError` if the firmware or the simulator has not been built; the message
    names the packages to install. Raises `DeviceError` if the firmware doesn't support the rate.
    """
    board = FirmwareBoard(seed=world.seed)
    board.set_noise_mv(noise_mv)
    stream = FirmwareStream(world, board=board)
    return SerialArray(
        stream,
        clock=world.clock,
        layout=world.layout,
        rate_hz=rate_hz,
        oversampling=world.oversampling,
    )
