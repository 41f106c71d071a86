"""`palpate export FILE`: a recording or its holds as a table, for Rerun, or grasps for LeRobot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from palpate.cli.lazy_group import find_entry_point
from palpate.cli.options import opt
from palpate.cli.output import print_message
from palpate.errors import InputError
from palpate.files import check_new
from palpate.recording import RecordingReader
from palpate.recording.exporting import cut_file_holds, frame_tables, hold_tables, write_export

ExportForm: TypeAlias = Literal["csv", "parquet"]
HoldUnit: TypeAlias = Literal["percent", "ohm"]


def export(
    files: Annotated[
        list[Path], typer.Argument(help="An .mcap recording; with --lerobot any number of grasps.")
    ],
    to: Annotated[
        ExportForm | None, opt("--to", "File format. [default: from the ending of --out, or csv]")
    ] = None,
    holds: Annotated[bool, opt("--holds", "Export only the holds, for `palpate settle`.")] = False,
    unit: Annotated[
        HoldUnit, opt("--unit", "Unit of the holds: relative change or resistance.")
    ] = "percent",
    out: Annotated[Path | None, opt("--out FILE", "File to write. [default: next to FILE]")] = None,
    lerobot: Annotated[
        Path | None, opt("--lerobot DIR", "Write recorded grasps as a LeRobot data set, v3.0.")
    ] = None,
    rerun: Annotated[
        Path | None,
        opt("--rerun FILE", "Write pixels, forces and phases for the Rerun viewer (.rrd)."),
    ] = None,
    task: Annotated[
        str | None,
        opt("--task", "With --lerobot: task description. [default: from each recording]"),
    ] = None,
    fps: Annotated[
        int | None,
        opt(
            "--fps HZ", "With --lerobot: ticks per second. [default: the first recording's]", min=1
        ),
    ] = None,
) -> None:
    """Write a recording as a table of frames or holds, for Rerun, or grasps for LeRobot.

    Example: palpate export run.mcap --holds && palpate settle run.holds.csv
    """
    if lerobot is not None:
        if to is not None or holds or out is not None or rerun is not None:
            raise InputError("--lerobot can't be combined with --to, --holds, --out or --rerun")
        package = ("palpate-lerobot", "packages/lerobot-dataset")
        point = find_entry_point("palpate.exports", "lerobot", *package, wanted="--lerobot")
        point.load()(files, folder=lerobot, task=task, fps=fps)
        return
    if task is not None or fps is not None:
        raise InputError("--task and --fps require --lerobot DIR")
    if len(files) > 1:
        raise InputError(f"{files[1]}: only one recording can be exported, except with --lerobot")
    if rerun is not None:
        if to is not None or holds or out is not None:
            raise InputError("--rerun can't be combined with --to, --holds or --out")
        package = ("palpate-rerun", "packages/rerun")
        point = find_entry_point("palpate.exports", "rerun", *package, wanted="--rerun")
        frames = len(point.load()(files[0], out=rerun).time_s)
        print_message(f"{rerun}: {frames} frames")
        return
    file, form = files[0], _choose_format(to, out)
    target = out or file.parent / (file.stem + (f".holds.{form}" if holds else f".{form}"))
    with RecordingReader(file):  # a file that is not a recording is refused first
        check_new(target)
    if holds:
        cut = cut_file_holds(file, unit=unit)
        rows = write_export(target, hold_tables(cut), to=form)
        number = len({hold.hold_id for hold in cut})
        what = f"{number} hold{'s' * (number != 1)}, "
    else:
        with RecordingReader(file) as reader:
            rows = write_export(target, frame_tables(reader), to=form)
        what = ""
    print_message(f"{target}: {what}{rows} rows")


def _choose_format(to: ExportForm | None, out: Path | None) -> ExportForm:
    """Return the format set by --to or the ending of --out, which must agree."""
    if out is None:
        return to or "csv"
    forms: dict[str, ExportForm] = {".csv": "csv", ".parquet": "parquet"}
    form = forms.get(out.suffix.lower())
    if form is not None and to in (None, form):
        return form
    wanted = f".{to}" if to else ".csv or .parquet"
    raise InputError(f"--out {out}: the name must end in {wanted}")
