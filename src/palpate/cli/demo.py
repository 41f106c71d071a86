"""`palpate demo NAME`: simulated example files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import options as option
from palpate.cli.options import opt
from palpate.cli.output import progress
from palpate.errors import InputError

#: Demo -> (folder, commands to try).
NAMES = {
    "recordings": (
        "demo-recordings",
        (
            "palpate settle demo-recordings/ohm.csv --plot settled.png",
            "palpate settle demo-recordings/counts.csv --unit counts --adc-bits 10 "
            "--reference-ohm 4700 --sensor-leg upper",
            "palpate settle demo-recordings --method relaxation --method recorded "
            "--method exponential --cutoff 1",
        ),
    ),
    "force": (
        "demo-force",
        (
            "palpate force demo-force/weights.csv --adc-bits 10",
            "palpate force demo-force/presses.csv --adc-bits 10 --reference-ohm 10k "
            "--sensor-leg upper --save demo-force/calibration.json --plot force.png",
            "palpate force demo-force/new.csv --calibration demo-force/calibration.json",
        ),
    ),
    "packhouse": (
        "demo-packhouse",
        (
            "cd demo-packhouse",
            "palpate ripeness --batch Monday",
            "palpate sort --rules rules.toml --batch Monday",
            "palpate items fruit-3",
            "palpate bruise A17    # exit status 1: it is bruised",
        ),
    ),
    "so101": (
        "demo-so101",
        (
            "palpate grasp --rig demo-so101/simulated.toml --target-force-n 2",
            "python examples/so101.py demo-so101",
        ),
    ),
}


def demo(
    name: Annotated[
        str,
        typer.Argument(
            help="recordings, force, packhouse or so101.", autocompletion=option.complete_demos
        ),
    ],
    out: Annotated[Path | None, opt("--out DIR", "Output folder. [default: demo-NAME]")] = None,
) -> None:
    """Write simulated example files, or simulate a robot's ports.

    recordings: data-logger files. force: readings with known loads. packhouse: an item store with
    sorting rules, in about 15 s. so101: servo line and sensor of an SO-101 with a rig file, until
    Ctrl-C.

    All data are simulated and labelled as such.

    Example: palpate demo recordings
    """
    if name not in NAMES:
        raise InputError(f"no demo {name!r}; available: {', '.join(NAMES)}")
    default, commands = NAMES[name]
    folder = out if out is not None else Path(default)
    if name == "so101":
        _simulate_so101(folder, [command.replace(default, str(folder)) for command in commands])
        return
    if name == "recordings":
        from palpate.demo.recordings import write_recordings

        written = write_recordings(folder)
    elif name == "force":
        from palpate.demo.force import write_force

        written = write_force(folder)
    else:
        from palpate.demo.packhouse import write_packhouse

        with progress("grasping", total=1.0) as show:
            written = write_packhouse(folder, progress=show)
    print("Written, simulated: " + ", ".join(map(str, written)))
    print("Try:")
    for command in commands:
        print("  " + command.replace(default, str(folder)))


def _simulate_so101(folder: Path, commands: list[str]) -> None:
    if sys.platform != "win32":
        from palpate.demo.so101 import simulate_so101

        with simulate_so101(folder) as robot:
            print(f"SIMULATED SO-101: servos 1 to 6 on {robot.bus}, shared as", end=" ")
            print(f"{folder / 'hand'} and {folder / 'arm'}; rig file {folder / 'simulated.toml'}")
            print("Try in another terminal, until Ctrl-C here:")
            for command in commands:
                print("  " + command)
            # A reader of the output may wait for the ports.
            sys.stdout.flush()
            robot.run()
    else:
        raise InputError("demo so101: needs pseudo-terminals; use Linux or macOS")
