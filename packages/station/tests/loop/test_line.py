"""OPC UA and Modbus clients of `palpate serve` on the twin."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import struct
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from asyncua import Client, ua
from packages.station.tests.epcis import read_epcis
from packages.station.tests.served_pages import SIMULATED, Machine, run_server
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from tests.whole.test_json_schemas import faults

from palpate_station.dashboard.session import LEASE_S
from palpate_station.line import modbus
from palpate_station.line.machine import LineState
from palpate_station.qualify.conversion import Conversion

#: Maximum number of polls for a state, and the pause between polls, seconds.
MAX_POLLS, POLL_PERIOD_S = 3000, 0.02
#: Timeout of OPC UA requests on a busy machine, seconds.
TIMEOUT_S = 60.0
#: Answers in a buyer's unit, here of a caliper.
CENTIMETRES = Conversion(
    measurement="size_mm",
    unit="cm",
    slope=0.1,
    offset=0.0,
    half_width=0.05,
    lowest=5.0,
    highest=80.0,
    items=40,
    simulated=True,
)
_Answer = TypeVar("_Answer")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Station:
    """A server with both protocols, which can be killed and started again at the same ports."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._opcua_port, self.modbus = folder, free_port(), free_port()
        self.opcua = f"opc.tcp://127.0.0.1:{self._opcua_port}/palpate"
        self._running = ExitStack()

    def start(self) -> None:
        ports = ("--opcua", str(self._opcua_port), "--modbus", str(self.modbus))
        CENTIMETRES.save(self._folder / "cm.json")
        served = run_server(self._folder, *SIMULATED, *ports, "--reference", "cm.json")
        self.http, self._process = self._running.enter_context(served)

    def kill(self) -> None:
        self._process.kill()
        self._running.close()


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    station = Station(tmp_path_factory.mktemp("line"))
    station.start()
    yield station
    station.kill()


async def wait_until(
    ask: Callable[[], Awaitable[_Answer]], wanted: Callable[[_Answer], bool]
) -> _Answer:
    for _ in range(MAX_POLLS):
        found = await ask()
        if wanted(found):
            return found
        await asyncio.sleep(POLL_PERIOD_S)
    raise AssertionError(f"the value stayed {found}")


class OpcUa:
    """An OPC UA client of the station object."""

    def __init__(self, client: Client) -> None:
        self._client = client

    async def _node(self, *path: str) -> Any:
        space = await self._client.get_namespace_index("urn:palpate:station")
        return await self._client.nodes.objects.get_child(
            [f"{space}:{name}" for name in ("Station", *path)]
        )

    async def value(self, *path: str) -> Any:
        return await (await self._node(*path)).read_value()

    async def call(self, method: str, *arguments: Any) -> Any:
        parent = await self._node()
        return await parent.call_method(await self._node(method), *arguments)

    async def grasp(
        self, target_n: float = 0.0, item: str = "", stops: int = -1, batch: str | None = None
    ) -> Any:
        return await self.call(
            "Grasp",
            ua.Variant(target_n, ua.VariantType.Double),
            item,
            "",
            ua.Variant(stops, ua.VariantType.Int64),
            # Clients of the first version do not know the batch.
            *([] if batch is None else [batch]),
        )

    async def reach(self, state: str) -> None:
        await wait_until(lambda: self.value("State"), lambda now: now == state)


async def read_registers(client: AsyncModbusTcpClient, at: int, count: int) -> list[int]:
    answer = await client.read_holding_registers(at, count=count)
    assert not answer.isError()
    return list(answer.registers)


async def reach(client: AsyncModbusTcpClient, state: LineState) -> None:
    await wait_until(lambda: read_registers(client, modbus.STATE, 1), lambda now: now[0] == state)


@asynccontextmanager
async def opcua_driver(station: Station) -> AsyncIterator[OpcUa]:
    """Connect over OPC UA, take over and wait until the rig is idle."""
    async with Client(station.opcua, watchdog_intervall=TIMEOUT_S) as client:
        hand = OpcUa(client)
        await hand.call("TakeOver")
        await hand.reach("idle")
        yield hand


@pytest.mark.system
def test_opcua_node_ids_are_the_paths_that_clients_save(station: Station) -> None:
    async def work() -> list[Any]:
        async with Client(station.opcua, watchdog_intervall=TIMEOUT_S) as client:
            space = await client.get_namespace_index("urn:palpate:station")
            paths = ("Station.Held.SizeMmLow", "Station.Result.Number", "Station.Simulated")
            nodes = [client.get_node(f"ns={space};s={path}") for path in paths]
            methods = await client.get_node(f"ns={space};s=Station").get_methods()
            named = {str(one.nodeid.Identifier) for one in methods}
            assert named >= {"Station.Grasp", "Station.Release"}
            return [await node.read_value() for node in nodes]

    low, _, is_simulated = asyncio.run(work())
    assert math.isnan(low)
    assert is_simulated is True


@pytest.mark.system
def test_opcua_grasp_result_equals_the_http_result(station: Station) -> None:
    async def work() -> tuple[dict[str, Any], float, str]:
        async with opcua_driver(station) as hand:
            before = await hand.value("Result", "Number")
            recording = await hand.grasp(2.0, "]C1010401234500001621B7", batch="Monday ")
            await hand.reach("holding")
            await hand.call("Release")
            await wait_until(lambda: hand.value("Result", "Number"), lambda now: now == before + 1)
            document = json.loads(await hand.value("Result", "Document"))
            assert document["recording"] == recording
            assert await hand.value("Result", "Outcome") == "held"
            size_mm, item = [await hand.value("Result", name) for name in ("SizeMm", "Item")]
            return document, size_mm, item

    document, size_mm, item = asyncio.run(work())
    machine = Machine(station.http)
    assert machine.ask("GET", "/result") == (200, document)
    assert size_mm == document["size_mm"]["value"]
    assert item == document["item_id"] == "(01)04012345000016(21)B7"
    # The result is shown before it is stored.
    machine.until(lambda _: machine.ask("GET", f"/epcis/{item}")[0] == 200)
    (event,) = read_epcis(machine.ask("GET", f"/epcis/{item}")[1])
    assert event["epcList"] == ["https://id.gs1.org/01/04012345000016/21/B7"]
    reports = event["sensorElementList"][0]["sensorReport"]
    assert {one["type"]: one.get("value") for one in reports}["Length"] == size_mm
    assert machine.ask("GET", f"/items/{item}")[1]["item"]["batch"] == "Monday"
    refused = machine.ask("POST", "/grasp", {"batch": "Monday"})
    assert refused == (422, {"detail": "batch 'Monday': a batch requires an item"})


def test_modbus_result_equals_the_http_result_and_its_item_is_used_once(station: Station) -> None:
    machine = Machine(station.http)

    async def grasp_twice() -> list[tuple[str, int, str, list[int]]]:
        found = []
        async with AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as client:
            await client.write_register(modbus.COMMAND, modbus.TAKE_OVER)
            await client.write_register(modbus.TARGET, 200)
            await client.write_registers(modbus.NEW_ITEM, modbus.encode_text("tray-4"))
            await client.write_registers(modbus.NEW_BATCH, modbus.encode_text("Monday"))
            for _ in range(2):
                await reach(client, LineState.IDLE)
                before = await read_registers(client, modbus.RESULTS, 2)
                assert not (await client.write_register(modbus.COMMAND, modbus.GRASP)).isError()
                waiting = await read_registers(client, modbus.NEW_ITEM, modbus.TEXT_REGISTERS)
                await reach(client, LineState.HOLDING)
                await client.write_register(modbus.COMMAND, modbus.RELEASE)
                await wait_until(
                    lambda: read_registers(client, modbus.RESULTS, 2),
                    lambda now, last=before: now[1] == last[1] + 1,
                )
                item = await read_registers(client, modbus.ITEM, modbus.TEXT_REGISTERS)
                (storage,) = await read_registers(client, modbus.STORAGE, 1)
                values = await read_registers(client, modbus.VALUES, 6)
                texts = [modbus.decode_text(one) for one in (item, waiting)]
                found.append((texts[0], storage, texts[1], values))
        return found

    first, (*second, values) = asyncio.run(grasp_twice())
    assert first[:3] == ("tray-4", modbus.STORED, "")
    assert second == ["", modbus.WITHOUT_ITEM, ""]
    document = machine.ask("GET", "/result")[1]
    size = struct.unpack(">3f", struct.pack(">6H", *values))
    assert size == pytest.approx([document["size_mm"][part] for part in ("value", "low", "high")])
    item = machine.ask("GET", "/items/tray-4")[1]
    assert (len(item["grasps"]), item["item"]["batch"]) == (1, "Monday")


def test_numbers_of_the_held_object_are_the_same_over_every_protocol_before_its_release(
    station: Station,
) -> None:
    machine, item = Machine(station.http), "Bäckerei-Ω-7"

    async def work() -> tuple[dict[str, Any], list[float], list[float], str, str]:
        async with (
            opcua_driver(station) as hand,
            AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as second,
        ):
            before = await read_registers(second, modbus.RESULTS, 2)
            await hand.call("Leave")
            await second.write_register(modbus.TARGET, 200)
            await second.write_registers(modbus.NEW_ITEM, modbus.encode_text(item))
            assert not (await second.write_register(modbus.COMMAND, modbus.GRASP)).isError()
            await reach(second, LineState.HOLDING)
            await hand.reach("holding")
            state = machine.ask("GET", "/state")[1]
            assert await read_registers(second, modbus.RESULTS, 2) == before
            values = struct.pack(">18H", *await read_registers(second, modbus.HELD_VALUES, 18))
            names = ("SizeMm", "ForceN", "StiffnessNPerMm")
            ends = ("", "Low", "High")
            read = [await hand.value("Held", name + end) for name in names for end in ends]
            driver = await hand.value("Driver")
            await second.write_register(modbus.COMMAND, modbus.RELEASE)
            await wait_until(
                lambda: read_registers(second, modbus.RESULTS, 2), lambda now: now != before
            )
            stored = await read_registers(second, modbus.ITEM, modbus.TEXT_REGISTERS)
            assert await read_registers(second, modbus.OUTCOME, 1) == [1]
            await hand.reach("idle")
            assert await hand.value("Result", "OutcomeNumber") == 1
            size_cm = struct.pack(">6H", *await read_registers(second, modbus.REFERENCE, 6))
            registers = [*struct.unpack(">9f", values), *struct.unpack(">3f", size_cm)]
            read += [await hand.value("Result", "Reference" + end) for end in ends]
            assert await hand.value("Result", "ReferenceUnit") == "cm"
            return state, registers, read, modbus.decode_text(stored), driver

    state, registers, nodes, stored, driver = asyncio.run(work())
    assert (state["state"], state["state_number"], state["driver_name"]) == ("holding", 3, driver)
    assert stored == state["held"]["item_id"] == item
    measured = [state["held"][name] for name in ("size_mm", "force_n", "stiffness_n_per_mm")]
    expected = [
        math.nan if one is None or one[part] is None else one[part]
        for one in measured
        for part in ("value", "low", "high")
    ]
    assert expected[0] > 0
    in_cm = state["held"]["reference"]
    assert in_cm["value"] == pytest.approx(expected[0] / 10.0)
    expected += [in_cm[part] for part in ("value", "low", "high")]
    assert registers == pytest.approx(expected, nan_ok=True)
    assert nodes == pytest.approx(expected, nan_ok=True)
    result = machine.ask("GET", "/result")[1]
    assert {name: result[name] for name in ("size_mm", "force_n")} == {
        name: state["held"][name] for name in ("size_mm", "force_n")
    }
    assert result["reference"] == in_cm
    assert (faults("state", state), faults("grasp", result)) == ([], [])
    assert machine.ask("GET", "/state")[1]["held"] is None


def test_driver_that_has_gone_loses_control_after_its_lease(station: Station) -> None:
    async def drive_and_go() -> None:
        async with AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as client:
            await client.write_register(modbus.COMMAND, modbus.TAKE_OVER)

    machine = Machine(station.http)
    asyncio.run(drive_and_go())
    status, refused = machine.ask("POST", "/release")
    assert (status, refused["detail"]) == (409, "Modbus 127.0.0.1 drives; take over first")
    began_s = time.monotonic()
    machine.until(lambda at: at["driver_name"] is None)
    assert time.monotonic() - began_s < LEASE_S + 1.0
    assert machine.ask("POST", "/release")[0] == 202
    assert machine.ask("GET", "/state")[1]["driver_name"] == "HTTP 127.0.0.1"

    async def keep_control_without_orders() -> None:
        async with opcua_driver(station) as hand:
            await asyncio.sleep(LEASE_S + 1.0)
            assert await hand.value("Driver") == "OPC UA 127.0.0.1"

    asyncio.run(keep_control_without_orders())
    machine.until(lambda at: at["driver_name"] is None)


def test_modbus_invalid_command_or_address_returns_an_exception_and_a_reason(
    station: Station,
) -> None:
    async def work() -> tuple[int, list[int], str]:
        async with AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as client:
            wrong = await client.write_register(modbus.COMMAND, 9)
            why = await read_registers(client, modbus.REFUSAL, modbus.TEXT_REGISTERS)
            not_writable = [
                await client.write_register(modbus.STATE, 1),
                await client.write_register(modbus.KNOWN_STOPS + 3, 0),
                await client.write_registers(modbus.TARGET, [200, 0xFFFF, 0xFFFF, 1]),
            ]
            # A block of all parameters spans the registers between them.
            block = [200, 0xFFFF, 0xFFFF, *[0] * 6, *modbus.encode_text("A1")]
            assert not (await client.write_registers(modbus.TARGET, block)).isError()
            await client.write_registers(modbus.NEW_ITEM, [0])
            # Functions of bits and addresses beyond the map.
            not_there = [
                await client.read_coils(0, count=8),
                await client.read_discrete_inputs(0, count=8),
                await client.write_coil(modbus.COMMAND, True),
                await client.read_holding_registers(modbus.REGISTER_COUNT, count=1),
            ]
            codes = [one.exception_code for one in not_writable + not_there]
            return wrong.exception_code, codes, modbus.decode_text(why)

    assert asyncio.run(work()) == (3, [2, 2, 2, 1, 1, 1, 2], "command 9: use a number from 1 to 5")


def test_modbus_item_is_the_text_that_was_written_or_is_refused(station: Station) -> None:
    async def work() -> tuple[list[int], str, list[str]]:
        async with AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as client:

            async def item() -> list[int]:
                return await read_registers(client, modbus.NEW_ITEM, modbus.TEXT_REGISTERS)

            await client.write_register(modbus.COMMAND, modbus.TAKE_OVER)
            await reach(client, LineState.IDLE)
            # The bytes of each register in the wrong order.
            swapped = struct.unpack("<3H", b"ABCD1\0")
            await client.write_registers(modbus.NEW_ITEM, list(swapped))
            refused = await client.write_register(modbus.COMMAND, modbus.GRASP)
            why = await read_registers(client, modbus.REFUSAL, modbus.TEXT_REGISTERS)
            written = []
            for text in (b"A-LONG-NAME-123", b"AB12"):
                padded = text + b"\0" * (len(text) % 2)
                registers = list(struct.unpack(f">{len(padded) // 2}H", padded))
                await client.write_registers(modbus.NEW_ITEM, registers)
                written.append(modbus.decode_text(await item()))
            # A text in two requests, and spaces after it.
            await client.write_registers(modbus.NEW_ITEM, [0x4142])
            await client.write_registers(modbus.NEW_ITEM + 1, [0x3132, 0x2020])
            assert not (await client.write_register(modbus.COMMAND, modbus.GRASP)).isError()
            await reach(client, LineState.HOLDING)
            before = await read_registers(client, modbus.RESULTS, 2)
            await client.write_register(modbus.COMMAND, modbus.RELEASE)
            await wait_until(
                lambda: read_registers(client, modbus.RESULTS, 2), lambda now: now != before
            )
            stored = await read_registers(client, modbus.ITEM, modbus.TEXT_REGISTERS)
            written.append(modbus.decode_text(stored))
            return [refused.exception_code], modbus.decode_text(why), written

    codes, why, written = asyncio.run(work())
    assert codes == [3]
    assert "a zero byte is followed by more text" in why
    assert written == ["A-LONG-NAME-123", "AB12", "AB12"]


def test_opcua_invalid_force_is_refused_with_a_status_and_a_reason(station: Station) -> None:
    codes = ua.StatusCodes

    async def work() -> str:
        async with opcua_driver(station) as hand:
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await hand.grasp(900.0)
            assert refused.value.code == codes.BadInvalidArgument
            found: str = await hand.value("Refusal")
            for arguments, code in (
                (("hard", "", "", 1), codes.BadTypeMismatch),
                ((), codes.BadArgumentsMissing),
            ):
                with pytest.raises(ua.UaStatusCodeError) as refused:
                    await hand.call("Grasp", *arguments)
                assert refused.value.code == code
                assert "rgument" in await hand.value("Refusal")
            return found

    assert "at most 15 N" in asyncio.run(work())


def test_line_client_must_be_the_driver_to_grasp_but_not_to_stop(station: Station) -> None:
    async def work() -> None:
        async with (
            opcua_driver(station) as hand,
            AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as other,
        ):
            refused = await other.write_register(modbus.COMMAND, modbus.GRASP)
            assert refused.exception_code == 6
            why = await read_registers(other, modbus.REFUSAL, modbus.TEXT_REGISTERS)
            assert modbus.decode_text(why) == "OPC UA 127.0.0.1 drives; take over first"
            await hand.grasp()
            # The state is updated before a command returns.
            assert await hand.value("State") == "execute"
            stopped = await other.write_register(modbus.COMMAND, modbus.STOP)
            assert not stopped.isError()
            await wait_until(lambda: hand.value("Activity"), lambda now: now == "watching")
            stops = await hand.value("Stops")
            with pytest.raises(ua.UaStatusCodeError):
                await hand.grasp(stops=stops - 1)
            await hand.call("Release")
            # A hand that had hardly closed is open at once.
            assert await hand.value("State") in ("stopped", "idle")
            await hand.reach("idle")

    asyncio.run(work())


async def begin_over_opcua(station: Station) -> None:
    async with opcua_driver(station) as hand:
        await hand.grasp(2.0)
        await hand.reach("execute")


async def begin_over_modbus(
    station: Station,
    during: Callable[[AsyncModbusTcpClient], Awaitable[None]] | None = None,
    **options: float,
) -> None:
    async with AsyncModbusTcpClient("127.0.0.1", port=station.modbus, **options) as client:
        await client.write_register(modbus.COMMAND, modbus.TAKE_OVER)
        await reach(client, LineState.IDLE)
        await client.write_register(modbus.TARGET, 200)
        await client.write_register(modbus.COMMAND, modbus.GRASP)
        await reach(client, LineState.EXECUTE)
        if during is not None:
            await during(client)


@pytest.mark.parametrize("begin", [begin_over_opcua, begin_over_modbus])
def test_line_client_lost_during_a_grasp_leaves_the_grasp_to_the_next_client(
    station: Station, begin: Callable[[Station], Coroutine[Any, Any, None]]
) -> None:
    async def end() -> str:
        async with Client(station.opcua, watchdog_intervall=TIMEOUT_S) as client:
            hand = OpcUa(client)
            await hand.reach("holding")
            await hand.call("TakeOver")
            await hand.call("Release")
            await hand.reach("idle")
            found: str = await hand.value("Result", "Outcome")
            return found

    asyncio.run(begin(station))
    assert asyncio.run(end()) == "held"


def test_line_clients_reconnect_to_a_server_restarted_during_a_grasp(station: Station) -> None:
    async def lose(client: AsyncModbusTcpClient) -> None:
        station.kill()
        with pytest.raises(ModbusException):
            await client.read_holding_registers(modbus.STATE, count=1)

    async def find() -> list[int]:
        async with (
            opcua_driver(station),
            AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as second,
        ):
            await reach(second, LineState.IDLE)
            return await read_registers(second, modbus.RESULTS, 2)

    asyncio.run(begin_over_modbus(station, lose, timeout=1))
    station.start()
    assert asyncio.run(find()) == [0, 0]


def test_item_of_a_grasp_that_a_killed_server_has_cut_off_is_named_over_every_protocol(
    station: Station,
) -> None:
    machine = Machine(station.http)
    machine.ready()
    machine.ask("PUT", "/driver")
    assert machine.ask("POST", "/grasp", {"item_id": "cut-7"})[0] == 202
    machine.until(lambda at: at["state"] == "execute")
    station.kill()
    station.start()
    machine = Machine(station.http)
    machine.ready()
    state = machine.ask("GET", "/state")[1]
    assert (state["interrupted"]["item_id"], faults("state", state)) == ("cut-7", [])

    async def read() -> tuple[bool, str, int, str]:
        async with (
            opcua_driver(station) as hand,
            AsyncModbusTcpClient("127.0.0.1", port=station.modbus) as client,
        ):
            (flags,) = await read_registers(client, modbus.FLAGS, 1)
            text = await read_registers(client, modbus.INTERRUPTED_ITEM, modbus.TEXT_REGISTERS)
            found = [await hand.value(name) for name in ("Interrupted", "InterruptedItem")]
            return found[0], found[1], flags >> 5 & 1, modbus.decode_text(text)

    assert asyncio.run(read()) == (True, "cut-7", 1, "cut-7")
