"""Time to stop by number of recordings in the folder and of viewers (simulated).

Run `python benchmarks/stop.py`. For each size of the folder it serves one with as many grasps in
its history, opens one and three pages in Chromium, lets a new recording appear every two seconds,
and asks for stops: half over a connection that is kept, half over a new one. The time is from the
request to the answer that the stop reached the hand. The browsers get what the server and the
devices leave of the processors, as if they were on machines of their own. Ends with status 1 if a
99th percentile is above the limit.
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
#: A page in the background is drawn too; stops are asked for at about this period, seconds.
EVERY_S, NEW_S = 0.15, 2.0
#: A file has at most 65 000 names in ext4.
NAMES_PER_FILE = 10_000


def fill(folder: Path, count: int) -> Path:
    """Put recordings with their grasps into a folder; return one of them."""
    from palpate.dashboard.folder import Entry
    from palpate.recording import RecordingWriter
    from palpate.rig import open_rig
    from palpate.rig.recorded import recording_info

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
def arriving(folder: Path, original: Path) -> Iterator[None]:
    """Let a new recording appear now and then, as grasps make them."""
    over = threading.Event()

    def arrive() -> None:
        number = 0
        while not over.wait(NEW_S):
            number += 1
            (folder / f"new-{time.time_ns()}-{number}.mcap").write_bytes(original.read_bytes())

    thread = threading.Thread(target=arrive)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def stop_ms(connection: http.client.HTTPConnection) -> float:
    """Return how long one stop took."""
    began_s = time.perf_counter()
    try:
        connection.request("POST", "/api/stop")
        reply = connection.getresponse()
    except http.client.RemoteDisconnected:  # idle for too long while others were slow
        connection.request("POST", "/api/stop")
        reply = connection.getresponse()
    with reply:
        found = json.load(reply)
    took_ms = 1e3 * (time.perf_counter() - began_s)
    if found != {"stopped": True}:
        raise SystemExit(f"a stop was answered with {found}")
    return took_ms


@contextmanager
def echo() -> Iterator[socket.socket]:
    """Yield a connection to a process that sends every byte back: the machine's own delays."""
    here, there = socket.socketpair()
    program = f"import socket\ns = socket.socket(fileno={there.fileno()})\n"
    program += "while part := s.recv(1): s.send(part)"
    with here, subprocess.Popen([sys.executable, "-c", program], pass_fds=[there.fileno()]):
        there.close()
        yield here
        here.shutdown(socket.SHUT_RDWR)


def echo_ms(connection: socket.socket) -> float:
    """Return how long a byte took to another process and back."""
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
        echoes.append(echo_ms(bare))
        if number % 2:
            found.append(stop_ms(kept))
        else:
            fresh = http.client.HTTPConnection(host, timeout=30)
            found.append(stop_ms(fresh))
            fresh.close()
    kept.close()
    return found, echoes


def step_back(parent: int) -> None:
    """Lower the priority of every thread of a process's children, and of theirs."""
    from benchmarks.dashboard import children_of

    for child in children_of(parent):
        for thread in Path(f"/proc/{child}/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), 19)
        step_back(child)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, nargs="+", default=[10, 1000, 100_000])
    parser.add_argument("--viewers", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--stops", type=int, default=200)
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from benchmarks.dashboard import CHROMIUM, children_of, look, serving
    from playwright.sync_api import sync_playwright

    late = False
    for count in options.recordings:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            original = fill(folder / "data", count)
            os.environ["PALPATE_STORE"] = str(folder / "items.sqlite")
            served = serving(folder / "data", Path("sim-rigid"), "--object", "avocado-day-3")
            address, server = stack.enter_context(served)
            play = stack.enter_context(sync_playwright())
            browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            stack.callback(browser.close)
            for viewers in options.viewers:
                pages = [look(browser, f"{address}recordings") for _ in range(viewers)]
                for child in children_of(os.getpid()):
                    if child != server:
                        step_back(child)
                time.sleep(5.0)
                with arriving(folder / "data", original), echo() as bare:
                    ms, bare_ms = measure(address, count=options.stops, bare=bare)
                for page in pages:
                    page.context.close()
                p50, p90, p99 = np.quantile(ms, [0.5, 0.9, 0.99])
                late |= p99 > LIMIT_MS
                print(
                    f"{count} recordings, {viewers} viewers: median {p50:.0f} ms, p90 {p90:.0f}, "
                    f"p99 {p99:.0f}, longest {max(ms):.0f} (n {len(ms)}); a byte to a process and "
                    f"back p99 {np.quantile(bare_ms, 0.99):.0f}, longest {max(bare_ms):.0f}; "
                    f"load {os.getloadavg()[0]:.1f}",
                    flush=True,
                )
    raise SystemExit(1 if late else 0)


if __name__ == "__main__":
    main()
