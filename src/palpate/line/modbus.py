"""Modbus TCP: the register map of a station (docs: Connect a packhouse)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from palpate.errors import InputError, require_extra
from palpate.line.machine import CommandRefusedError, Machine, line_state
from palpate.line.results import (
    OUTCOME_NUMBERS,
    bin_of,
    item_of,
    list_measurements,
)

with require_extra("--modbus", extra="line"):
    from pymodbus.constants import ExcCodes
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

#: How this protocol is named among those who drive.
DRIVER = "modbus"
#: Addresses, zero-based; every register holds 16 bits, longer values have the high word first.
STATE, FLAGS, STOPS, RESULTS, OUTCOME, VALUES = 0, 1, 2, 4, 6, 8
ITEM, BIN, REFUSAL = 100, 140, 180
COMMAND, TARGET, KNOWN_STOPS, NEW_ITEM = 300, 301, 302, 310
#: Registers of a text (two letters each, ASCII, filled with zeros), and of the whole map.
TEXT_REGISTERS, END = 40, 350
#: Commands that are written to `COMMAND`.
GRASP, RELEASE, STOP, TAKE_OVER, LEAVE = 1, 2, 3, 4, 5
#: In `KNOWN_STOPS`: the sender doesn't compare.
ANY_STOPS = 0xFFFFFFFF


class ModbusStation:
    """Serves the registers of a machine.

    `machine`: called on the event loop that `start` runs on.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine, self._refusal = machine, ""
        self._server: ModbusTcpServer | None = None
        self._written = [0] * (END - COMMAND)
        self._written[KNOWN_STOPS - COMMAND : KNOWN_STOPS - COMMAND + 2] = [0xFFFF, 0xFFFF]

    async def start(self, host: str, port: int) -> int:
        """Listen; return the port, which 0 lets the system choose."""
        data = SimData(0, values=[0] * END, datatype=DataType.REGISTERS)
        device = SimDevice(id=0, simdata=[data], action=self._access)
        self._server = ModbusTcpServer(device, address=(host, port))
        await self._server.serve_forever(background=True)
        listening: Any = self._server.transport
        return int(listening.sockets[0].getsockname()[1])

    async def refresh(self) -> None:
        """Do nothing: registers are made when they are read."""

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
        """Answer one request.

        The server calls it before a read and after a write.
        """
        if set_values is None:
            registers[:] = self.registers()[start_address : start_address + len(registers)]
            return None
        if not (address >= COMMAND and address + count <= END):
            return ExcCodes.ILLEGAL_ADDRESS
        self._written[address - COMMAND : address - COMMAND + count] = list(set_values)
        if address > COMMAND:
            return None
        try:
            await self._obey(self._written[0])
        except CommandRefusedError as error:
            self._refusal = str(error)
            return ExcCodes.DEVICE_BUSY
        except (InputError, UnicodeDecodeError) as error:
            self._refusal = str(error)
            return ExcCodes.ILLEGAL_VALUE
        self._refusal = ""
        return None

    async def _obey(self, command: int) -> None:
        machine = self._machine
        if command == GRASP:
            stops = _long(self._written, KNOWN_STOPS - COMMAND)
            item = self._written[NEW_ITEM - COMMAND : NEW_ITEM - COMMAND + TEXT_REGISTERS]
            target = self._written[TARGET - COMMAND]
            await machine.grasp(
                DRIVER,
                target_force_n=target / 100.0 if target else None,
                item_id=text_of(item),
                kind="",
                stops=None if stops == ANY_STOPS else stops,
            )
        elif command == RELEASE:
            await machine.release(DRIVER)
        elif command == STOP:
            if not await machine.stop():
                raise CommandRefusedError("the stop was not confirmed: use the emergency stop")
        elif command == TAKE_OVER:
            await machine.take_over(DRIVER)
        elif command == LEAVE:
            await machine.leave(DRIVER)
        else:
            raise InputError(f"command {command}: there are 1 to 5")

    def registers(self) -> list[int]:
        """Return the whole map as it is now."""
        state = self._machine.state()
        number, result = self._machine.result()
        found = [0] * END
        found[STATE] = line_state(state)
        found[FLAGS] = _flags(state)
        found[STOPS : STOPS + 2] = _words(int(state["stops"]))
        found[RESULTS : RESULTS + 2] = _words(number)
        found[OUTCOME] = 0 if result is None else OUTCOME_NUMBERS[str(result["outcome"])]
        values = list_measurements(result)
        packed = struct.unpack(f">{2 * len(values)}H", struct.pack(f">{len(values)}f", *values))
        found[VALUES : VALUES + len(packed)] = packed
        for place, text in ((ITEM, item_of(result)), (BIN, bin_of(result))):
            found[place : place + TEXT_REGISTERS] = text_registers(text)
        found[REFUSAL : REFUSAL + TEXT_REGISTERS] = text_registers(self._refusal)
        found[COMMAND:END] = self._written
        return found


def text_registers(text: str) -> list[int]:
    """Return a text as registers; letters beyond ASCII become `?`, and the end is cut.

    >>> text_registers("A1")[:2]
    [16689, 0]
    """
    raw = text.encode("ascii", "replace")[: 2 * TEXT_REGISTERS].ljust(2 * TEXT_REGISTERS, b"\0")
    return list(struct.unpack(f">{TEXT_REGISTERS}H", raw))


def text_of(registers: Sequence[int]) -> str:
    """Return the text in registers, up to the first zero.

    Raises `UnicodeDecodeError` if it is not ASCII.

    >>> text_of(text_registers("A1"))
    'A1'
    """
    raw = struct.pack(f">{len(registers)}H", *registers)
    return raw.split(b"\0", 1)[0].decode("ascii")


def _flags(state: Mapping[str, Any]) -> int:
    bits = (state["fresh"], state["hand_open"], state["driver"], state["simulated"])
    return sum(bool(bit) << place for place, bit in enumerate(bits))


def _words(number: int) -> list[int]:
    return [number >> 16 & 0xFFFF, number & 0xFFFF]


def _long(registers: Sequence[int], at: int) -> int:
    return registers[at] << 16 | registers[at + 1]
