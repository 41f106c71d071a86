"""Time of a stop while many clients misbehave (simulated rig).

Run `python benchmarks/stop_flood.py`. For each kind of client it requests stops over new
connections. The time is from the connection to the answer that the stop reached the hand. The
clients have the lowest priority, as if they ran on other machines. The exit status is 1 if a stop
took longer than the limit.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import http.client
import multiprocessing
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

LIMIT_MS = 500.0
CLIENTS, RECONNECTING = 1100, 100
#: Mean period of the stops, seconds, and time for the clients to connect.
EVERY_S, CONNECT_S = 0.2, 5.0
#: Files that the clients' process may open.
_FILES = 8192


async def send_slowly(port: int) -> None:
    """Send a body byte by byte."""
    _, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(_request("POST", "/api/grasp", "Content-Length: 1000"))
    while not writer.is_closing():
        await asyncio.sleep(0.5)
        writer.write(b" ")
        await writer.drain()


async def read_nothing(port: int) -> None:
    """Request a page and read nothing of it."""
    _, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    writer.write(_request("GET", "/"))
    await asyncio.sleep(random.uniform(10.0, 15.0))
    writer.transport.abort()


async def read_no_messages(port: int) -> None:
    """Open a WebSocket and read nothing of it."""
    _, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    key = base64.b64encode(random.randbytes(16)).decode()
    writer.write(
        _request(
            "GET",
            "/_nicegui_ws/socket.io/?EIO=4&transport=websocket",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Key: {key}",
        )
    )
    await asyncio.sleep(15.0)
    writer.transport.abort()


async def reconnect(port: int) -> None:
    """Request the state and disconnect at once."""
    _, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(_request("GET", "/live"))
    writer.transport.abort()


#: Kinds of clients, and how many.
KINDS: dict[str, tuple[Callable[[int], Awaitable[None]], int]] = {
    "slow bodies": (send_slowly, CLIENTS),
    "unread pages": (read_nothing, CLIENTS),
    "unread WebSockets": (read_no_messages, CLIENTS),
    "reconnecting": (reconnect, RECONNECTING),
}


def _request(method: str, path: str, *headers: str) -> bytes:
    lines = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1", *headers]
    return "\r\n".join([*lines, "", ""]).encode()


def misbehave(kind: str, port: int) -> None:
    """Run the clients of a kind until the process is ended."""
    os.nice(19)
    resource.setrlimit(resource.RLIMIT_NOFILE, (_FILES, _FILES))
    client, count = KINDS[kind]

    async def repeat() -> None:
        while True:
            with suppress(OSError):
                await client(port)
            await asyncio.sleep(0)

    async def run() -> None:
        await asyncio.gather(*(repeat() for _ in range(count)))

    asyncio.run(run())


def time_stops(port: int, duration_s: float) -> list[float]:
    """Request stops for a time; return how long each took, ms."""
    took_ms, end_s = list[float](), time.monotonic() + duration_s
    while time.monotonic() < end_s:
        begin_s = time.monotonic()
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
        connection.request("POST", "/stop")
        assert connection.getresponse().status == 200
        connection.close()
        took_ms.append(1e3 * (time.monotonic() - begin_s))
        time.sleep(EVERY_S * random.uniform(0.5, 1.5))
    return took_ms


def main() -> int:
    """Print a line for each kind of client."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="duration for each kind")
    duration_s = parser.parse_args().seconds
    worst_ms = 0.0
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve"]
        options = ["--port", "0", "--folder", name, "--store", str(Path(name, "items.sqlite"))]
        with subprocess.Popen(
            [*command, "--rig", "sim-rigid", *options], stdout=subprocess.PIPE, text=True
        ) as server:
            assert server.stdout is not None
            address = next(word for word in server.stdout.readline().split() if "http" in word)
            port = urlsplit(address).port
            assert port is not None
            for kind in ("none", *KINDS):
                clients = multiprocessing.Process(target=misbehave, args=(kind, port), daemon=True)
                if kind != "none":
                    clients.start()
                    time.sleep(CONNECT_S)
                took_ms = time_stops(port, duration_s)
                if kind != "none":
                    clients.kill()
                    clients.join()
                middle, high, most = np.quantile(took_ms, [0.5, 0.95, 1.0])
                worst_ms = max(worst_ms, most)
                shown = f"median {middle:.0f} ms, 95 % {high:.0f} ms, largest {most:.0f} ms"
                print(f"{kind:<20} {len(took_ms)} stops: {shown}", flush=True)
            server.terminate()
    return int(worst_ms > LIMIT_MS)


if __name__ == "__main__":
    sys.exit(main())
