"""Files to try palpate on without a sensor; all of it simulated, and labelled so."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """One demo of `palpate demo`.

    Attributes
    ----------
    folder : str
        Default output folder.
    place : str
        ``module:function`` that writes the files; loaded when the demo is requested.
    commands : tuple of str
        Commands to try with the files in the default folder.
    is_running : bool
        Whether the function also receives the commands, and runs until Ctrl-C.
    """

    folder: str
    place: str
    commands: tuple[str, ...]
    is_running: bool = False

    def load(self) -> Any:
        """Return the function that writes the files, and returns their paths."""
        module, _, name = self.place.partition(":")
        return getattr(importlib.import_module(module), name)


#: Name -> demo.
DEMOS = {
    "grasp": Demo(
        folder="demo-grasp",
        place="palpate.cli.demo_grasp:write_grasp",
        commands=(
            "palpate inspect demo-grasp/grasp.mcap",
            "palpate replay demo-grasp/grasp.mcap",
            "palpate grasp --rig sim-soft --object tomato --seed 4 --target-force-n 2",
        ),
    ),
    "recordings": Demo(
        folder="demo-recordings",
        place="palpate.demo.recordings:write_recordings",
        commands=(
            "palpate settle demo-recordings/ohm.csv",
            "palpate settle demo-recordings/counts.csv --unit counts --adc-bits 10 "
            "--reference-ohm 4700 --sensor-leg upper",
            "palpate settle demo-recordings --method relaxation --method recorded "
            "--method exponential --cutoff 1",
        ),
    ),
    "force": Demo(
        folder="demo-force",
        place="palpate.demo.force:write_force",
        commands=(
            "palpate force demo-force/weights.csv --adc-bits 10",
            "palpate force demo-force/presses.csv --adc-bits 10 --reference-ohm 10k "
            "--sensor-leg upper --save demo-force/calibration.json",
            "palpate force demo-force/new.csv --calibration demo-force/calibration.json",
        ),
    ),
    "so101": Demo(
        folder="demo-so101",
        place="palpate.cli.demo_so101:run_so101",
        commands=(
            "palpate grasp --rig demo-so101/simulated.toml --target-force-n 2",
            "python examples/so101.py demo-so101",
        ),
        is_running=True,
    ),
}
