"""Load of Foxglove on `palpate live`: processor time, delay and losses at 250 frames/s.

Run `python benchmarks/foxglove_viewer.py --seconds 30`. The board is a simulated process on a
pseudo-terminal; the viewer is a websocket client of every channel on the same machine. The output
is the processor time of `palpate live --force` in percent of a core without Foxglove, with Foxglove
but without a viewer, and with one viewer; then the age of the frames at the viewer.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Time to open the rig and to import modules at the first frames, seconds.
SETTLE_S = 5.0


def write_rig(folder: Path, *, port: str, rate_hz: float) -> Path:
    """Write a rig file for a board without a gripper, with a simulated calibration."""
    from palpate.twin.rig import calibrate_twin

    calibrate_twin(seed=1, level="lab", apart_from="ball-44lbs").save(folder / "calibration.json")
    rig = folder / "rig.toml"
    rig.write_text(
        'calibration = "calibration.json"\n[array]\n'
        f'open = "palpate.sensor.board_array:open_board"\nport = "{port}"\nrate_hz = {rate_hz}\n'
    )
    return rig


@contextmanager
def run_live(rig: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Run `palpate live --force` on a rig."""
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "live", "--force"]
    with subprocess.Popen(
        [*command, "--rig", str(rig), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def read_address(process: subprocess.Popen[str]) -> str:
    assert process.stderr is not None
    found = re.search(r"ws://\S+:\d+", process.stderr.readline())
    assert found is not None
    return found[0]


def measure_cpu_percent(pid: int, *, seconds: float) -> float:
    """Measure the processor time of a process, in percent of a core."""
    from benchmarks.processes import cpu_s

    before_s, began_s = cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    return 100 * (cpu_s(pid) - before_s) / (time.monotonic() - began_s)


def watch_messages(pid: int, address: str, *, seconds: float) -> None:
    """Subscribe to every channel; print message rate, losses, delay and processor time."""
    from benchmarks.packhouse import print_latency
    from benchmarks.processes import cpu_s
    from packages.foxglove.tests.foxglove_client import foxglove_client

    counts: Counter[str] = Counter()
    late_ms, numbers = [], []
    with foxglove_client(address) as client:
        client.subscribe()
        before_s, began_s = cpu_s(pid), time.monotonic()
        for message in client.messages(for_s=seconds):
            counts[message.topic] += 1
            if message.topic == "/force":
                late_ms.append((time.time_ns() - message.log_time_ns) / 1e6)
            elif message.topic == "/frames":
                numbers.append(message.content["sequence"])
        took_s = time.monotonic() - began_s
        cpu_percent = 100 * (cpu_s(pid) - before_s) / took_s
    missing = sum(after - before - 1 for before, after in pairwise(numbers))
    print(f"one viewer: {cpu_percent:.1f} % of a core; load {os.getloadavg()[0]:.1f}")
    print(f"  {sum(counts.values()) / took_s:.0f} messages/s, {missing} of {len(numbers)} missing")
    print_latency("  from the frame to the viewer's last message of the frame", late_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=250.0)
    parser.add_argument("--seconds", type=float, default=30.0, help="for each line")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from benchmarks.dashboard import run_board_process

    with (
        tempfile.TemporaryDirectory() as made,
        run_board_process(options.rate_hz) as (line, _),
    ):
        rig = write_rig(Path(made), port=line, rate_hz=options.rate_hz)
        with run_live(rig) as process:
            time.sleep(SETTLE_S)
            cpu_percent = measure_cpu_percent(process.pid, seconds=options.seconds)
            print(f"without Foxglove: {cpu_percent:.1f} % of a core", flush=True)
        with run_live(rig, "--foxglove", "127.0.0.1:0") as process:
            address = read_address(process)
            time.sleep(SETTLE_S)
            cpu_percent = measure_cpu_percent(process.pid, seconds=options.seconds)
            print(f"with Foxglove, no viewer: {cpu_percent:.1f} % of a core", flush=True)
            watch_messages(process.pid, address, seconds=options.seconds)


if __name__ == "__main__":
    main()
