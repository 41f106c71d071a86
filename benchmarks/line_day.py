"""A day on a line: two stations over HTTP, OPC UA, Modbus TCP and MQTT, with faults.

    python benchmarks/line_day.py --items 30

Two simulated stations store in one private PostgreSQL server and publish to one private MQTT broker
(requires Debian's `postgresql` and `mosquitto`). Each item is grasped over one protocol, read over
all four while it is held, and read again after its release. Meanwhile the broker is away for a
minute, then the database; and on the first station one client of each protocol is killed while it
holds an item, and a client of the next protocol releases it.

The clients are httpx, asyncua, pymodbus and paho-mqtt, used as docs/packhouse.md says. The output
is a table of the readings that agree, the store, the deliveries, the outages and the killed
clients. The exit status is 1 if a reading differs, or if an item is missing, or stored twice.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import multiprocessing
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import httpx
import numpy as np
import paho.mqtt.client as mqtt
from asyncua import ua
from asyncua.client.client import Client
from asyncua.ua.uaerrors import UaStatusCodeError
from paho.mqtt.enums import CallbackAPIVersion
from pymodbus.client import AsyncModbusTcpClient

from palpate_station.store import Store
from services import Broker, Database, free_port, freeze, run_service, thaw, wait_for_port

RULES = """
default = "by hand"
confidence = 0.8
most_grasps = 2
require_item = true

[[rule]]
bin = "süß, small"
size_mm = [0, 63]

[[rule]]
bin = "süß, large"
size_mm = [63, 90]
"""
VALUES = {
    "size_mm": "SizeMm",
    "force_n": "ForceN",
    "stiffness_n_per_mm": "StiffnessNPerMm",
    "settled_percent": "SettledPercent",
    "firmness": "Firmness",
}
EXECUTE, HOLDING, IDLE = 2, 3, 1
POLL_S, PATIENCE_S, CARRY_S = 0.05, 60.0, 1.0
PROTOCOLS = ("HTTP", "OPC UA", "Modbus", "MQTT")


class RefusedError(Exception):
    """An order was refused."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What one protocol shows of an item; values are 32-bit floats, NaN if unknown."""

    item: str
    bin: str
    again: bool
    values: tuple[float, ...]

    def differs(self, other: Reading) -> bool:
        same = np.array_equal(self.values, other.values, equal_nan=True)
        return not same or (self.item, self.bin, self.again) != (other.item, other.bin, other.again)


def as_floats(values: Sequence[float | None]) -> tuple[float, ...]:
    return tuple(float(np.float32(np.nan if one is None else one)) for one in values)


class Driver(Protocol):
    """A client of one protocol."""

    async def state(self) -> int: ...
    async def finished(self) -> int: ...
    async def grasp(self, item: str) -> None: ...
    async def release(self) -> None: ...
    async def leave(self) -> None: ...
    async def held(self, item: str) -> Reading: ...
    async def result(self) -> Reading: ...


class Http:
    """A client of HTTP with httpx."""

    def __init__(self, client: httpx.AsyncClient) -> None:
        self._client, self._started = client, ""

    async def _ask(self, method: str, path: str, body: object = None) -> Any:
        reply = await self._client.request(method, f"/api/v1{path}", json=body)
        if reply.status_code >= 400:
            raise RefusedError(reply.json()["detail"])
        return reply.json() if reply.content else None

    async def state(self) -> int:
        return int((await self._ask("GET", "/state"))["state_number"])

    async def finished(self) -> int:
        with suppress(RefusedError):
            return int((await self._ask("GET", "/result"))["recording"] == self._started)
        return 0

    async def grasp(self, item: str) -> None:
        self._started = (await self._ask("POST", "/grasp", {"item_id": item}))["recording"]

    async def release(self) -> None:
        await self._ask("POST", "/release", {})

    async def leave(self) -> None:
        await self._ask("DELETE", "/driver")

    async def held(self, item: str) -> Reading:
        held = (await self._ask("GET", "/state"))["held"]
        return read_document(held, held["item_id"], held["bin"], held["again"])

    async def result(self) -> Reading:
        return read_result(await self._ask("GET", "/result"))


def read_document(found: dict[str, Any], item: str, bin_name: str | None, again: bool) -> Reading:
    values = as_floats([(found[name] or {}).get("value") for name in VALUES])
    return Reading(item=item, bin=bin_name or "", again=again, values=values)


def read_result(result: dict[str, Any]) -> Reading:
    placed = result["bin"] or {"name": "", "again": False}
    return read_document(result, result["item_id"], placed["name"], placed["again"])


class OpcUa:
    """A client of OPC UA with asyncua."""

    def __init__(self, client: Client) -> None:
        self._client = client

    async def _node(self, *path: str) -> Any:
        space = await self._client.get_namespace_index("urn:palpate:station")
        names = [f"{space}:{name}" for name in ("Station", *path)]
        return await self._client.nodes.objects.get_child(names)

    async def _value(self, *path: str) -> Any:
        return await (await self._node(*path)).read_value()

    async def _call(self, method: str, *arguments: Any) -> None:
        try:
            await (await self._node()).call_method(await self._node(method), *arguments)
        except UaStatusCodeError as error:
            raise RefusedError(f"{error}: {await self._value('Refusal')}") from error

    async def state(self) -> int:
        return int(await self._value("StateNumber"))

    async def finished(self) -> int:
        return int(await self._value("Result", "Number"))

    async def grasp(self, item: str) -> None:
        gentle, unchecked = (
            ua.Variant(0.0, ua.VariantType.Double),
            ua.Variant(-1, ua.VariantType.Int64),
        )
        await self._call("Grasp", gentle, item, "", unchecked)

    async def release(self) -> None:
        await self._call("Release")

    async def leave(self) -> None:
        await self._call("Leave")

    async def held(self, item: str) -> Reading:
        return await self._reading("Held")

    async def result(self) -> Reading:
        return await self._reading("Result")

    async def _reading(self, place: str) -> Reading:
        return Reading(
            item=await self._value(place, "Item"),
            bin=await self._value(place, "Bin"),
            again=await self._value(place, "BinProvisional"),
            values=as_floats([await self._value(place, name) for name in VALUES.values()]),
        )


class Modbus:
    """A client of Modbus TCP with pymodbus."""

    def __init__(self, client: AsyncModbusTcpClient) -> None:
        self._client = client

    async def _read(self, at: int, count: int) -> list[int]:
        answer = await self._client.read_holding_registers(at, count=count)
        if answer.isError():
            raise RefusedError(f"registers {at}: {answer}")
        return list(answer.registers)

    async def _text(self, at: int) -> str:
        words = await self._read(at, 40)
        return struct.pack(">40H", *words).rstrip(b"\0").decode()

    async def _write(self, at: int, words: list[int]) -> None:
        answer = await self._client.write_registers(at, words)
        if answer.isError():
            raise RefusedError(f"exception {answer.exception_code}: {await self._text(180)}")

    async def state(self) -> int:
        return (await self._read(0, 1))[0]

    async def finished(self) -> int:
        high, low = await self._read(4, 2)
        return high << 16 | low

    async def grasp(self, item: str) -> None:
        words = struct.unpack(">40H", item.encode().ljust(80, b"\0"))
        await self._write(310, list(words))
        await self._write(300, [1])

    async def release(self) -> None:
        await self._write(300, [2])

    async def leave(self) -> None:
        await self._write(300, [5])

    async def held(self, item: str) -> Reading:
        # No register has the item in the hand: the client knows it.
        (again,) = await self._read(39, 1)
        return await self._reading(item, 220, bool(again), values=40)

    async def result(self) -> Reading:
        (again,) = await self._read(38, 1)
        return await self._reading(await self._text(100), 140, bool(again), values=8)

    async def _reading(self, item: str, at: int, again: bool, *, values: int) -> Reading:
        words = await self._read(values, 30)
        # Value, low and high of each.
        floats = struct.unpack(">15f", struct.pack(">30H", *words))[::3]
        return Reading(item=item, bin=await self._text(at), again=again, values=as_floats(floats))


class Consumer:
    """A consumer of MQTT with paho-mqtt, whose session survives a lost connection."""

    def __init__(self, port: int, topic: str) -> None:
        self.held = dict[str, Reading]()
        self.results: list[dict[str, Any]] = []
        self.dropped = 0
        self._topic = topic
        self._client = mqtt.Client(
            CallbackAPIVersion.VERSION2, client_id=f"mes-{topic}", clean_session=False
        )
        self._client.reconnect_delay_set(1, 2)
        self._client.on_connect = self._subscribe
        self._client.on_message = self._receive
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def _subscribe(self, client: mqtt.Client, *_: object) -> None:
        client.subscribe(f"{self._topic}/#", qos=1)

    def _receive(self, client: mqtt.Client, data: object, message: mqtt.MQTTMessage) -> None:
        document = json.loads(message.payload)
        match message.topic.removeprefix(f"{self._topic}/"):
            case "result":
                self.results.append(document)
            case "state" if held := document["held"]:
                item = held["item_id"]
                self.held[item] = read_document(held, item, held["bin"], held["again"])
            case "online":
                self.dropped = document.get("dropped", self.dropped)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@dataclass(kw_only=True)
class Address:
    """Where the clients of a station connect."""

    http: str = ""
    opcua_port: int = field(default_factory=free_port)
    modbus_port: int = field(default_factory=free_port)

    @asynccontextmanager
    async def connect(self, protocol: str) -> AsyncIterator[Driver]:
        """Connect a client, whose connection ends with the block."""
        if protocol == "HTTP":
            async with httpx.AsyncClient(base_url=self.http, timeout=20.0) as http:
                yield Http(http)
        elif protocol == "OPC UA":
            url = f"opc.tcp://127.0.0.1:{self.opcua_port}/palpate"
            # The default watchdog closes a connection that is silent for 1 s.
            async with Client(url, timeout=20.0, watchdog_intervall=20.0) as opcua:
                yield OpcUa(opcua)
        else:
            async with AsyncModbusTcpClient("127.0.0.1", port=self.modbus_port) as modbus:
                yield Modbus(modbus)


@dataclass(kw_only=True)
class Station:
    """A station with its own folder and local store, and what was read of it."""

    name: str
    folder: Path
    consumer: Consumer
    address: Address = field(default_factory=Address)
    #: One row per grasp.
    rows: list[dict[str, Any]] = field(default_factory=list)

    def start(self, url: str, broker: int) -> subprocess.Popen[str]:
        self.folder.mkdir()
        (self.folder / "rules.toml").write_text(RULES)
        (self.folder / "broker.toml").write_text(
            f'host = "127.0.0.1"\nport = {broker}\ntls = false\ntopic = "palpate/{self.name}"\n'
        )
        command = [sys.executable, "-m", "palpate", "serve", "--rig", "sim-rigid", "--port", "0"]
        command += ["--object", "avocado-day-3", "--seed", str(sum(map(ord, self.name)))]
        command += ["--rules", "rules.toml", "--mqtt", "broker.toml", "--store", url]
        command += [
            "--opcua",
            str(self.address.opcua_port),
            "--modbus",
            str(self.address.modbus_port),
        ]
        with (self.folder / "serve.log").open("w") as log:
            process = subprocess.Popen(
                [*command, "--station", self.name],
                cwd=self.folder,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                env=os.environ | {"XDG_STATE_HOME": str(self.folder / "state")},
            )
        assert process.stdout is not None
        words = process.stdout.readline().split()
        address = next((word for word in words if word.startswith("http")), None)
        if address is None:
            sys.exit((self.folder / "serve.log").read_text())
        self.address.http = address
        for port in (self.address.opcua_port, self.address.modbus_port):
            wait_for_port(port)
        return process

    async def read(self, what: str, item: str) -> dict[str, Reading]:
        """Read the item over HTTP, OPC UA and Modbus, each with a connection of its own."""
        found = {}
        for protocol in PROTOCOLS[:3]:
            async with self.address.connect(protocol) as client:
                reading = client.held(item) if what == "held" else client.result()
                found[protocol] = await reading
        return found


async def wait_for_state(driver: Driver, *wanted: int) -> int:
    until_s = time.monotonic() + PATIENCE_S
    while (state := await driver.state()) not in wanted:
        if time.monotonic() > until_s:
            raise TimeoutError(f"the state stayed {state}")
        await asyncio.sleep(POLL_S)
    return state


async def hold(driver: Driver, item: str) -> bool:
    """Grasp an item; return whether it is held, and not whether the grasp ended by itself."""
    await wait_for_state(driver, IDLE)
    before = await driver.finished()
    await driver.grasp(item)
    until_s = time.monotonic() + PATIENCE_S
    while (state := await driver.state()) != HOLDING:
        if await driver.finished() != before:
            return False
        if time.monotonic() > until_s:
            raise TimeoutError(f"the state stayed {state}")
        await asyncio.sleep(POLL_S)
    return True


def hold_until_killed(address: Address, protocol: str, item: str, said: Connection) -> None:
    """Grasp an item and hold it, as a client that will be killed."""

    async def work() -> None:
        async with address.connect(protocol) as driver:
            said.send(await hold(driver, item))
            while True:
                # A driver that polls keeps its control.
                await driver.state()
                await asyncio.sleep(POLL_S)

    asyncio.run(work())


async def kill_while_holding(station: Station, protocol: str, item: str) -> bool:
    """Start a client that grasps an item, kill it while it holds; return whether it was held."""
    spawn = multiprocessing.get_context("spawn")
    heard, said = spawn.Pipe(duplex=False)
    process = spawn.Process(target=hold_until_killed, args=(station.address, protocol, item, said))
    process.start()
    is_held = bool(await asyncio.to_thread(heard.recv))
    process.kill()
    await asyncio.to_thread(process.join)
    return is_held


async def run_item(
    station: Station, driver: Driver, protocol: str, item: str, *, killed: str | None
) -> dict[str, Any]:
    """Grasp, read, release and read again; `killed`: a protocol whose client grasps and dies."""
    row: dict[str, Any] = {"item": item, "protocol": protocol, "killed": killed}
    before, ordered_s = await driver.finished(), time.monotonic()
    if killed is None:
        row["held"] = await hold(driver, item)
    else:
        row["held"] = await kill_while_holding(station, killed, item)
    row["answer_s"] = time.monotonic() - ordered_s
    if row["held"]:
        row["readings"] = await station.read("held", item)
        freed_s = time.monotonic() - (0.0 if killed else -CARRY_S)
        await asyncio.sleep(0.0 if killed else CARRY_S)
        while True:
            try:
                await driver.release()
                break
            except RefusedError as error:
                row["refusal"] = str(error)
                await asyncio.sleep(POLL_S)
        row["freed_s"] = time.monotonic() - freed_s
    released_s = time.monotonic()
    if killed is not None and protocol == "HTTP":
        # `finished` of HTTP knows only its own recording.
        await wait_for_state(driver, IDLE)
    else:
        while await driver.finished() == before:
            await asyncio.sleep(POLL_S)
    row["result_s"] = time.monotonic() - released_s
    row["results"] = await station.read("result", item)
    return row


async def run_station(
    station: Station, *, items: int, period_s: float, kills: bool, done: Counter[str]
) -> None:
    """Run the items of a station, one third over each protocol."""
    due_s = time.monotonic()
    blocks = [list(block) for block in np.array_split(np.arange(items), 3)]
    for protocol, dying, block in zip(
        PROTOCOLS[:3], ("Modbus", "HTTP", "OPC UA"), blocks, strict=True
    ):
        for number in block:
            is_killed = kills and number == block[-1]
            item = f"]C1010401234500001621{station.name[0].upper()}{number:03d}"
            for _ in range(2):
                async with station.address.connect(protocol) as driver:
                    if is_killed:
                        await wait_for_state(driver, IDLE)
                        await driver.leave()
                    row = await run_item(
                        station, driver, protocol, item, killed=dying if is_killed else None
                    )
                    row |= {"at_s": time.monotonic(), "station": station.name}
                    station.rows.append(row)
                    again = row["results"]["HTTP"].again
                    if not again:
                        await driver.leave()
                if not again:
                    break
                is_killed = False
            done[station.name] += 1
            due_s = max(due_s + period_s, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())


async def interrupt(
    service: Broker | Database, *, at: int, seconds: float, is_frozen: bool, done: Counter[str]
) -> tuple[float, float]:
    """Stop a service after a number of items for a time; return the times of both."""
    end = partial(freeze, service) if is_frozen else service.stop
    start = partial(thaw, service) if is_frozen else service.start
    while done.total() < at:
        await asyncio.sleep(0.5)
    await asyncio.to_thread(end)
    stopped_s = time.monotonic()
    await asyncio.sleep(seconds)
    await asyncio.to_thread(start)
    return stopped_s, time.monotonic()


async def run_day(
    stations: list[Station], broker: Broker, database: Database, options: argparse.Namespace
) -> dict[str, tuple[float, float]]:
    """Run both stations and the outages; return the times of the outages."""
    done = Counter[str]()
    away = dict[str, tuple[float, float]]()

    async def run_outages() -> None:
        for name, service, fraction in (("broker", broker, 0.15), ("database", database, 0.5)):
            away[name] = await interrupt(
                service,
                at=round(fraction * options.items),
                seconds=options.away,
                is_frozen=options.frozen,
                done=done,
            )

    half = options.items // 2
    await asyncio.gather(
        run_outages(),
        *(
            run_station(station, items=count, period_s=options.period, kills=not number, done=done)
            for number, (station, count) in enumerate(
                zip(stations, (options.items - half, half), strict=True)
            )
        ),
    )
    return away


def wait_for_deliveries(stations: list[Station], url: str, *, seconds: float = 60.0) -> float:
    """Wait until the store and the consumers have everything; return the time that it took."""
    began_s = time.monotonic()
    grasps = sum(len(station.rows) for station in stations)
    while time.monotonic() - began_s < seconds:
        with Store.open(url) as store:
            stored = sum(1 for _ in store.grasps())
        if stored >= grasps and all(
            len({one["recording"] for one in station.consumer.results}) >= len(station.rows)
            for station in stations
        ):
            break
        time.sleep(0.5)
    return time.monotonic() - began_s


def print_agreement(rows: list[dict[str, Any]], stations: list[Station]) -> int:
    """Print how many readings of each protocol agree with HTTP; return the differences.

    MQTT shows only the newest state, so items held while the broker is away are not read over it.
    """
    consumers = {station.name: station.consumer for station in stations}
    print(f"\n{'':8} {'held: read':>10} {'differ':>7} {'result: read':>13} {'differ':>7}")
    differences = 0
    for protocol in PROTOCOLS:
        counts = Counter[str]()
        for row in rows:
            consumer = consumers[row["station"]]
            truth = row["results"]["HTTP"]
            if protocol == "MQTT":
                held = consumer.held.get(truth.item)
                results = [read_result(one) for one in consumer.results]
                result = next((one for one in results if one.item == truth.item), None)
            else:
                held = row["readings"][protocol] if row["held"] else None
                result = row["results"][protocol]
            for name, reading in (("held", held), ("result", result)):
                if reading is None:
                    continue
                counts[name] += 1
                # Over Modbus the client gives the scanned text.
                if name == "held" and protocol == "Modbus":
                    reading = Reading(
                        item=truth.item,
                        bin=reading.bin,
                        again=reading.again,
                        values=reading.values,
                    )
                if reading.differs(truth):
                    counts[f"{name} differs"] += 1
                    print(f"{protocol} {name}: {reading}, HTTP: {truth}")
        differences += counts["held differs"] + counts["result differs"]
        print(
            f"{protocol:8} {counts['held']:10} {counts['held differs']:7} "
            f"{counts['result']:13} {counts['result differs']:7}"
        )
    return differences


def print_store(rows: list[dict[str, Any]], url: str) -> int:
    """Compare the shared store with the results; return the number of faults."""
    with Store.open(url) as store:
        grasps = list(store.grasps())
        bins = {
            item: [one.text for one in store.verdicts_of(item) if one.about == "bin"]
            for item in {grasp.item_id for grasp in grasps}
        }
    wanted = Counter(row["results"]["HTTP"].item for row in rows)
    stored = Counter(grasp.item_id for grasp in grasps)
    last = {row["results"]["HTTP"].item: row["results"]["HTTP"].bin for row in rows}
    missing, extra = (wanted - stored).total(), (stored - wanted).total()
    wrong = [item for item, name in last.items() if (bins.get(item) or [""])[-1] != name]
    twice = [item for item, texts in bins.items() if len(texts) != wanted[item]]
    print(
        f"\nstore: {len(stored)} items, {len(grasps)} grasps; {missing} missing, {extra} too many; "
        f"bins: {len(wrong)} differ, {len(twice)} not one per grasp; "
        f"grasps per station {dict(Counter(grasp.station for grasp in grasps))}"
    )
    return missing + extra + len(wrong) + len(twice)


def print_deliveries(stations: list[Station]) -> int:
    """Print what the consumers received; return the number of lost results."""
    lost = 0
    for station in stations:
        received = Counter(one["recording"] for one in station.consumer.results)
        missing = len(station.rows) - len(received)
        lost += missing
        print(
            f"MQTT of {station.name}: {len(received)} results, {missing} missing, "
            f"{received.total() - len(received)} delivered again, "
            f"{station.consumer.dropped} dropped"
        )
    return lost


def print_times(rows: list[dict[str, Any]], away: dict[str, tuple[float, float]]) -> None:
    """Print the latencies with and without an outage, and the killed clients."""
    groups: dict[str, list[dict[str, Any]]] = {"both there": []}
    for row in rows:
        names = [name for name, (start, end) in away.items() if start < row["at_s"] < end]
        groups.setdefault(f"{names[0]} away" if names else "both there", []).append(row)
    print(f"\n{'seconds, median (longest)':24} {'items':>6} {'order to answer':>16} {'result':>16}")
    for name, group in groups.items():
        alone = [row for row in group if row["killed"] is None]
        cells = [
            f"{np.median(values):.1f} ({max(values):.1f})" if values else "-"
            for values in ([row[key] for row in alone] for key in ("answer_s", "result_s"))
        ]
        print(f"{name:24} {len(group):6} {cells[0]:>16} {cells[1]:>16}")
    for row in rows:
        if row["killed"]:
            print(
                f"{row['killed']} client killed while holding: {row['protocol']} could release "
                f"after {row['freed_s']:.1f} s; before: {row.get('refusal', 'not refused')}"
            )


def main() -> None:
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--items", type=int, default=30, help="of both stations, at least 6")
    parser.add_argument("--period", type=float, default=9.0, help="of the items, seconds")
    parser.add_argument("--away", type=float, default=60.0, help="duration of an outage, seconds")
    parser.add_argument(
        "--frozen", action="store_true", help="broker and database hang, as with unplugged cables"
    )
    parser.add_argument("--folder", help="keep the logs and stores in this new folder")
    options = parser.parse_args()
    with ExitStack() as running:
        temporary = running.enter_context(tempfile.TemporaryDirectory())
        folder = Path(options.folder or temporary).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        # The database's user must reach its folder.
        folder.chmod(0o755)
        os.environ["XDG_STATE_HOME"] = str(folder / "office")
        (folder / "database").mkdir()
        (folder / "broker").mkdir()
        database, broker = Database(folder / "database"), Broker(folder / "broker")
        running.enter_context(run_service(database))
        running.enter_context(run_service(broker))
        stations = []
        for name in ("north", "south"):
            consumer = Consumer(broker.port, f"palpate/{name}")
            running.callback(consumer.close)
            stations.append(Station(name=name, folder=folder / name, consumer=consumer))
            process = stations[-1].start(database.url, broker.port)
            running.callback(process.wait)
            running.callback(process.terminate)
        away = asyncio.run(run_day(stations, broker, database, options))
        late_s = wait_for_deliveries(stations, database.url)
        rows = sorted((row for one in stations for row in one.rows), key=lambda row: row["at_s"])
        print(
            f"{len({(row['station'], row['item']) for row in rows})} items, {len(rows)} grasps, "
            f"{sum(row['held'] for row in rows)} held; load {os.getloadavg()[0]:.1f} on "
            f"{os.cpu_count()} cores; all delivered {late_s:.1f} s after the last item"
        )
        faults = print_agreement(rows, stations)
        faults += print_store(rows, database.url) + print_deliveries(stations)
        print_times(rows, away)
        for station in stations:
            log = (station.folder / "serve.log").read_text().splitlines()
            lines = [line for line in log if " WARNING " in line or " ERROR " in line]
            print(f"\nlog of {station.name}: {len(lines)} warnings", *lines[:20], sep="\n  ")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
