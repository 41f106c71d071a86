"""What HTTP and MQTT cost the loop: a board at 250 frames/s, watched, asked and published.

Run `python benchmarks/packhouse.py --seconds 30`. The board is a process at the far end of a
pseudo-terminal (simulated), the broker a real mosquitto. Printed are the loop's period and the
processor time of both processes: alone, with a machine that asks for the state ten times a second,
with a broker besides, and with that broker held up; then how long stops and results take.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from queue import Queue

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
ASKS_S = 0.1


def cpu_s(pid: int) -> float:
    """Return the processor time of a process so far, user and system."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def took_ms(address: str, path: str, *, method: str = "GET") -> float:
    began_s = time.perf_counter()
    request = urllib.request.Request(f"{address}api{path}", method=method)
    with urllib.request.urlopen(request, timeout=10) as reply:
        reply.read()
    return 1e3 * (time.perf_counter() - began_s)


def shown(name: str, ms: list[float]) -> None:
    p50, p99 = np.quantile(ms, [0.5, 0.99])
    print(f"{name}: p50 {p50:.1f} ms, p99 {p99:.1f} ms, longest {max(ms):.1f} ms (n {len(ms)})")


def watch(address: str, pid: int, *, seconds: float, asks: bool, what: str) -> None:
    from benchmarks.dashboard import devices_of, link

    while link(address)["period_p99_s"] is None:
        time.sleep(ASKS_S)
    devices, p99_ms, asked_ms, turn = devices_of(pid), [], [], 0
    before, cpu = link(address), {name: cpu_s(one) for name, one in _both(pid, devices)}
    began_s = time.monotonic()
    while time.monotonic() < began_s + seconds:
        time.sleep(ASKS_S)
        turn += 1
        if asks:
            asked_ms.append(took_ms(address, "/state"))
        if turn % 10 == 0:
            p99_ms.append(1e3 * link(address)["period_p99_s"])
    now, took_s = link(address), time.monotonic() - began_s
    share = {name: 100 * (cpu_s(one) - cpu[name]) / took_s for name, one in _both(pid, devices)}
    print(
        f"{what}: loop period p99 median {np.median(p99_ms):.2f} ms; "
        f"{now['frames'] - before['frames']:.0f} frames, {now['lost'] - before['lost']:.0f} lost; "
        f"processor: server {share['server']:.1f} %, devices {share['devices']:.1f} %; "
        f"load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    if asked_ms:
        shown("  GET /api/state", asked_ms)


def _both(server: int, devices: int) -> tuple[tuple[str, int], ...]:
    return ("server", server), ("devices", devices)


def results(port: int, folder: Path, *, count: int) -> None:
    """Print how long a result takes from the publisher's call to a subscriber."""
    from tests.mosquitto import Subscriber

    from palpate.mqtt.broker import Broker
    from palpate.mqtt.publisher import Publisher

    listening = Subscriber(port, "bench")
    broker = Broker(host="127.0.0.1", port=port, tls=False, topic="bench")
    complaints: Queue[str] = Queue()
    publisher = Publisher(broker, store=folder / "bench.sqlite", complain=complaints.put)
    listening.until("online")
    text, call_ms, arrived_ms = "x" * 3000, [], []
    for number in range(count):
        began_s = time.perf_counter()
        publisher.result({"number": number, "text": text})
        call_ms.append(1e3 * (time.perf_counter() - began_s))
        listening.until("result")
        arrived_ms.append(1e3 * (time.perf_counter() - began_s))
    shown("handing over a result (what a grasp waits for)", call_ms)
    shown("from there to a subscriber, through outbox and broker", arrived_ms)
    publisher.close()
    listening.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=250.0)
    parser.add_argument("--seconds", type=float, default=30.0, help="for each line")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from benchmarks.dashboard import board_on_a_line, serving, write_rig
    from tests.mosquitto import BrokerProcess

    with (
        tempfile.TemporaryDirectory() as made,
        board_on_a_line(options.rate_hz) as (line, _),
    ):
        folder = Path(made)
        rig = write_rig(folder, port=line, rate_hz=options.rate_hz)
        with serving(folder, rig) as (address, pid):
            watch(address, pid, seconds=options.seconds, asks=False, what="alone")
            watch(address, pid, seconds=options.seconds, asks=True, what="asked")
        broker = BrokerProcess(folder)
        file = folder / "broker.toml"
        file.write_text(f'host = "127.0.0.1"\nport = {broker.port}\ntls = false\ntopic = "a"\n')
        with serving(folder, rig, "--mqtt", str(file)) as (address, pid):
            watch(address, pid, seconds=options.seconds, asks=True, what="with a broker")
            broker.hang()
            watch(address, pid, seconds=options.seconds, asks=True, what="the broker hangs")
            shown("POST /api/stop", [took_ms(address, "/stop", method="POST") for _ in range(100)])
            broker.go_on()
        results(broker.port, folder, count=500)
        broker.kill()


if __name__ == "__main__":
    main()
