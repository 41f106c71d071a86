"""The station's demo for `palpate demo`."""

from __future__ import annotations

from pathlib import Path

from palpate.cli.output import progress
from palpate.demo import Demo


def write(folder: Path) -> list[Path]:
    """Write the example packhouse with a progress bar; return its files.

    Raises `InputError` if the folder already contains a store.
    """
    from palpate_station.demo_packhouse import write_packhouse

    with progress("grasping", total=1.0) as show:
        return write_packhouse(folder, progress=show)


PACKHOUSE = Demo(
    folder="demo-packhouse",
    place=f"{__name__}:write",
    commands=(
        "cd demo-packhouse",
        "palpate ripeness --batch Monday",
        "palpate sort --rules rules.toml --batch Monday",
        "palpate items fruit-3",
        "palpate bruise A17    # exit status 1: it is bruised",
    ),
)
