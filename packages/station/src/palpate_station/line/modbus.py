"""Serve the register map of a station over Modbus TCP (docs: Connect a packhouse)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from typing import Any

from palpate.errors import InputError, require_extra
from palpate_station.line.machine import CommandRefusedError, Machine, line_state
from palpate_station.line.results import (
    NO_ITEM,
    OUTCOME_NUMBERS,
    list_held,
    list_measurements,
    list_reference,
)

with require_extra("--modbus", extra="line", package="palpate-station"):
    from pymodbus.constants import ExcCodes
    from pymodbus.server import ModbusTcpServer
    from pymodbus.server.requesthandler import ServerRequestHandler
    from pymodbus.simulator import DataType, SimData, SimDevice

#: Driver name of the client whose request is being answered: the protocol and its address.
_CLIENT = ContextVar("_CLIENT", default="Modbus")
#: Zero-based addresses of 16-bit registers; longer values are stored high word first.
STATE, FLAGS, STOPS, RESULTS, OUTCOME, STORAGE, VALUES = 0, 1, 2, 4, 6, 7, 8
AGAIN, HELD_AGAIN, HELD_VALUES, REFERENCE, HELD_REFERENCE = 38, 39, 40, 70, 76
ITEM, BIN, REFUSAL, HELD_BIN, DRIVER = 100, 140, 180, 220, 260
COMMAND, TARGET, KNOWN_STOPS, NEW_ITEM, INTERRUPTED_ITEM, NEW_BATCH = 300, 301, 302, 310, 350, 390
#: Number of registers of a text (two bytes of UTF-8 each, zero-padded) and of the whole map.
TEXT_REGISTERS, REGISTER_COUNT = 40, 430
#: Texts of an order.
_ORDER = (NEW_ITEM, NEW_BATCH)
#: Registers that a client may write; the others read 0 there.
_WRITABLE = frozenset((COMMAND, TARGET, KNOWN_STOPS, KNOWN_STOPS + 1)).union(
    *(range(text, text + TEXT_REGISTERS) for text in _ORDER)
)
#: Functions of coils and discrete inputs, which the station does not have.
_BIT_FUNCTIONS = (1, 2, 5, 15)
#: Values for the register `COMMAND`.
GRASP, RELEASE, STOP, TAKE_OVER, LEAVE = 1, 2, 3, 4, 5
#: Values of the register `STORAGE`; 0 means no grasp yet.
STORED, WITHOUT_ITEM, STORE_FAILED = 1, 2, 3
#: Value of `KNOWN_STOPS` that disables the comparison of the stop count.
ANY_STOPS = 0xFFFFFFFF


class _Handler(ServerRequestHandler):
    """One connection, which notes its client for the answers."""

    async def handle_request(self) -> None:
        peer = self.transport.get_extra_info("peername")
        _CLIENT.set(f"Modbus {peer[0]}" if peer else "Modbus")
        await super().handle_request()  # type: ignore[no-untyped-call]


class _Server(ModbusTcpServer):
    def callback_new_connection(self) -> _Handler:
        traces = self.trace_packet, self.trace_pdu, self.trace_connect
        return _Handler(self, *traces)  # type: ignore[no-untyped-call]


class ModbusStation:
    """Modbus TCP server of a machine.

    `machine`: its methods are called on the event loop that runs `start`.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine, self._refusal = machine, ""
        self._server: ModbusTcpServer | None = None
        #: Written values, by address.
        self._written = dict.fromkeys(sorted(_WRITABLE), 0)
        self._written[KNOWN_STOPS] = self._written[KNOWN_STOPS + 1] = 0xFFFF

    async def start(self, host: str, port: int) -> int:
        """Start listening and return the port; port 0 selects a free port."""
        data = SimData(0, values=[0] * REGISTER_COUNT, datatype=DataType.REGISTERS)
        device = SimDevice(id=0, simdata=[data], action=self._access)
        self._server = _Server(device, address=(host, port))
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
        self._machine.renew(_CLIENT.get())
        if function_code in _BIT_FUNCTIONS:
            return ExcCodes.ILLEGAL_FUNCTION
        if set_values is None:
            registers[:] = self.registers()[start_address : start_address + len(registers)]
            return None
        written = range(address, address + count)
        values = dict(zip(written, set_values, strict=True))
        # A block of all parameters contains the registers without a meaning, as zeros.
        stray = (value for at, value in values.items() if at not in _WRITABLE)
        if address < COMMAND or _WRITABLE.isdisjoint(written) or any(stray):
            return ExcCodes.ILLEGAL_ADDRESS
        self._written |= {at: value for at, value in values.items() if at in _WRITABLE}
        for text in _ORDER:
            if text in written:
                # The rest of a longer text would become part of the new one.
                self._clear(range(written.stop, text + TEXT_REGISTERS))
        if address > COMMAND:
            return None
        try:
            await self._run_command(self._written[COMMAND])
        except CommandRefusedError as error:
            self._refusal = str(error)
            return ExcCodes.DEVICE_BUSY
        except InputError as error:
            self._refusal = str(error)
            return ExcCodes.ILLEGAL_VALUE
        self._refusal = ""
        return None

    async def _run_command(self, command: int) -> None:
        machine, client = self._machine, _CLIENT.get()
        if command == GRASP:
            stops = self._written[KNOWN_STOPS] << 16 | self._written[KNOWN_STOPS + 1]
            target = self._written[TARGET]
            item, batch = (
                decode_text([self._written[text + at] for at in range(TEXT_REGISTERS)], what=what)
                for text, what in zip(_ORDER, ("item", "batch"), strict=True)
            )
            await machine.grasp(
                client,
                target_force_n=target / 100.0 if target else None,
                item_id=item,
                kind="",
                stops=None if stops == ANY_STOPS else stops,
                batch=batch,
            )
            # Each item is grasped once per write, so that a controller that repeats the command
            # never stores the next object under the name of the previous one.
            for text in _ORDER:
                self._clear(range(text, text + TEXT_REGISTERS))
        elif command == RELEASE:
            await machine.release(client)
        elif command == STOP:
            if not await machine.stop(client):
                raise CommandRefusedError(
                    "the devices did not confirm the stop; use the emergency stop"
                )
        elif command == TAKE_OVER:
            await machine.take_over(client)
        elif command == LEAVE:
            await machine.leave(client)
        else:
            raise InputError(f"command {command}: use a number from 1 to 5")

    def _clear(self, places: range) -> None:
        self._written |= dict.fromkeys(places, 0)

    def registers(self) -> list[int]:
        """Return the current values of all registers."""
        state = self._machine.state()
        number, result = self._machine.result()
        found = [0] * REGISTER_COUNT
        found[STATE] = line_state(state)
        found[FLAGS] = _flags(state)
        found[STOPS : STOPS + 2] = _split_uint32(int(state["stops"]))
        found[RESULTS : RESULTS + 2] = _split_uint32(number)
        held = state["held"]
        for place, values in (
            (VALUES, list_measurements(result)),
            (HELD_VALUES, list_held(held)),
            (REFERENCE, list_reference(None if result is None else result.reference)),
            (HELD_REFERENCE, list_reference(held and held["reference"])),
        ):
            packed = struct.unpack(f">{2 * len(values)}H", struct.pack(f">{len(values)}f", *values))
            found[place : place + len(packed)] = packed
        texts = {REFUSAL: self._refusal, DRIVER: state["driver_name"] or ""}
        if (interrupted := state["interrupted"]) is not None:
            found[FLAGS] |= 1 << 5
            texts[INTERRUPTED_ITEM] = interrupted["item_id"]
        if held is not None:
            found[HELD_AGAIN] = int(held["again"])
            texts[HELD_BIN] = held["bin"] or ""
        if result is not None:
            found[FLAGS] |= result.needs_regrasp << 4
            found[AGAIN] = int(result.needs_regrasp)
            found[STORAGE] = _storage(result.not_stored)
            found[OUTCOME] = OUTCOME_NUMBERS[result.result.outcome]
            texts |= {ITEM: result.item_id, BIN: result.bin_name}
        for place, text in texts.items():
            found[place : place + TEXT_REGISTERS] = encode_text(text)
        for at, value in self._written.items():
            found[at] = value
        return found


def encode_text(text: str) -> list[int]:
    """Encode a text as UTF-8 in registers; a long text ends after its last complete character.

    >>> encode_text("A1")[:2]
    [16689, 0]
    """
    size = 2 * TEXT_REGISTERS
    raw = text.encode()[:size].decode(errors="ignore").encode().ljust(size, b"\0")
    return list(struct.unpack(f">{TEXT_REGISTERS}H", raw))


def decode_text(registers: Sequence[int], *, what: str = "item") -> str:
    """Decode the text in registers, without the zero bytes after it.

    `what`: named in errors.
    Raises `InputError` if the text is not UTF-8, or a zero byte is within it.

    >>> decode_text(encode_text("Früchte-1"))
    'Früchte-1'
    """
    raw = struct.pack(f">{len(registers)}H", *registers).rstrip(b"\0")
    if b"\0" in raw:
        raise InputError(
            f"{what} {raw.split(bytes(1), 1)[0].decode(errors='replace')!r}: a zero byte is "
            "followed by more text; write the first character into the high byte of a register, "
            "and pad with zeros"
        )
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{what}: the bytes are not UTF-8 ({error})") from error


def _storage(not_stored: str) -> int:
    if not not_stored:
        return STORED
    return WITHOUT_ITEM if not_stored == NO_ITEM else STORE_FAILED


def _flags(state: Mapping[str, Any]) -> int:
    bits = (state["fresh"], state["hand_open"], state["driver"], state["simulated"])
    return sum(bool(bit) << place for place, bit in enumerate(bits))


def _split_uint32(number: int) -> list[int]:
    return [number >> 16 & 0xFFFF, number & 0xFFFF]
