"""A newcomer with three weights, a rigid block and no load cell, by the wall clock.

``python -m tests.desk.newcomer [--board text|firmware|flexitac] [--hand own|...] [--rate HZ]``
starts a world, deletes the rig's calibration, and types what docs/bring-up.md says: calibrate the
rest, the force with weights, the compliance with a block, then grasp to 3 N. It prints the answers
beside the true values. Four minutes each.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.desk.bench import _PALPATE, Case, WorldProcess, _environment, open_world

#: Time in which the world has laid a weight on.
_LAYING_S = 14.0
_LIMIT_S = 400.0


def type_command(
    words: list[str], *, folder: Path, world: WorldProcess, answers: list[str]
) -> subprocess.CompletedProcess[str]:
    """Run a command; before each Enter that it asks for, ask the world for the next answer."""
    process = subprocess.Popen(
        [_PALPATE, *words],
        cwd=folder,
        env=_environment(folder),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdin is not None
    assert process.stderr is not None
    shown = b""
    waiting = iter(answers)
    while byte := process.stderr.read(1):
        shown += byte
        if shown.endswith(b"press Enter:"):
            print(shown.decode().strip().splitlines()[-1], flush=True)
            world.ask(next(waiting))
            time.sleep(_LAYING_S)
            process.stdin.write(b"\n")
            process.stdin.flush()
    out, _ = process.communicate(timeout=_LIMIT_S)
    done = subprocess.CompletedProcess(words, process.returncode, out.decode(), shown.decode())
    print(" ".join(words), "->", done.returncode, flush=True)
    print(done.stdout[-700:] if done.returncode == 0 else done.stderr[-1500:], flush=True)
    return done


def main() -> int:
    """Walk through the page once; the status is 0 if the object was held within the interval."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("--board", default="text")
    parser.add_argument("--hand", default="own")
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--index", type=int, default=0)
    parser.add_argument("--loads", default="1.5,4,9", help="weights, newtons")
    options = parser.parse_args()
    case = Case(
        use="grasp",
        board=options.board,
        rate_hz=options.rate,
        hand=options.hand,
        index=options.index,
    )
    with open_world(case) as (world, folder):
        (folder / "calibration.json").unlink()
        loads = options.loads.split(",")
        (folder / "loads.csv").write_text("\n".join(["load_n", *loads]) + "\n")
        rig = ["--rig", "rig.toml"]
        world.ask("weigh 0")
        time.sleep(3.0)
        steps: list[tuple[list[str], list[str]]] = [
            (["calibrate", "rest", *rig], []),
            (
                ["calibrate", "force", *rig, "--loads", "loads.csv"],
                [f"weigh {load}" for load in loads],
            ),
            (["calibrate", "compliance", *rig, "--block-mm", "32"], ["block"]),
        ]
        for words, answers in steps:
            if words[1] == "compliance":
                world.ask("weigh 0")
                time.sleep(20.0)
            if type_command(words, folder=folder, world=world, answers=answers).returncode:
                return 1
        world.place(case.seed)
        done = type_command(
            ["grasp", *rig, "--target-force-n", "3", "--json"],
            folder=folder,
            world=world,
            answers=[],
        )
        document: dict[str, Any] = json.loads(done.stdout or "{}")
        report, log = world.report(), world.read_log()
        force = document.get("force_n") or {}
        print(document.get("outcome"), document.get("faults"), force, document.get("size_mm"))
        last = log[log["monotonic_s"] > log["monotonic_s"][-1] - 20.0]["force_n"]
        print(f"true peak {report['peak_n']:.2f} N, of the last 20 s {last.max():.2f} N")
        return 0 if document.get("outcome") == "held" else 1


if __name__ == "__main__":
    sys.exit(main())
