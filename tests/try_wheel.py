"""Try the command of an installed wheel, outside the repository, as `make wheel-test` does.

    python tests/try_wheel.py PALPATE [--extras]

PALPATE is the installed command. Without `--extras` it is the core alone: what is optional, or in
another package, must be refused in one line that names what to install. With it, all is installed
and must work.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

STORE = "--store demo-packhouse/palpate-items.sqlite"
#: Command, exit status, and what standard output or error must hold.
BASE = (
    ("--help", 0, "Examine produce by touch"),
    ("demo recordings", 0, "simulated"),
    ("settle demo-recordings/ohm.csv", 0, "relaxation"),
    ("grasp --seed 3 --object strawberry", 0, "SIMULATED"),
    ("grasp --seed 3 --rate-hz 15 --record grasp.mcap", 0, "SIMULATED"),
    ("replay grasp.mcap", 0, "SIMULATED"),
    ("record pad.mcap --rig sim-rigid --duration 2", 0, "recorded"),
    ("doctor --recording pad.mcap", 0, ""),
    ("live --rig sim-rigid --duration 1", 0, "SIMULATED"),
    ("calibrate rest --rig sim-rigid --out pad.json", 0, "Written"),
    ("init rig.toml --port auto --layout soft-3x2 --gripper none", 0, "Written"),
    ("study table1", 2, "pip install ./packages/studies"),
    ("bench settling", 2, "pip install ./packages/studies"),
    ("archive settle archive", 2, "pip install ./packages/archive"),
    ("export g.mcap --lerobot grasps", 2, "pip install ./packages/lerobot-dataset"),
    ("export g.mcap --rerun g.rrd", 2, "pip install ./packages/rerun"),
    ("flash --port /dev/not-there", 3, ""),
    ("grasp --rig sim-firmware", 3, "make -C firmware"),
    ("settle demo-recordings/ohm.csv --plot settled.png", 2, "palpate[plots]"),
    ("pattern --preset paper-3x2 --out sensor", 2, "pip install ./packages/pattern"),
    ("demo packhouse", 2, "pip install ./packages/station"),
    ("serve", 2, "pip install ./packages/station"),
    ("sort --rules rules.toml", 2, "pip install ./packages/station"),
    ("grasp --item A17", 2, "pip install ./packages/station"),
    ("live --rig sim-rigid --duration 1 --foxglove", 2, "pip install ./packages/foxglove"),
)
EXTRAS = (
    ("demo recordings", 0, "simulated"),
    ("settle demo-recordings/ohm.csv --plot settled.png", 0, "settled.png"),
    ("pattern --preset paper-3x2 --out sensor", 0, "Written: "),
    ("demo packhouse", 0, "simulated"),
    ("live --rig sim-rigid --duration 1 --foxglove 127.0.0.1:0", 0, "layout.json"),
    (f"ripeness --batch Monday {STORE}", 0, "ripe"),
    (f"sort --rules demo-packhouse/rules.toml --batch Monday {STORE}", 0, "guacamole"),
)


def check(palpate: str, command: str, *, status: int, shows: str) -> None:
    """Run one command; fail unless it ends and reads as it should."""
    done = subprocess.run([palpate, *command.split()], capture_output=True, text=True, check=False)
    lines = done.stderr.strip().splitlines()
    assert done.returncode == status, f"{command}: exit {done.returncode}\n{done.stderr}"
    assert shows in done.stdout + done.stderr, f"{command}: no {shows!r}\n{done.stdout}{lines}"
    assert status == 0 or len(lines) == 1, f"{command}: more than one line\n{done.stderr}"
    print(f"ok  palpate {command}", flush=True)


def check_dashboard(palpate: str) -> None:
    """Start the dashboard, fetch its page, stop it by Ctrl-C."""
    server = subprocess.Popen(
        [palpate, "serve", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        address = server.stdout.readline().split()[2]
        with urllib.request.urlopen(address, timeout=30) as page:
            assert "<title>palpate" in page.read().decode()
        with urllib.request.urlopen(f"{address}api/openapi.json", timeout=30) as described:
            assert "stiffness_n_per_mm" in described.read().decode()
        server.send_signal(signal.SIGINT)
        status = server.wait(timeout=30)
    finally:
        server.kill()
    assert status in (0, 130), f"serve: exit {status}"
    print(f"ok  palpate serve, {address}", flush=True)


def main(palpate: str, *, extras: bool) -> None:
    """Check everything in a new folder."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for command, status, shows in EXTRAS if extras else BASE:
            check(palpate, command, status=status, shows=shows)
        if extras:
            check_dashboard(palpate)


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).absolute()), extras="--extras" in sys.argv)
