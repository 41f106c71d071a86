"""Load of viewers on the server: a board at 500 frames/s, recorded and watched.

Run `python benchmarks/dashboard.py --seconds 600`. A simulated board sends frames through a
pseudo-terminal to `palpate serve`, which records them: without viewers, with one and with three
pages in Chromium, and without viewers again. It reports the period of the loop, processor time and
memory of both processes, the redraws of each page with the age of its frames and its long tasks,
and whether the recording is complete.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from benchmarks.processes import children_of, cpu_s, resident_mb
from playwright.sync_api import Browser, Page, sync_playwright

from palpate.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.recording import load_recording
from palpate.sensor.array import RIGID_LAYOUT

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM = "/usr/bin/chromium"
PATIENCE_MS = 300_000


class StillHand:
    """A gripper that stays open."""

    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)

    def state(self) -> GripperState:
        return GripperState(time_s=time.monotonic(), width_mm=74.0)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        return wanted

    def stop(self) -> None:
        return

    def release(self) -> None:
        return

    def close(self) -> None:
        return


def write_rig(folder: Path, *, port: str, rate_hz: float) -> Path:
    """Write a rig file for a board on a port, with an open gripper."""
    ohm = tuple((11_000.0,) * RIGID_LAYOUT.cols for _ in range(RIGID_LAYOUT.rows))
    still = tuple((0.1,) * RIGID_LAYOUT.cols for _ in range(RIGID_LAYOUT.rows))
    Calibration(
        sensor_id="board",
        origin="hardware",
        layout=RIGID_LAYOUT,
        rest=RestValues(ohm=ohm, spread_percent=still, frames=100),
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
    ).save(folder / "calibration.json")
    rig = folder / "rig.toml"
    rig.write_text(
        'calibration = "calibration.json"\n'
        f'[array]\nopen = "palpate.sensor.board_array:open_board"\nport = "{port}"\n'
        f'rate_hz = {rate_hz}\n[gripper]\nopen = "benchmarks.dashboard:StillHand"\n'
    )
    return rig


def run_flexitac_board(rate_hz: float) -> AbstractContextManager[tuple[str, int]]:
    """Run a board of 12 x 32 pixels in a process; return port and process."""
    from palpate_studies.benchmarks.pty_board import run_on_port

    def send(master: int) -> None:
        os.set_blocking(master, False)
        start_s, pixels = time.monotonic(), np.random.default_rng(1).integers(20, 90, 384)
        for sent in itertools.count():
            time.sleep(max(start_s + sent / rate_hz - time.monotonic(), 0.0))
            pixels[sent % 384] = 20 + sent % 70
            with suppress(BlockingIOError):  # without a reader the frame is lost, as on a real port
                os.write(master, b"\xaa\x55" + pixels.astype(np.uint8).tobytes())

    return run_on_port(send)


def watch_flexitac(*, rate_hz: float, seconds: float) -> None:
    """Measure and print the load of 384 pixels on the page, with one viewer."""
    with (
        tempfile.TemporaryDirectory() as folder,
        run_flexitac_board(rate_hz) as (port, _),
        sync_playwright() as play,
        play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser,
    ):
        rig = Path(folder, "rig.toml")
        rig.write_text(f'[array]\nopen = "palpate.sensor.flexitac:open_board"\nport = "{port}"\n')
        with serve_rig(Path(folder), rig) as (address, pid):
            page = open_page(browser, address)
            processes = {"server": pid, "devices": devices_of(pid)}
            page.evaluate(_COUNT_REDRAWS)
            before, cpu = read_link(address), [cpu_s(one) for one in processes.values()]
            shown_s, began_s = browser_cpu_s(), time.monotonic()
            time.sleep(seconds)
            ages_ms, made = page.evaluate("[window.ages, window.made]")
            now, took_s = read_link(address), time.monotonic() - began_s
            spent = [cpu_s(one) for one in processes.values()]
            busy = [100 * (end - begin) / took_s for begin, end in zip(cpu, spent, strict=True)]
            busy.append(100 * (browser_cpu_s() - shown_s) / took_s)
            p50, p99 = np.quantile(ages_ms, [0.5, 0.99])
            print(
                f"12 x 32 pixels at {rate_hz:g} frames/s, one viewer: "
                f"{len(ages_ms) / took_s:.1f} redraws a second, {made / len(ages_ms):.1f} nodes "
                f"created for each; age of the frame when drawn p50 {p50:.0f} ms, "
                f"p99 {p99:.0f} ms; "
                f"{now['frames'] - before['frames']:.0f} frames in {took_s:.0f} s, "
                f"{now['lost'] - before['lost']:.0f} lost; processor: server {busy[0]:.1f} %, "
                f"devices {busy[1]:.1f} %, browser {busy[2]:.0f} %; load {os.getloadavg()[0]:.1f}"
            )


#: Records the age of the frame (ms, as shown on the page) and the created nodes at each redraw, and
#: the long tasks (above 50 ms) of the main thread.
_COUNT_REDRAWS = """() => {
  const noted = window.ages !== undefined;
  [window.ages, window.made, window.long] = [[], 0, []];
  if (noted) return;
  new PerformanceObserver((list) => {
    for (const one of list.getEntries()) window.long.push(one.duration);
  }).observe({ type: "longtask" });
  const age = document.getElementById("link-age");
  new MutationObserver(() => {
    const [, number, unit] = age.textContent.match(/([\\d.]+) (ms|s) ago/) ?? [];
    if (number) window.ages.push(+number * (unit === "s" ? 1000 : 1));
  }).observe(document.body, { attributes: true, attributeFilter: ["data-drawn"] });
  new MutationObserver((list) => {
    for (const one of list) window.made += one.addedNodes.length;
  }).observe(document.getElementById("fingers"), { childList: true, subtree: true });
}"""


def browser_cpu_s() -> float:
    """Return the processor time of the browser that this process started."""
    found, left = 0.0, children_of(os.getpid())
    while left:
        pid = left.pop()
        left += children_of(pid)
        if b"chromium" in Path(f"/proc/{pid}/cmdline").read_bytes():
            found += cpu_s(pid)
    return found


def run_board_process(rate_hz: float) -> AbstractContextManager[tuple[str, int]]:
    """Run a board in its own process; return the port and the process."""
    from palpate_studies.benchmarks.pty_board import run_board, run_on_port

    return run_on_port(partial(run_board, rate_hz=rate_hz))


@contextmanager
def serve_rig(folder: Path, rig: Path, *options: str) -> Iterator[tuple[str, int]]:
    """Serve a rig; yield the address and the process."""
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve", "--port", "0"]
    command += ["--rig", str(rig), "--folder", str(folder), *options]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    }
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, cwd=folder
    ) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None
            yield found[0], process.pid
        finally:
            process.terminate()


def read_link(address: str) -> dict[str, float]:
    # Without the curve, so that the benchmark is not an additional viewer.
    with urllib.request.urlopen(f"{address}live?after_s=1e12", timeout=10) as reply:
        found: dict[str, float] = json.load(reply)["link"]
        return found


def memory_mb(pid: int) -> dict[str, float]:
    """Return the resident memory of the server and of the devices process."""
    return {"server": resident_mb(pid), "devices": resident_mb(devices_of(pid))}


def devices_of(pid: int) -> int:
    """Return the devices process, the largest child of the server."""
    return max(children_of(pid), key=resident_mb)


def watch(address: str, pid: int, *, seconds: float, what: str, pages: Sequence[Page] = ()) -> None:
    """Poll once a second; print loop period, processor time, memory and redraws."""
    p99_ms, worst_ms, began = [], [], memory_mb(pid)
    processes = {"server": pid, "devices": devices_of(pid)}
    for page in pages:
        page.evaluate(_COUNT_REDRAWS)
    cpu, began_s = [cpu_s(one) for one in processes.values()], time.monotonic()
    end_s, before = time.monotonic() + seconds, read_link(address)
    while time.monotonic() < end_s:
        time.sleep(1.0)
        now = read_link(address)
        p99_ms.append(1e3 * now["period_p99_s"])
        worst_ms.append(1e3 * now["period_worst_s"])
    took_s = time.monotonic() - began_s
    spent = [cpu_s(one) for one in processes.values()]
    busy = [100 * (end - begin) / took_s for begin, end in zip(cpu, spent, strict=True)]
    ended = memory_mb(pid)
    grown = ", ".join(f"{name} {began[name]:.0f} -> {ended[name]:.0f} MB" for name in began)
    print(
        f"{what}: loop period p99 of each second: median {np.median(p99_ms):.2f} ms, "
        f"90th percentile {np.quantile(p99_ms, 0.9):.2f} ms; longest {max(worst_ms):.1f} ms; "
        f"{now['frames'] - before['frames']:.0f} frames, {now['lost'] - before['lost']:.0f} lost, "
        f"{now['corrupt'] - before['corrupt']:.0f} corrupt; processor: server {busy[0]:.1f} %, "
        f"devices {busy[1]:.1f} %; memory {grown}; load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    for page in pages:
        ages_ms, long_ms = page.evaluate("[window.ages, window.long]")
        p50, p99 = np.quantile(ages_ms, [0.5, 0.99])
        print(
            f"  page: {len(ages_ms) / took_s:.1f} redraws a second; age of the frame when drawn "
            f"p50 {p50:.0f} ms, p99 {p99:.0f} ms; {len(long_ms)} long tasks, "
            f"longest {max(long_ms, default=0):.0f} ms",
            flush=True,
        )


def open_page(browser: Browser, address: str) -> Page:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    page.wait_for_function("document.querySelector('#link')?.dataset.state === 'fresh'")
    return page


def switch_recording(page: Page, *, wanted: bool) -> None:
    page.wait_for_selector("#grasp")
    if page.locator("#take-over").is_visible():
        page.locator("#take-over").click()
    switch = page.get_by_role("switch", name="Record between grasps")
    switch.click()
    page.wait_for_function(f"!!document.body.dataset.recording === {str(wanted).lower()}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=500.0)
    parser.add_argument("--seconds", type=float, default=600.0, help="with three viewers")
    parser.add_argument("--alone", type=float, default=120.0, help="seconds with none or one")
    parser.add_argument("--flexitac", action="store_true", help="only 384 pixels and one viewer")
    options = parser.parse_args()
    if options.flexitac:
        watch_flexitac(rate_hz=options.rate_hz, seconds=options.seconds)
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        run_board_process(options.rate_hz) as (port, _),
        serve_rig(
            Path(folder),
            write_rig(Path(folder), port=port, rate_hz=options.rate_hz),
        ) as (address, pid),
        sync_playwright() as play,
        play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser,
    ):
        first = open_page(browser, address)
        switch_recording(first, wanted=True)
        first.context.close()
        time.sleep(5.0)
        watch(address, pid, seconds=options.alone, what="no viewer")
        pages = [open_page(browser, address)]
        watch(address, pid, seconds=options.alone, what="one viewer", pages=pages)
        pages += [open_page(browser, address) for _ in range(2)]
        watch(address, pid, seconds=options.seconds, what="three viewers", pages=pages)
        for page in pages:
            page.context.close()
        watch(address, pid, seconds=options.alone, what="no viewer again")
        switch_recording(open_page(browser, address), wanted=False)
        (file,) = Path(folder).glob("*.mcap")
        recorded = load_recording(file)
        missing = int(np.sum(np.diff(recorded.sequence) - 1))
        print(f"recording: {len(recorded.sequence)} frames, {missing} missing")
    if missing:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
