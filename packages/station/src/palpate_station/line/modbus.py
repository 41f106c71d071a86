"""Serve the register map of a station over Modbus TCP (docs: Connect a packhouse)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from palpate.errors import InputError, require_extra
from palpate_station.line.machine import CommandRefusedError, Machine, line_state
from palpate_station.line.results import (
    NO_ITEM,
    OUTCOME_NUMBERS,
    list_measurements,
)

with require_extra("--modbus", extra="line", package="palpate-station"):
    from pymodbus.constants import ExcCodes
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

#: Driver name of this protocol.
DRIVER = "modbus"
#: Zero-based addresses of 16-bit registers; longer values are stored high word first.
STATE, FLAGS, STOPS, RESULTS, OUTCOME, STORAGE, VALUES = 0, 1, 2, 4, 6, 7, 8
ITEM, BIN, REFUSAL = 100, 140, 180
COMMAND, TARGET, KNOWN_STOPS, NEW_ITEM = 300, 301, 302, 310
#: Number of registers of a text (two ASCII characters each, zero-padded) and of the whole map.
TEXT_REGISTERS, REGISTER_COUNT = 40, 350
#: Values for the register `COMMAND`.
GRASP, RELEASE, STOP, TAKE_OVER, LEAVE = 1, 2, 3, 4, 5
#: Values of the register `STORAGE`; 0 means no grasp yet.
STORED, WITHOUT_ITEM, STORE_FAILED = 1, 2, 3
#: Value of `KNOWN_STOPS` that disables the comparison of the stop count.
ANY_STOPS = 0xFFFFFFFF


class ModbusStation:
    """Modbus TCP server of a machine.

    `machine`: its methods are called on the event loop that runs `start`.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine, self._refusal = machine, ""
        self._server: ModbusTcpServer | None = None
        self._written = [0] * (REGISTER_COUNT - COMMAND)
        self._written[KNOWN_STOPS - COMMAND : KNOWN_STOPS - COMMAND + 2] = [0xFFFF, 0xFFFF]

    async def start(self, host: str, port: int) -> int:
        """Start listening and return the port; port 0 selects a free port."""
        data = SimData(0, values=[0] * REGISTER_COUNT, datatype=DataType.REGISTERS)
        device = SimDevice(id=0, simdata=[data], action=self._access)
        self._server = ModbusTcpServer(device, address=(host, port))
        await self._server.serve_forever(background=True)
        listening: Any = self._server.transport
        return int(listening.sockets[0].getsockname()[1])

    async def refresh(self) -> None:
        """Do nothing, because registers are computed when a client reads them."""

    async def close(self) -> None:
        """Close every connection."""
        if self._server is not None:
            await self._server.shutdown()

    async def _access(
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        registers: list[int],
        set_values: Sequence[int] | None,
    ) -> ExcCodes | None:
        """Answer one request; called by pymodbus before a read and after a write."""
        if set_values is None:
            registers[:] = self.registers()[start_address : start_address + len(registers)]
            return None
        if not (address >= COMMAND and address + count <= REGISTER_COUNT):
            return ExcCodes.ILLEGAL_ADDRESS
        self._written[address - COMMAND : address - COMMAND + count] = list(set_values)
        if address > COMMAND:
            return None
        try:
            await self._run_command(self._written[0])
        except CommandRefusedError as error:
            self._refusal = str(error)
            return ExcCodes.DEVICE_BUSY
        except (InputError, UnicodeDecodeError) as error:
            self._refusal = str(error)
            return ExcCodes.ILLEGAL_VALUE
        self._refusal = ""
        return None

    async def _run_command(self, command: int) -> None:
        machine = self._machine
        if command == GRASP:
            stops = _join_uint32(self._written, KNOWN_STOPS - COMMAND)
            item = self._written[NEW_ITEM - COMMAND : NEW_ITEM - COMMAND + TEXT_REGISTERS]
            target = self._written[TARGET - COMMAND]
            await machine.grasp(
                DRIVER,
                target_force_n=target / 100.0 if target else None,
                item_id=decode_text(item),
                kind="",
                stops=None if stops == ANY_STOPS else stops,
            )
            # Each item is grasped once per write, so that a controller that repeats the command
            # never stores the next object under the name of the previous one.
            self._written[NEW_ITEM - COMMAND :] = [0] * TEXT_REGISTERS
        elif command == RELEASE:
            await machine.release(DRIVER)
        elif command == STOP:
            if not await machine.stop():
                raise CommandRefusedError(
                    "the devices did not confirm the stop; use the emergency stop"
                )
        elif command == TAKE_OVER:
            await machine.take_over(DRIVER)
        elif command == LEAVE:
            await machine.leave(DRIVER)
        else:
            raise InputError(f"command {command}: use a number from 1 to 5")

    def registers(self) -> list[int]:
        """Return the current values of all registers."""
        state = self._machine.state()
        number, result = self._machine.result()
        found = [0] * REGISTER_COUNT
        found[STATE] = line_state(state)
        found[FLAGS] = _flags(state)
        found[STOPS : STOPS + 2] = _split_uint32(int(state["stops"]))
        found[RESULTS : RESULTS + 2] = _split_uint32(number)
        values = list_measurements(result)
        packed = struct.unpack(f">{2 * len(values)}H", struct.pack(f">{len(values)}f", *values))
        found[VALUES : VALUES + len(packed)] = packed
        if result is not None:
            found[FLAGS] |= result.needs_regrasp << 4
            found[STORAGE] = _storage(result.not_stored)
            found[OUTCOME] = OUTCOME_NUMBERS[result.result.outcome]
            for place, text in ((ITEM, result.item_id), (BIN, result.bin_name)):
                found[place : place + TEXT_REGISTERS] = encode_text(text)
        found[REFUSAL : REFUSAL + TEXT_REGISTERS] = encode_text(self._refusal)
        found[COMMAND:REGISTER_COUNT] = self._written
        return found


def encode_text(text: str) -> list[int]:
    """Encode a text as registers: non-ASCII characters become `?`, long texts are truncated.

    >>> encode_text("A1")[:2]
    [16689, 0]
    """
    raw = text.encode("ascii", "replace")[: 2 * TEXT_REGISTERS].ljust(2 * TEXT_REGISTERS, b"\0")
    return list(struct.unpack(f">{TEXT_REGISTERS}H", raw))


def decode_text(registers: Sequence[int]) -> str:
    """Decode the text in registers up to the first zero byte.

    Raises `UnicodeDecodeError` if the text is not ASCII.

    >>> decode_text(encode_text("A1"))
    'A1'
    """
    raw = struct.pack(f">{len(registers)}H", *registers)
    return raw.split(b"\0", 1)[0].decode("ascii")


def _storage(not_stored: str) -> int:
    if not not_stored:
        return STORED
    return WITHOUT_ITEM if not_stored == NO_ITEM else STORE_FAILED


def _flags(state: Mapping[str, Any]) -> int:
    bits = (state["fresh"], state["hand_open"], state["driver"], state["simulated"])
    return sum(bool(bit) << place for place, bit in enumerate(bits))


def _split_uint32(number: int) -> list[int]:
    return [number >> 16 & 0xFFFF, number & 0xFFFF]


def _join_uint32(registers: Sequence[int], at: int) -> int:
    return registers[at] << 16 | registers[at + 1]
