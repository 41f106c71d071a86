"""`palpate demo so101`: the ports of a simulated SO-101."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from palpate.errors import InputError


def run_so101(folder: Path, commands: Sequence[str]) -> None:
    """Simulate the servo line and the sensor until Ctrl-C; print where they are.

    Raises `InputError` on a system without pseudo-terminals.
    """
    if sys.platform != "win32":
        # The imports and the calibration take seconds.
        print(
            "Starting a simulated SO-101: 5 s to calibrate its sensor, longer on a busy computer",
            flush=True,
        )
        from palpate.demo.so101 import simulate_so101

        with simulate_so101(folder) as robot:
            print(f"SIMULATED SO-101: servos 1 to 6 on {robot.bus}, shared as", end=" ")
            print(f"{folder / 'hand'} and {folder / 'arm'}; rig file {folder / 'simulated.toml'}")
            print("Try in another terminal, until Ctrl-C here:")
            for command in commands:
                print("  " + command)
            # A reader of the output may wait for the ports.
            sys.stdout.flush()
            robot.run(show=partial(print, flush=True))
    else:
        raise InputError("demo so101: needs pseudo-terminals; use Linux or macOS")
