"""`palpate calibrate settling`: extract settled holds from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import opt
from palpate.cli.output import print_message
from palpate.cli.settle_source import HoldSource
from palpate.errors import InputError
from palpate.files import check_writable
from palpate.holds import Hold
from palpate.recording.exporting import hold_tables, write_export
from palpate.rig.file import read_rig_file

#: Horizon of a known settled value, and tolerance of a hold's end before it.
_MIN_HOLD_S, _TOLERANCE_S = 20.0, 0.5


def calibrate_settling(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings or holds files, or folders of them.")
    ],
    rig: Annotated[
        str | None, opt("--rig FILE", "Add the holds to those of this rig file.")
    ] = None,
    out: Annotated[Path | None, opt("--out", "Holds file to write, .csv or .parquet.")] = None,
) -> None:
    """Collect the settled holds of recordings, for `palpate settle --learn-from` or `--rig`.

    With --rig FILE the holds are added to the rig's holds file, next to its calibration.

    Example: palpate calibrate settling day1.mcap day2.mcap --rig rig.toml
    """
    if rig is not None and out is not None:
        raise InputError("--rig and --out both set the output file; give only one of them")
    place = get_holds_path(rig) if rig else out or Path("settling.csv")
    if place.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out {place}: the name must end in .csv or .parquet")
    check_writable(place)
    source = HoldSource(paths=recordings)
    files = source.files()
    if len({path.stem for path in files}) < len(files):
        raise InputError("two recordings have the same name, so their holds would too; rename one")
    settled = _read(HoldSource(paths=[place]), place) if rig and place.exists() else []
    for path in files:
        holds = _read(source, path)
        long_holds = [hold for hold in holds if hold.time_s[-1] >= _MIN_HOLD_S - _TOLERANCE_S]
        names, long_names = ({hold.hold_id for hold in some} for some in (holds, long_holds))
        print_message(f"{path}: {len(names)} holds, {len(long_names)} long enough")
        if repeated := long_names & {hold.hold_id for hold in settled}:
            raise InputError(
                f"{path}: hold {min(repeated)} is already in {place}; rename the recording"
            )
        settled += long_holds
    if not settled:
        raise InputError(f"{recordings[0]}: no hold lasts {_MIN_HOLD_S:g} s; record longer holds")
    rows = write_export(
        place, hold_tables(settled), to="csv" if place.suffix == ".csv" else "parquet"
    )
    print(f"{place}: {len({hold.hold_id for hold in settled})} holds, {rows} rows")


def get_holds_path(rig: str) -> Path:
    """Return the path of a rig's settled holds, next to its calibration.

    Raises `InputError` if `rig` is not a rig file: simulated rigs have no holds file.
    """
    path = Path(rig)
    if path.suffix != ".toml":
        raise InputError(
            f"--rig {rig}: must be a rig file (.toml), because simulated rigs have no holds file"
        )
    calibration = read_rig_file(path).calibration
    return calibration.with_name(f"{calibration.stem}-settling.csv")


def _read(source: HoldSource, file: Path) -> list[Hold]:
    return list(source.holds(file, until_s=float("inf")))
