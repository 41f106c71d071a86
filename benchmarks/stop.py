"""Time of a stop by number of recordings and viewers (simulated).

Run `python benchmarks/stop.py`. For each number of recordings, it serves a folder with as many
grasps in its history, opens one and three pages in Chromium, adds a recording every two seconds,
and requests stops, half over a persistent connection and half over new ones. The time is from the
request to the answer that the stop reached the hand. The browsers have the lowest priority, as if
they ran on other machines. The exit status is 1 if a 99th percentile is above the limit.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
LIMIT_MS = 60.0
#: Mean period of the stops, and period of new recordings, seconds.
EVERY_S, NEW_S = 0.15, 2.0
#: Hard links per file; ext4 allows 65 000.
NAMES_PER_FILE = 10_000


def fill(folder: Path, count: int) -> Path:
    """Create recordings and their grasps in a folder; return one recording."""
    from palpate.recording import RecordingWriter
    from palpate.rig import open_rig
    from palpate.rig.recorded import recording_info
    from palpate_station.dashboard.folder import Entry

    folder.mkdir(parents=True)
    rig, original = open_rig("sim-rigid"), folder.parent / "original.mcap"
    with RecordingWriter(original, info=recording_info(rig, seed=0)) as writer:
        for _ in range(15):
            writer.add(rig.array.read(timeout_s=1.0))
    rig.close()
    content = original.read_bytes()
    with (folder / "grasps.jsonl").open("w", encoding="utf-8") as lines:
        for number in range(count):
            file = folder / f"grasp-{number:06d}.mcap"
            if number % NAMES_PER_FILE == 0:
                first = file
                file.write_bytes(content)
            else:
                os.link(first, file)
            entry = Entry(
                ended_at="2026-01-02T03:04:05+00:00",
                recording=file.name,
                simulated=True,
                item_id=f"berry-{number}",
                outcome="held",
                verdict="held and released",
                firmness="soft",
                kind="good",
                measured={"force_n": 2.5, "force_n_low": 2.0, "force_n_high": 3.0},
                curve=tuple(round(0.05 * n, 2) for n in range(48)),
            )
            lines.write(json.dumps(asdict(entry)) + "\n")
    return original


@contextmanager
def add_recordings_periodically(folder: Path, original: Path) -> Iterator[None]:
    """Add a recording periodically, like grasps."""
    over = threading.Event()

    def write_periodically() -> None:
        number = 0
        while not over.wait(NEW_S):
            number += 1
            (folder / f"new-{time.time_ns()}-{number}.mcap").write_bytes(original.read_bytes())

    thread = threading.Thread(target=write_periodically)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def time_stop_ms(connection: http.client.HTTPConnection) -> float:
    """Return the duration of one stop."""
    began_s = time.perf_counter()
    try:
        connection.request("POST", "/api/stop")
        reply = connection.getresponse()
    except http.client.RemoteDisconnected:  # the server closed the idle connection
        connection.request("POST", "/api/stop")
        reply = connection.getresponse()
    with reply:
        found = json.load(reply)
    took_ms = 1e3 * (time.perf_counter() - began_s)
    if found != {"stopped": True}:
        raise SystemExit(f"unexpected answer to a stop: {found}")
    return took_ms


@contextmanager
def open_echo() -> Iterator[socket.socket]:
    """Yield a connection to an echo process, to measure delays of the machine."""
    here, there = socket.socketpair()
    program = f"import socket\ns = socket.socket(fileno={there.fileno()})\n"
    program += "while part := s.recv(1): s.send(part)"
    with here, subprocess.Popen([sys.executable, "-c", program], pass_fds=[there.fileno()]):
        there.close()
        yield here
        here.shutdown(socket.SHUT_RDWR)


def time_echo_ms(connection: socket.socket) -> float:
    """Return the round-trip time of one byte."""
    began_s = time.perf_counter()
    connection.send(b"x")
    connection.recv(1)
    return 1e3 * (time.perf_counter() - began_s)


def measure(address: str, *, count: int, bare: socket.socket) -> tuple[list[float], list[float]]:
    """Request stops at irregular times; return each duration and round trip, ms."""
    host, moments, echoes = urlsplit(address).netloc, np.random.default_rng(1), []
    kept, found = http.client.HTTPConnection(host, timeout=30), []
    for number in range(count):
        time.sleep(float(moments.uniform(0.5, 1.5)) * EVERY_S)
        echoes.append(time_echo_ms(bare))
        if number % 2:
            found.append(time_stop_ms(kept))
        else:
            fresh = http.client.HTTPConnection(host, timeout=30)
            found.append(time_stop_ms(fresh))
            fresh.close()
    kept.close()
    return found, echoes


def lower_priority(parent: int) -> None:
    """Lower the priority of all threads of a process's descendants."""
    from benchmarks.processes import children_of

    for child in children_of(parent):
        for thread in Path(f"/proc/{child}/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), 19)
        lower_priority(child)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, nargs="+", default=[10, 1000, 100_000])
    parser.add_argument("--viewers", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--stops", type=int, default=200)
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from benchmarks.dashboard import CHROMIUM, open_page, serve_rig
    from benchmarks.processes import children_of
    from playwright.sync_api import sync_playwright

    late = False
    for count in options.recordings:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            original = fill(folder / "data", count)
            os.environ["PALPATE_STORE"] = str(folder / "items.sqlite")
            served = serve_rig(folder / "data", Path("sim-rigid"), "--object", "avocado-day-3")
            address, server = stack.enter_context(served)
            play = stack.enter_context(sync_playwright())
            browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            stack.callback(browser.close)
            for viewers in options.viewers:
                pages = [open_page(browser, f"{address}recordings") for _ in range(viewers)]
                for child in children_of(os.getpid()):
                    if child != server:
                        lower_priority(child)
                time.sleep(5.0)
                with add_recordings_periodically(folder / "data", original), open_echo() as bare:
                    ms, bare_ms = measure(address, count=options.stops, bare=bare)
                for page in pages:
                    page.context.close()
                p50, p90, p99 = np.quantile(ms, [0.5, 0.9, 0.99])
                late |= p99 > LIMIT_MS
                print(
                    f"{count} recordings, {viewers} viewers: median {p50:.0f} ms, p90 {p90:.0f}, "
                    f"p99 {p99:.0f}, longest {max(ms):.0f} (n {len(ms)}); round trip of a byte to "
                    f"a process p99 {np.quantile(bare_ms, 0.99):.0f}, longest {max(bare_ms):.0f}; "
                    f"load {os.getloadavg()[0]:.1f}",
                    flush=True,
                )
    raise SystemExit(1 if late else 0)


if __name__ == "__main__":
    main()
