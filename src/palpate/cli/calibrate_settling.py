"""`palpate calibrate settling`: recordings to the settled holds that predictions learn from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import opt
from palpate.cli.output import say
from palpate.cli.settle_source import HoldSource
from palpate.errors import InputError
from palpate.files import check_writable
from palpate.holds import Hold
from palpate.recording.exporting import hold_tables, write_export
from palpate.rig.file import read_rig_file

#: A hold shows what it settles to only if it lasts until the horizon.
_SHORTEST_S = 20.0


def settling(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings or holds files, or folders of them.")
    ],
    rig: Annotated[str | None, opt("--rig FILE", "Rig file that is to keep them.")] = None,
    out: Annotated[Path | None, opt("--out", "Holds file to write, .csv or .parquet.")] = None,
) -> None:
    """Collect the settled holds of recordings, for `palpate settle --learn-from` or `--rig`.

    With --rig FILE they are added to those that the rig has, next to its calibration.

    Example: palpate calibrate settling day1.mcap day2.mcap --rig rig.toml
    """
    if rig is not None and out is not None:
        raise InputError("--rig and --out name two places for the holds; give one of them")
    place = place_of_holds(rig) if rig else out or Path("settling.csv")
    if place.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out {place}: end its name in .csv or .parquet")
    check_writable(place)
    source = HoldSource(paths=recordings)
    files = source.files()
    if len({path.stem for path in files}) < len(files):
        raise InputError("two recordings have the same name, which names their holds; rename one")
    kept = _read(HoldSource(paths=[place]), place) if rig and place.exists() else []
    for path in files:
        cut = _read(source, path)
        long = [hold for hold in cut if hold.time_s[-1] >= _SHORTEST_S - 0.5]
        names = {hold.hold_id for hold in cut}, {hold.hold_id for hold in long}
        say(f"{path}: {len(names[0])} holds, {len(names[1])} long enough")
        if again := names[1] & {hold.hold_id for hold in kept}:
            raise InputError(f"{path}: hold {min(again)} is in {place} already; rename the file")
        kept += long
    if not kept:
        raise InputError(
            f"{recordings[0]}: no hold lasts {_SHORTEST_S:g} s; hold for longer while recording"
        )
    rows = write_export(place, hold_tables(kept), to="csv" if place.suffix == ".csv" else "parquet")
    print(f"{place}: {len({hold.hold_id for hold in kept})} holds, {rows} rows")


def place_of_holds(rig: str) -> Path:
    """Return the path of a rig's settled holds, next to its calibration.

    Raises `InputError` if `rig` is no rig file: simulated rigs keep nothing.
    """
    path = Path(rig)
    if path.suffix != ".toml":
        raise InputError(f"--rig {rig}: name a rig file (.toml); simulated rigs keep no holds")
    calibration = read_rig_file(path).calibration
    return calibration.with_name(f"{calibration.stem}-settling.csv")


def _read(source: HoldSource, file: Path) -> list[Hold]:
    return list(source.holds(file, until_s=float("inf")))
