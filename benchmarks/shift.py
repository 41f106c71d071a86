"""A shift on a simulated rig by the wall clock, driven over HTTP as a line does.

    python benchmarks/shift.py --minutes 60 --folder shift

Starts `palpate serve` in a folder, with rules, a store and `--keep-days`. Each period a new item
arrives: its label is scanned, it is grasped, its bin is read while it is held, it is carried for a
second and released, and the stored result is read. If the bin is provisional, the item is grasped
again. With `--page chromium`, a browser shows the operator's page meanwhile.

`items.csv` has one row per grasp, `samples.csv` one per ten seconds, `serve.log` the station's log.
The output is a table: latencies, memory, processor time, disk, alarms and faults. A fault of one
item does not end the run. The exit status is 1 if an item is missing in the store or differs from
the result over HTTP.
"""

from __future__ import annotations

import argparse
import csv
import http.client
import json
import os
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from threading import Event, Thread
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from palpate_station.store import Store
from processes import cpu_s, list_tree, proportional_mb, resident_mb

RULES = """
default = "by hand"
confidence = 0.8
most_grasps = 2
require_item = true

[[rule]]
bin = "small"
size_mm = [0, 63]

[[rule]]
bin = "large"
size_mm = [63, 90]
"""
POLL_S, SAMPLE_S, PATIENCE_S = 0.02, 10.0, 60.0
#: Time for which an item is carried before its release, seconds.
CARRY_S = 1.0
LATENCIES = {
    "touch_s": "order to contact",
    "answer_s": "order to answer",
    "readable_s": "answer to bin readable",
    "result_s": "end of the grasp to stored result readable",
    "cycle_s": "order to ready for the next",
}


class FaultError(Exception):
    """An item that a line would have to put aside."""


class Station:
    """The HTTP interface of a station, over one connection that is kept open."""

    def __init__(self, address: str) -> None:
        self._connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=10)
        self._asked_s = time.monotonic()

    def ask(self, method: str, path: str, body: object = None) -> tuple[int, Any]:
        """Return status and document of a request; a lost connection is opened again next time."""
        # The server closes a connection after 5 s without a request.
        if time.monotonic() - self._asked_s > 2.0:
            self._connection.close()
        try:
            self._connection.request(
                method,
                path,
                body=None if body is None else json.dumps(body),
                headers={"Content-Type": "application/json"},
            )
            reply = self._connection.getresponse()
            text = reply.read()
        except (OSError, http.client.HTTPException):
            self._connection.close()
            raise
        self._asked_s = time.monotonic()
        return reply.status, json.loads(text) if text else None

    def order(self, path: str, body: object = None) -> Any:
        """Send an order, which must be accepted."""
        status, found = self.ask("POST", f"/api/v1{path}", body)
        if status != 202:
            raise FaultError(f"{path} refused ({status}): {found['detail']}")
        return found

    def state(self) -> dict[str, Any]:
        status, found = self.ask("GET", "/api/v1/state")
        if status != 200:
            raise FaultError(f"no state: {status}")
        state: dict[str, Any] = found
        return state

    def wait(self, reached: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Poll the state until a condition holds."""
        until_s = time.monotonic() + PATIENCE_S
        while not reached(state := self.state()):
            if time.monotonic() > until_s:
                raise FaultError(f"waited {PATIENCE_S:g} s in {state['state']}: {state['trouble']}")
            time.sleep(POLL_S)
        return state

    def wait_until_idle(self) -> dict[str, Any]:
        """Wait until a grasp can start; open a hand that was left closed."""
        state = self.wait(lambda at: at["state"] in ("idle", "stopped", "holding", "aborted"))
        if state["state"] in ("stopped", "holding", "aborted") and state["fresh"]:
            self.ask("POST", "/api/v1/release")
        return self.wait(lambda at: at["state"] == "idle")


def run_grasp(station: Station, label: str) -> dict[str, Any]:
    """Grasp an item, read its bin while it is held, release it, and return what was seen."""
    ready = station.wait_until_idle()
    at_s = {"order": time.monotonic()}
    started = station.order("/grasp", {"item_id": label, "stops": ready["stops"]})

    def is_over(state: dict[str, Any]) -> bool:
        phase, now_s = state["phase"], time.monotonic()
        if phase in ("contact", "squeeze", "settle", "hold"):
            at_s.setdefault("touch", now_s)
        if phase == "hold":
            at_s.setdefault("answer", now_s)
        return bool(state["state"] != "execute")

    state = station.wait(is_over)
    held = state["held"] or {}
    if held:
        at_s["readable"] = time.monotonic()
        time.sleep(CARRY_S)
        # The hand opens by itself after its longest hold.
        station.order("/release")
    idle = station.wait(lambda at: at["state"] != "execute" and at["activity"] == "watching")
    at_s["idle"] = time.monotonic()
    until_s = at_s["idle"] + PATIENCE_S
    while True:
        status, result = station.ask("GET", "/api/v1/result")
        if status == 200 and result["recording"] == started["recording"]:
            break
        if time.monotonic() > until_s:
            raise FaultError(f"no result of {started['recording']}: {idle['trouble']}")
        time.sleep(POLL_S)
    at_s["result"], ended_s = time.monotonic(), time.time()
    ended_s -= datetime.fromisoformat(result["ended_at"]).timestamp()
    moments = {one["name"]: one["time_s"] for one in result["moments"]}
    seen_bin, stored_bin = held.get("bin"), (result["bin"] or {}).get("name")
    return {
        "recording": started["recording"],
        "item": result["item_id"],
        "outcome": result["outcome"],
        "bin": stored_bin,
        "again": held.get("again", False),
        "same": not held or (seen_bin == stored_bin and held["item_id"] == result["item_id"]),
        "stored": result["stored"],
        "touch_s": _between(at_s, "order", "touch"),
        "answer_s": _between(at_s, "order", "answer"),
        "readable_s": _between(at_s, "answer", "readable"),
        "result_s": ended_s,
        "cycle_s": at_s["result"] - at_s["order"],
        # Answer on the rig's clock, and when it was readable on the client's.
        "answer_rig_s": moments.get("answer"),
        "readable_client_s": at_s.get("readable"),
    }


def _between(at_s: dict[str, float], first: str, second: str) -> float | None:
    return at_s[second] - at_s[first] if first in at_s and second in at_s else None


def run_items(
    address: str, folder: Path, *, until_s: float, period_s: float, most_items: int | None
) -> tuple[list[dict[str, Any]], list[str]]:
    """Bring items until a time; return a row per grasp, and the faults."""
    rows, faults, station = list[dict[str, Any]](), list[str](), Station(address)
    due_s = time.monotonic()
    with (folder / "items.csv").open("w", newline="") as file:
        table: csv.DictWriter[str] | None = None
        number = 0
        while time.monotonic() < until_s and (most_items is None or number < most_items):
            number += 1
            for _ in range(2):
                try:
                    # A GS1-128 label as a scanner sends it: GTIN and serial number.
                    row = {"number": number, "at_s": time.time()}
                    row |= run_grasp(station, f"]C1010401234500001621A{number:04d}")
                except Exception as error:
                    faults.append(f"{time.strftime('%H:%M:%S')} item {number}: {error!r}")
                    print(faults[-1], flush=True)
                    if not isinstance(error, FaultError | OSError | http.client.HTTPException):
                        traceback.print_exc()
                    time.sleep(1.0)
                    break
                if table is None:
                    table = csv.DictWriter(file, list(row))
                    table.writeheader()
                table.writerow(row)
                file.flush()
                rows.append(row)
                if not row["again"]:
                    break
            due_s = max(due_s + period_s, time.monotonic())
            time.sleep(max(due_s - time.monotonic(), 0.0))
    return rows, faults


class Sampler(Thread):
    """Samples memory, processor time, disk and alarms.

    The memory of server and devices is resident; that of the browser counts shared pages once.
    """

    def __init__(self, address: str, server: int, folder: Path) -> None:
        super().__init__(daemon=True)
        self._address, self._server, self._folder = address, server, folder
        self.ended = Event()
        self.samples: list[dict[str, float]] = []
        #: Time and text of the alarms of the page, with the number of samples that listed them.
        self.alarms = Counter[tuple[str, str]]()
        self.alarm_count = 0
        #: Samples without a healthy station.
        self.unhealthy: list[str] = []

    def run(self) -> None:
        station, began_s = Station(self._address), time.monotonic()
        with (self._folder / "samples.csv").open("w", newline="") as file:
            table: csv.DictWriter[str] | None = None
            while not self.ended.is_set():
                try:
                    sample = self._sample(station, time.monotonic() - began_s)
                except (OSError, http.client.HTTPException) as error:
                    self.unhealthy.append(f"{time.strftime('%H:%M:%S')} {error!r}")
                else:
                    self.samples.append(sample)
                    if table is None:
                        table = csv.DictWriter(file, list(sample))
                        table.writeheader()
                    table.writerow(sample)
                    file.flush()
                self.ended.wait(SAMPLE_S)

    def _sample(self, station: Station, at_s: float) -> dict[str, float]:
        _, live = station.ask("GET", "/live?after_s=1e12")
        status, health = station.ask("GET", "/api/v1/health")
        if status != 200:
            self.unhealthy.append(f"{time.strftime('%H:%M:%S')} {health['problems']}")
        self.alarm_count = live["alarm_count"]
        self.alarms.update((at, text) for at, text in live["alarms"])
        pids = list_tree(self._server)
        devices = max(pids[1:], key=resident_mb)
        recordings = [file.stat().st_size for file in (self._folder / "data").glob("*.mcap")]
        browser = [one for one in list_tree(os.getpid())[1:] if one not in pids]
        return {
            "at_s": round(at_s, 1),
            "server_mb": resident_mb(self._server),
            "devices_mb": resident_mb(devices),
            "browser_mb": sum(map(proportional_mb, browser)),
            "server_cpu_s": cpu_s(self._server),
            "devices_cpu_s": cpu_s(devices),
            "threads": len(list(Path(f"/proc/{self._server}/task").iterdir())),
            "files": len(list(Path(f"/proc/{self._server}/fd").iterdir())),
            "frames_lost": live["link"]["lost"],
            "period_worst_s": live["link"]["period_worst_s"],
            "recordings": len(recordings),
            "recordings_mb": sum(recordings) / 1e6,
            "store_mb": sum(
                file.stat().st_size for file in self._folder.glob("items.sqlite*") if file.exists()
            )
            / 1e6,
            "load": os.getloadavg()[0],
        }


@contextmanager
def show_page(browser: str | None, address: str, folder: Path) -> Iterator[None]:
    """Show the operator's page in a browser without a screen, and without a tool that records."""
    if browser is None:
        yield
        return
    command = [browser, "--headless=new", "--disable-gpu", f"--user-data-dir={folder}/browser"]
    if os.geteuid() == 0:
        command.append("--no-sandbox")
    with (
        (folder / "browser.log").open("w") as log,
        subprocess.Popen([*command, f"{address}operate"], stdout=log, stderr=log) as process,
    ):
        try:
            yield
        finally:
            process.terminate()


@contextmanager
def serve(folder: Path, *options: str) -> Iterator[tuple[str, int]]:
    """Run a station in a folder; yield its address and process."""
    (folder / "rules.toml").write_text(RULES)
    command = [sys.executable, "-m", "palpate", "serve", "--rig", "sim-rigid", "--port", "0"]
    command += ["--folder", "data", "--store", "items.sqlite", "--rules", "rules.toml", *options]
    with (
        (folder / "serve.log").open("w") as log,
        subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True
        ) as process,
    ):
        try:
            assert process.stdout is not None
            words = process.stdout.readline().split()
            address = next((word for word in words if word.startswith("http")), None)
            if address is None:
                sys.exit((folder / "serve.log").read_text())
            yield address, process.pid
        finally:
            process.terminate()


def compare_store(folder: Path, rows: list[dict[str, Any]]) -> list[str]:
    """Return the differences between the store and the results over HTTP."""
    with Store.open(folder / "items.sqlite") as store:
        grasps = list(store.grasps())
        bins = {
            item: [verdict.text for verdict in store.verdicts_of(item) if verdict.about == "bin"]
            for item in {row["item"] for row in rows}
        }
    stored = Counter(grasp.item_id for grasp in grasps)
    found = []
    for item, count in Counter(row["item"] for row in rows).items():
        if stored[item] != count:
            found.append(f"{item}: {count} grasps, {stored[item]} in the store")
        last = next(row["bin"] for row in reversed(rows) if row["item"] == item)
        if last is not None and last != bins[item][-1]:
            found.append(f"{item}: bin {last}, in the store {bins[item]}")
    found += [f"{item}: only in the store" for item in stored.keys() - {r["item"] for r in rows}]
    found += [f"{row['item']}: differs over HTTP" for row in rows if not row["same"]]
    return found + [f"{row['item']}: not stored" for row in rows if not row["stored"]]


def print_table(rows: list[dict[str, Any]], sampler: Sampler) -> None:
    """Print latencies, memory, processor time and disk."""
    print(f"\n{'':44} {'n':>5} {'p50':>8} {'p95':>8} {'p99':>8} {'longest':>8}")
    for name, title in LATENCIES.items():
        values = [row[name] for row in rows if row[name] is not None]
        if values:
            p50, p95, p99 = np.quantile(values, [0.5, 0.95, 0.99])
            cells = " ".join(f"{one:8.3f}" for one in (p50, p95, p99, max(values)))
            print(f"{title + ', s':44} {len(values):5} {cells}")
    samples = sampler.samples
    if not samples:
        return
    names = (
        *("server_mb", "devices_mb", "browser_mb", "threads", "files", "frames_lost"),
        *("recordings", "recordings_mb", "store_mb", "load"),
    )
    marks = [*(one for one in (1, 5, 15, 30, 45) if 60 * one < samples[-1]["at_s"] - 30)]
    chosen = [min(samples, key=lambda one: abs(one["at_s"] - 60 * mark)) for mark in marks]
    chosen.append(samples[-1])
    heads = " ".join(f"{one['at_s'] / 60:7.0f}'" for one in chosen)
    print(f"\n{'after minutes':20} {heads}")
    for name in names:
        print(f"{name:20} " + " ".join(f"{one[name]:8.1f}" for one in chosen))
    first, last = samples[0], samples[-1]
    spent_s = max(last["at_s"] - first["at_s"], 1.0)
    for name in ("server", "devices"):
        used_s = last[f"{name}_cpu_s"] - first[f"{name}_cpu_s"]
        print(f"processor, {name}: {100 * used_s / spent_s:.1f} % of a core")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--items", type=int, help="end after this number of items")
    parser.add_argument("--period", type=float, default=9.0, help="of the items, seconds")
    parser.add_argument("--object", default="avocado-day-3", help="kind of simulated fruit")
    parser.add_argument("--keep-days", default="0.04", help="of the recordings (58 minutes)")
    parser.add_argument("--folder", type=Path, default=Path("shift"), help="new folder")
    parser.add_argument("--page", metavar="CHROMIUM", help="show the operator's page in it")
    options = parser.parse_args()
    options.folder.mkdir(parents=True)
    folder = options.folder.absolute()
    kept = ("--object", options.object, "--keep-days", options.keep_days)
    began_s = time.monotonic()
    with ExitStack() as stack:
        address, server = stack.enter_context(serve(folder, *kept))
        print(f"{address}, process {server}", flush=True)
        Station(address).wait(lambda at: at["state"] == "idle")
        stack.enter_context(show_page(options.page, address, folder))
        sampler = Sampler(address, server, folder)
        sampler.start()
        rows, faults = run_items(
            address,
            folder,
            until_s=began_s + 60 * options.minutes,
            period_s=options.period,
            most_items=options.items,
        )
        time.sleep(min(SAMPLE_S, options.period))
        sampler.ended.set()
        sampler.join(60.0)
    differences = compare_store(folder, rows)
    outcomes = Counter(str(row["outcome"]) for row in rows)
    bins = Counter(str(row["bin"]) for row in rows if not row["again"])
    minutes = (time.monotonic() - began_s) / 60
    print(
        f"{len({row['number'] for row in rows})} items, {len(rows)} grasps in {minutes:.0f} min; "
        f"outcomes {dict(outcomes)}; bins {dict(bins)}; {len(faults)} faults"
    )
    print_table(rows, sampler)
    log = (folder / "serve.log").read_text().splitlines()
    errors = [line for line in log if " INFO " not in line]
    for title, lines in {
        f"alarms: {sampler.alarm_count}": [f"{at} {text}" for at, text in sampler.alarms],
        f"not healthy: {len(sampler.unhealthy)} samples": sampler.unhealthy,
        f"log: {len(errors)} lines above INFO": errors,
        f"faults: {len(faults)}": faults,
        f"store and HTTP: {len(differences)} differences": differences,
    }.items():
        print("\n" + title, *lines[:50], sep="\n  ")
    sys.exit(bool(differences))


if __name__ == "__main__":
    main()
