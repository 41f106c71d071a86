"""Load of the bridges on a server: HTTP, OPC UA, Modbus TCP, MQTT.

Run `python benchmarks/packhouse.py --seconds 30`. The board is a simulated process on a
pseudo-terminal; the broker is a real mosquitto. The output is the period of the loop and the
processor time of both processes: without bridges; then, with all bridges in one server, without
requests, with ten requests of the state per second by each protocol in turn, and with a hanging
broker; each as a ratio to HTTP or to no bridge. Finally, the times of stops and results.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import os
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
REQUEST_PERIOD_S = 0.1


def http_requester(address: str) -> Callable[[], object]:
    return lambda: time_request_ms(address, "/state")


@contextmanager
def opcua_requester(port: int) -> Iterator[Callable[[], object]]:
    """Yield a function that reads the state over one OPC UA connection."""
    from asyncua import Client

    async def open_node() -> tuple[Client, Any]:
        client = Client(f"opc.tcp://127.0.0.1:{port}/palpate", watchdog_intervall=600.0)
        await client.connect()
        space = await client.get_namespace_index("urn:palpate:station")
        path = [f"{space}:Station", f"{space}:State"]
        return client, await client.nodes.objects.get_child(path)

    with asyncio.Runner() as runner:
        client, node = runner.run(open_node())
        yield lambda: runner.run(node.read_value())
        runner.run(client.disconnect())


@contextmanager
def modbus_requester(port: int) -> Iterator[Callable[[], object]]:
    """Yield a function that reads the first registers over one Modbus TCP connection."""
    from pymodbus.client import ModbusTcpClient

    with ModbusTcpClient("127.0.0.1", port=port) as client:
        yield lambda: client.read_holding_registers(0, count=4).registers


def time_request_ms(address: str, path: str, *, method: str = "GET") -> float:
    began_s = time.perf_counter()
    request = urllib.request.Request(f"{address}api{path}", method=method)
    with urllib.request.urlopen(request, timeout=10) as reply:
        reply.read()
    return 1e3 * (time.perf_counter() - began_s)


def print_latency(name: str, ms: list[float]) -> None:
    p50, p99 = np.quantile(ms, [0.5, 0.99])
    print(f"{name}: p50 {p50:.1f} ms, p99 {p99:.1f} ms, longest {max(ms):.1f} ms (n {len(ms)})")


def watch(
    address: str,
    pid: int,
    *,
    seconds: float,
    what: str,
    ask: Callable[[], object] | None = None,
    base: tuple[float, float] | None = None,
) -> tuple[float, float]:
    """Measure, print and return processor time (%) and median response (ms).

    `base`: values for the printed ratios.
    """
    from benchmarks.dashboard import devices_of, read_link
    from benchmarks.processes import cpu_s

    while read_link(address)["period_p99_s"] is None:
        time.sleep(REQUEST_PERIOD_S)
    devices, p99_ms, answers_ms, turn = devices_of(pid), [], [], 0
    before, cpu = read_link(address), {name: cpu_s(one) for name, one in _both(pid, devices)}
    began_s = time.monotonic()
    while time.monotonic() < began_s + seconds:
        time.sleep(REQUEST_PERIOD_S)
        turn += 1
        if ask is not None:
            started_s = time.perf_counter()
            ask()
            answers_ms.append(1e3 * (time.perf_counter() - started_s))
        if turn % 10 == 0:
            p99_ms.append(1e3 * read_link(address)["period_p99_s"])
    now, took_s = read_link(address), time.monotonic() - began_s
    cpu_percent = {
        name: 100 * (cpu_s(one) - cpu[name]) / took_s for name, one in _both(pid, devices)
    }
    busy, answer_ms = (
        sum(cpu_percent.values()),
        float(np.median(answers_ms)) if answers_ms else math.nan,
    )
    ratio = "" if base is None else f" ({busy / base[0]:.2f} x)"
    print(
        f"{what}: loop period p99 median {np.median(p99_ms):.2f} ms; "
        f"{now['frames'] - before['frames']:.0f} frames, {now['lost'] - before['lost']:.0f} lost; "
        f"processor: server {cpu_percent['server']:.1f} %, "
        f"devices {cpu_percent['devices']:.1f} %{ratio}; load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    if answers_ms:
        print_latency("  answer", answers_ms)
        if base is not None and not math.isnan(base[1]):
            print(f"  {answer_ms / base[1]:.2f} x HTTP's")
    return busy, answer_ms


def _both(server: int, devices: int) -> tuple[tuple[str, int], ...]:
    return ("server", server), ("devices", devices)


def time_results(port: int, folder: Path, *, count: int) -> None:
    """Measure and print the time of a result from the publisher's call to a subscriber."""
    from packages.station.tests.mosquitto import Subscriber

    from palpate_station.mqtt.broker import Broker
    from palpate_station.mqtt.publisher import Publisher

    subscriber = Subscriber(port, "bench")
    broker = Broker(host="127.0.0.1", port=port, tls=False, topic="bench")
    errors: Queue[str] = Queue()
    publisher = Publisher(broker, store=folder / "bench.sqlite", on_error=errors.put)
    publisher.start()
    subscriber.until("online")
    text, call_ms, arrived_ms = "x" * 3000, [], []
    for number in range(count):
        began_s = time.perf_counter()
        publisher.publish_result({"number": number, "text": text})
        call_ms.append(1e3 * (time.perf_counter() - began_s))
        subscriber.until("result")
        arrived_ms.append(1e3 * (time.perf_counter() - began_s))
    print_latency("publishing a result (a grasp waits for this call)", call_ms)
    print_latency("from the call to a subscriber, through outbox and broker", arrived_ms)
    publisher.close()
    subscriber.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=250.0)
    parser.add_argument("--seconds", type=float, default=30.0, help="for each line")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from benchmarks.dashboard import run_board_process, serve_rig, write_rig
    from packages.station.tests.loop.test_line import free_port
    from packages.station.tests.mosquitto import BrokerProcess

    with (
        tempfile.TemporaryDirectory() as made,
        run_board_process(options.rate_hz) as (line, _),
    ):
        folder = Path(made)
        rig = write_rig(folder, port=line, rate_hz=options.rate_hz)
        watched = partial(watch, seconds=options.seconds)
        with serve_rig(folder, rig) as (address, pid):
            alone, _ = watched(address, pid, what="no bridge")
        broker = BrokerProcess(folder)
        file = folder / "broker.toml"
        file.write_text(f'host = "127.0.0.1"\nport = {broker.port}\ntls = false\ntopic = "a"\n')
        opcua, modbus = free_port(), free_port()
        bridges = ("--mqtt", str(file), "--opcua", str(opcua), "--modbus", str(modbus))
        with serve_rig(folder, rig, *bridges) as (address, pid):
            base = alone, math.nan
            watched(address, pid, what="all bridges, no requests", base=base)
            ask = http_requester(address)
            _, http_ms = watched(address, pid, what="HTTP requests", ask=ask, base=base)
            base = alone, http_ms
            with opcua_requester(opcua) as ask:
                watched(address, pid, what="OPC UA requests", ask=ask, base=base)
            with modbus_requester(modbus) as ask:
                watched(address, pid, what="Modbus TCP requests", ask=ask, base=base)
            broker.suspend()
            ask = http_requester(address)
            watched(address, pid, what="the broker hangs, HTTP requests", ask=ask, base=base)
            print_latency(
                "POST /api/stop",
                [time_request_ms(address, "/stop", method="POST") for _ in range(100)],
            )
            broker.resume()
        time_results(broker.port, folder, count=500)
        broker.kill()


if __name__ == "__main__":
    main()
