"""`palpate calibrate settling`: recorded grasps to the holds that predictors learn from."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from palpate.errors import InputError, RecordingError
from palpate.files import check_place

#: A hold teaches how the sheet settles only if it lasts until the horizon, and half a second of
#: settled value before it.
_SHORTEST_S = 20.0


def command(
    recordings: Annotated[list[Path], typer.Argument(help="Recorded grasps, .mcap files.")],
    out: Annotated[Path, typer.Option(help="Holds file to write, .csv or .parquet.")] = Path(
        "settling.csv"
    ),
    shortest_s: Annotated[
        float, typer.Option("--shortest", help="Holds that end earlier are left out, s.", min=1.0)
    ] = _SHORTEST_S,
) -> None:
    """Cut the holds of recorded grasps into one file for `palpate settle --learn-from`.

    Example: palpate calibrate settling day1.mcap day2.mcap --out settling.csv
    """
    from palpate.holds import Hold
    from palpate.recording import load_recording
    from palpate.recording.exporting import hold_tables, recorded_holds, write_export

    kinds = {".csv": "csv", ".parquet": "parquet"}
    if out.suffix not in kinds:
        raise InputError(f"--out {out}: end its name in .csv or .parquet")
    check_place(out)
    if len({path.stem for path in recordings}) < len(recordings):
        raise InputError("two recordings have one name; holds are named by it, rename one")
    kept: list[Hold] = []
    for path in recordings:
        try:
            cut = recorded_holds(load_recording(path), name=path.stem)
        except RecordingError as error:
            where = "" if str(path) in str(error) else f"{path}: "
            raise RecordingError(f"{where}{error}") from error
        long = [hold for hold in cut if hold.time_s[-1] >= shortest_s - 0.5]
        names = {hold.hold_id for hold in cut}, {hold.hold_id for hold in long}
        print(f"{path}: {len(names[0])} holds, {len(names[1])} long enough", file=sys.stderr)
        kept += long
    if not kept:
        raise RecordingError(
            f"no hold lasts {shortest_s:g} s; hold for longer while recording, or give --shortest"
        )
    rows = write_export(out, hold_tables(kept), to="csv" if out.suffix == ".csv" else "parquet")
    print(f"{out}: {len({hold.hold_id for hold in kept})} holds, {rows} rows")
