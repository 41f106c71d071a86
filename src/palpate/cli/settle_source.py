"""Sources of holds for `palpate settle`: holds files, recordings and folders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from palpate.cli.output import print_message
from palpate.errors import InputError, PalpateError
from palpate.holds import Hold, iterate_holds
from palpate.holds.columns import TimeUnit
from palpate.holds.cutting import CutAt, CutColumn, cut_columns, explain_no_hold
from palpate.holds.formats import is_mcap
from palpate.holds.recordings import TABLE_ENDINGS, read_recordings
from palpate.holds.relative_readings import relative_readings
from palpate.holds.table_files import detect_format, open_parquet, open_table
from palpate.holds.text import open_text, read_lines
from palpate.holds.units import Unit
from palpate.recording.exporting import cut_file_holds
from palpate.signal.circuit import Divider

#: Sampling step above which the times are probably in milliseconds, seconds.
_MAX_STEP_S = 4.0
#: Position of the sensor in the voltage divider.
Leg: TypeAlias = Literal["upper", "lower"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingOptions:
    """The user's description of recordings; holds files use only the unit."""

    #: Arguments of `palpate.read_recording`.
    time_column: str | None = None
    time_unit: TimeUnit | None = None
    value_columns: Sequence[str] = ()
    unit: Unit | None = None
    divider: Divider | None = None
    interval_s: float | None = None
    sheet: str | None = None
    decimal: Literal["point", "comma"] | None = None
    #: Argument of `palpate.cut_holds`.
    cut: CutAt = "auto"
    #: Interval at rest for the conversion to relative changes, and whether to average the columns.
    rest_s: tuple[float, float] | None = None
    mean: bool = False

    def has_only_unit(self) -> bool:
        """Return whether all options are defaults, except a unit of ohm or percent."""
        return self in (
            ReadingOptions(),
            ReadingOptions(unit="percent"),
            ReadingOptions(unit="ohm"),
        )


@dataclass(slots=True, kw_only=True)
class HoldSource:
    """Reads the holds of files and folders."""

    #: Files, and folders of recordings.
    paths: Sequence[Path]
    #: Description of the recordings.
    reading: ReadingOptions = field(default_factory=ReadingOptions)
    _warned: set[Path] = field(default_factory=set)

    def files(self) -> list[Path]:
        """Return the files, with folders replaced by their recordings sorted by name.

        Raises `InputError` if a folder contains no recording.
        """
        found: list[Path] = []
        for path in self.paths:
            inside = [path] if not path.is_dir() else _recordings_in(path)
            if not inside:
                raise InputError(
                    f"{path}: no recordings in this folder (CSV, Excel, Parquet or .mcap files)"
                )
            found += inside
        return found

    def holds(
        self,
        file: Path,
        *,
        until_s: float,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[Hold]:
        """Yield the holds of one file.

        A file in a folder is skipped with a warning if it can't be read or has no holds.
        """
        is_known = file in self._warned
        for hold in self._read(file, until_s=until_s, progress=progress):
            if not is_known and hold.time_s[0] >= until_s:
                is_known = True
                print_message(
                    f"palpate: {file}: hold {hold.hold_id} begins at {hold.time_s[0]:g} s, but "
                    "time_s must count from the contact; subtract each hold's first time"
                )
            if not is_known and len(hold.time_s) > 1:
                step_s = float(np.median(np.diff(hold.time_s)))
                if is_known := step_s > _MAX_STEP_S:
                    print_message(
                        f"palpate: {file}: hold {hold.hold_id} has a sample every {step_s:g} s; "
                        "time_s must be in seconds; convert milliseconds"
                    )
            yield hold
        self._warned.add(file)

    def _read(
        self, file: Path, *, until_s: float, progress: Callable[[float], None] | None
    ) -> Iterator[Hold]:
        if self._is_holds(file):
            with closing(iterate_holds(file, until_s=until_s, progress=progress)) as found:
                for hold in found:
                    yield replace(hold, unit=self.reading.unit or hold.unit)
            return
        try:
            if is_mcap(file):
                holds = _read_mcap_holds(file, self.reading)
            else:
                holds = [hold for column in self.columns(file) for hold in column.holds]
        except PalpateError as error:
            if file in self.paths:
                raise
            self._warn(file, f"{error} (skipped)")
            return
        yield from holds

    def recordings(self) -> list[Path]:
        """Return the tables to cut into holds: all files except .mcap and holds files."""
        return [file for file in self.files() if not (self._is_holds(file) or is_mcap(file))]

    def _is_holds(self, file: Path) -> bool:
        return self.reading.has_only_unit() and is_holds_file(file)

    def columns(self, file: Path) -> list[CutColumn]:
        """Return each sensor's data cut into holds; print each warning once.

        Raises `InputError` if the file can't be read, or no sensor has a hold.
        """
        options = self.reading
        found: list[CutColumn] = []
        remarks: list[str] = []
        recordings = read_recordings(
            file,
            time_column=options.time_column,
            time_unit=options.time_unit,
            value_columns=options.value_columns,
            unit=options.unit,
            divider=options.divider,
            interval_s=options.interval_s,
            sheet=options.sheet,
            decimal=options.decimal,
        )
        for readings in recordings:
            if options.rest_s is not None:
                try:
                    readings = relative_readings(readings, rest_s=options.rest_s, mean=options.mean)
                except InputError as error:
                    why = str(error).removeprefix(f"{file.stem}: ")
                    raise InputError(f"{file}: {why}") from error
            remarks += readings.remarks
            columns = cut_columns(readings, cut=options.cut)
            if not any(column.holds for column in columns):
                if len(recordings) == 1:
                    raise InputError(explain_no_hold(str(file), columns))
                remarks.append(explain_no_hold(readings.name, columns))
            else:
                which = f"{readings.name}: " if len(recordings) > 1 else ""
                by_remark: dict[str, list[str]] = {}
                for column in columns:
                    for remark in filter(None, (*column.remarks, column.reason)):
                        by_remark.setdefault(remark, []).append(column.column)
                remarks += [f"{which}{', '.join(names)}: {r}" for r, names in by_remark.items()]
            found += columns
        if not any(column.holds for column in found):
            raise InputError(f"{file}: no hold in any of its {len(recordings)} recordings")
        # Printed last, so that a refused file reports only its error.
        for remark in remarks:
            self._warn(file, remark)
        return found

    def _warn(self, file: Path, remark: str) -> None:
        if file not in self._warned:
            print_message(f"palpate: {file}: {remark.removeprefix(f'{file}: ')}")


def is_holds_file(file: Path) -> bool:
    """Return whether a file's header has the columns of a holds file.

    A pipe can be read only once and is assumed to be a holds file.
    """
    if not file.is_file():
        return file.exists()
    name = str(file)
    try:
        with open_table(file) as stream:
            form = detect_format(stream, name=name)
            if form == "text":
                with open_text(stream, name=name) as text:
                    return "hold_id" in next(read_lines(text), "")
            if form == "parquet":
                with open_parquet(stream, name=name) as parquet:
                    return "hold_id" in parquet.schema_arrow.names
    except InputError:
        # Reading the file as a recording reports the same error.
        return False
    return False


def _recordings_in(folder: Path) -> list[Path]:
    return sorted(
        path
        for path in folder.iterdir()
        if path.is_file()
        and path.suffix.lower() in (*TABLE_ENDINGS, ".mcap")
        and not path.name.startswith((".", "~$"))
    )


def _read_mcap_holds(file: Path, reading: ReadingOptions) -> list[Hold]:
    """Return the holds of a palpate recording, cut as in `palpate export --holds`."""
    if not reading.has_only_unit():
        raise InputError(
            f"{file}: a palpate recording is cut where the gripper was at rest; only --unit "
            "percent or ohm applies to it"
        )
    return cut_file_holds(file, unit="ohm" if reading.unit == "ohm" else "percent")


def make_divider(
    adc_bits: int | None, reference_ohm: float | None, leg: Leg | None, *, unit: str | None
) -> Divider | None:
    """Return the divider described by the options; None without options.

    Raises `InputError` if the options are incomplete, out of range or conflict with the unit.
    """
    if adc_bits is None and reference_ohm is None and leg is None:
        return None
    if adc_bits is None or reference_ohm is None or leg is None:
        raise InputError(
            "--adc-bits, --reference-ohm and --sensor-leg convert counts to ohms; give all three"
        )
    if not 1 <= adc_bits <= 32 or not 0 < reference_ohm < float("inf"):
        raise InputError(
            f"--adc-bits {adc_bits}, --reference-ohm {reference_ohm:g}: give bits from 1 to 32 and "
            "a positive resistance"
        )
    if unit not in (None, "counts"):
        raise InputError(
            f"--adc-bits can only be used with --unit counts, not {unit}; omit one of the two "
            "options"
        )
    return Divider(adc_bits=adc_bits, reference_ohm=reference_ohm, taxel_leg=leg)


def parse_cut(text: str) -> CutAt:
    """Parse the value of --cut."""
    if text == "auto":
        return "auto"
    if text == "none":
        return "none"
    try:
        begin_s = float(text.replace(",", "."))
    except ValueError:
        begin_s = float("nan")
    if begin_s != begin_s or abs(begin_s) == float("inf"):
        raise InputError(f"--cut {text}: give auto, none or a time in seconds")
    return begin_s


def parse_rest(text: str | None, *, mean: bool, unit: str | None) -> tuple[float, float] | None:
    """Parse the --rest interval; return None if it was not given."""
    if text is None:
        if mean:
            raise InputError("--mean requires --rest START:END, an interval without load")
        return None
    if unit in ("percent", "volt"):
        raise InputError(f"--rest converts ohms to relative changes, but --unit is {unit}")
    try:
        begin_s, end_s = (float(part.replace(",", ".")) for part in text.split(":"))
    except ValueError:
        begin_s, end_s = 0.0, 0.0
    if not begin_s < end_s < float("inf"):
        raise InputError(f"--rest {text}: give START:END in seconds, such as 0:1.5")
    return begin_s, end_s
