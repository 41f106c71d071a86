"""The calibration file: rest values, raw force and closure pairs, and the fitted law.

The file is JSON and is written atomically. It always contains the raw pairs, so that a better law
can be fitted to an old calibration. The coefficients of the law are included for human readers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError
from palpate.files import atomic_path, load_dataclass, load_json
from palpate.sensor.array import MAX_LINES, RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout

FORMAT = "palpate-calibration"
VERSION = 3
#: Version 1 has no held-out errors. Version 2 contains traces and an observer fitted to the traces.
#: Files of all versions may contain the room conditions. The obsolete keys are ignored.
_READABLE_VERSIONS = (1, 2, VERSION)
_OBSOLETE_KEYS = ("traces", "observer", "temperature_c", "humidity_percent")

#: Above the range of this sensor; larger values are probably grams.
LARGEST_LOAD_N = 200.0
#: Plausible ranges of the stored quantities, by the name of the field, each wider than any rig.
_RANGES: Mapping[str, tuple[float, float]] = {
    # A tared load cell drifts by less than this; a lower value has the wrong sign or no tare.
    "force_n": (-0.2, LARGEST_LOAD_N),
    # Over a day between two movements, no reading is useful.
    "since_move_s": (0.0, 86_400.0),
    # Conductance can't be negative, and a sheet changes by less than a factor of 1000.
    "pixel_excess": (-1.0, 1e4),
    "excess": (-float(MAX_LINES**2), 1e7),
    # Resistance can't be negative; far above the rest value, a contact is open.
    "relative_percent": (-100.0, 1e4),
    # Noise above the value itself is no rest.
    "spread_percent": (0.0, 100.0),
    # No hand for produce opens a metre. Servos report slightly less than 0 when pressed shut.
    "block_mm": (0.0, 1000.0),
    "width_mm": (-20.0, 1000.0),
    # From a vacuum to ten times the air pressure that soft fingers withstand.
    "pressure_kpa": (-101.325, 1000.0),
    # Either direction; above this a servo's cable burns.
    "current_ma": (-1e5, 1e5),
    # Above this, the pixel is open: a dry circuit board conducts as well.
    "ohm": (0.0, 1e9),
}
#: Entries of one list. A day of guided calibration gives a tenth; more would take hours to fit.
_MOST_ENTRIES = 100_000
#: Sum of the pixels against the stored sum, relative; above rounding, below a changed digit.
_SUM_TOLERANCE = 0.001
_REMEDY = "restore a backup or calibrate again"
_ORIGINS = ("hardware", "simulated")

_INVALID_JSON = "incomplete or invalid JSON ({}); restore a backup or calibrate again"


@dataclass(frozen=True, slots=True, kw_only=True)
class RestValues:
    """Readings of the pixels without load.

    Attributes
    ----------
    ohm : tuple of tuple of float, shape (rows, cols)
        Robust mean resistance of each pixel.
    spread_percent : tuple of tuple of float, shape (rows, cols)
        Standard deviation of each pixel, percent of its rest value.
    frames : int
        Number of frames used.
    """

    ohm: tuple[tuple[float, ...], ...]
    spread_percent: tuple[tuple[float, ...], ...]
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ForcePairs:
    """Sheet readings paired with a reference force, one entry per reading.

    Attributes
    ----------
    run : tuple of int
        Number of the load cell placement. The cell does not move on the sheet during a run.
    since_move_s : tuple of float
        Time since the last movement.
    excess : tuple of float
        Excess conductance G/G0 - 1 summed over pixels.
    relative_percent : tuple of float
        Mean relative change (paper, eq. 1).
    force_n : tuple of float
        Reference: mean of the fingers' normal forces.
    pixel_excess : tuple of tuple of float
        Excess conductance of each pixel, row by row, which shows the distribution of the load.
        Empty if only the sum was stored.
    """

    run: tuple[int, ...]
    since_move_s: tuple[float, ...]
    excess: tuple[float, ...]
    relative_percent: tuple[float, ...]
    force_n: tuple[float, ...]
    pixel_excess: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        missing = () if self.pixel_excess else ("pixel_excess",)
        _check_lengths(self, what="force pairs", ignore=missing)
        _check_ranges(self, where="force")
        self._check_sums()
        if len(self.force_n) >= 4 and np.ptp(self.force_n) < 0.01 * max(map(abs, self.force_n)):
            raise CalibrationError(
                f"force pairs: the reference force stays at {self.force_n[0]:g} N; "
                "is the load cell connected?"
            )

    def _check_sums(self) -> None:
        """Check that each entry has all pixels and that they add up."""
        most = max(map(len, self.pixel_excess), default=0)
        for place, (pixels, total) in enumerate(zip(self.pixel_excess, self.excess, strict=False)):
            if len(pixels) != most:
                raise CalibrationError(
                    f"force.pixel_excess[{place}] has {len(pixels)} pixels, but other entries have "
                    f"{most}; {_REMEDY}"
                )
            tolerance = _SUM_TOLERANCE * max(1.0, sum(map(abs, pixels)))
            if abs(sum(pixels) - total) > tolerance:
                raise CalibrationError(
                    f"force.excess[{place}] is {total:g}, but its pixels add up to "
                    f"{sum(pixels):g}; {_REMEDY}"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockPairs:
    """Readings of a closure on a rigid block, which measure the gripper's own compliance.

    Attributes
    ----------
    block_mm : tuple of float
        True size of the block, one entry per reading.
    width_mm : tuple of float
        Width reported by the gripper; empty for a pressure-controlled gripper.
    force_n : tuple of float
        Grip force of the reading.
    pressure_kpa : tuple of float
        Pressure reported by the gripper; empty for a width-controlled gripper.
    """

    block_mm: tuple[float, ...]
    width_mm: tuple[float, ...]
    force_n: tuple[float, ...]
    pressure_kpa: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        drives = {"width_mm": self.width_mm, "pressure_kpa": self.pressure_kpa}
        unused = [name for name, values in drives.items() if not values]
        _check_lengths(self, what="block pairs", ignore=unused if len(unused) == 1 else ())
        _check_ranges(self, where="block")


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The calibration of one sensor on one gripper.

    Attributes
    ----------
    sensor_id : str
        Name of the sensor.
    origin : str
        ``"hardware"`` or ``"simulated"``.
    layout : ArrayLayout
        Layout and readout circuit.
    rest : RestValues
        Readings of the pixels without load.
    force : ForcePairs
        Raw pairs of reading and force.
    block : BlockPairs
        Raw pairs of width and force on a rigid block.
    force_law : mapping
        The law fitted to `force`, in the form of its `as_dict`; for human readers of the file.
    made_at : str or None
        ISO 8601 date and time.
    current : CurrentPairs or None
        Servo current paired with the load cell during closing; None if no current is reported.
    held_out : mapping
        Error near 1, 5 and 10 N on placements or loads excluded from the fit, percent.

    Examples
    --------
    >>> Calibration.load("no-such-file.json")
    Traceback (most recent call last):
    palpate.errors.CalibrationError: calibration no-such-file.json: No such file or directory; \
`palpate calibrate rest` creates one
    """

    sensor_id: str
    origin: str
    layout: ArrayLayout
    rest: RestValues
    force: ForcePairs
    block: BlockPairs
    force_law: Mapping[str, Any] = field(default_factory=dict)
    made_at: str | None = None
    current: CurrentPairs | None = None
    held_out: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.origin not in _ORIGINS:
            raise CalibrationError(
                f"origin is {self.origin!r:.40}; it must be one of {', '.join(_ORIGINS)}"
            )
        self._check_layout()
        if not (self.rest_ohm > 0).all():
            raise CalibrationError("rest: every pixel must have a resistance above 0 ohm")
        _check_ranges(self.rest, where="rest")
        if not (self.made_at is None or _is_date(self.made_at)):
            raise CalibrationError(
                f"made_at is {self.made_at!r}; it must be a date such as 2026-05-04T08:00:00+00:00"
            )

    def _check_layout(self) -> None:
        """Check the layout's name, and the lists of pixels against it."""
        layout = self.layout
        known = _LAYOUTS.get(layout.name)
        if known is not None and (known.rows, known.cols) != (layout.rows, layout.cols):
            raise CalibrationError(
                f"layout.name is {layout.name!r}, which has {known.rows} x {known.cols} pixels, "
                f"but the file has {layout.rows} x {layout.cols}; {_REMEDY}"
            )
        for name, lines in (("ohm", self.rest.ohm), ("spread_percent", self.rest.spread_percent)):
            columns = sorted({len(line) for line in lines})
            if (len(lines), columns) != (layout.rows, [layout.cols]):
                raise CalibrationError(
                    f"rest.{name}: {len(lines)} rows of {' or '.join(map(str, columns)) or 0} "
                    f"values for a layout of {layout.rows} x {layout.cols} pixels; {_REMEDY}"
                )
        pixels = {len(entry) for entry in self.force.pixel_excess}
        if pixels - {layout.pixels}:
            raise CalibrationError(
                f"force.pixel_excess has {pixels.pop()} pixels, but the layout has "
                f"{layout.pixels}; {_REMEDY}"
            )

    @property
    def rest_ohm(self) -> NDArray[np.float64]:
        """Rest resistances, shape (rows, cols)."""
        return np.array(self.rest.ohm, dtype=float)

    def as_text(self) -> str:
        """Return the content of the file."""
        document = {"format": FORMAT, "version": VERSION, **asdict(self)}
        return _collapse_number_lists(json.dumps(document, indent=1, allow_nan=False)) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the file atomically."""
        text = self.as_text()
        with atomic_path(path) as partial:
            partial.write_text(text)

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration file.

        Raises
        ------
        CalibrationError
            If the file can't be read, is truncated or from a newer version, or if a value is
            missing or has a wrong name (names include units). The message is one line.
        """
        try:
            text = Path(path).read_text(encoding="utf-8-sig")
        except OSError as error:
            absent = isinstance(error, FileNotFoundError)
            remedy = "; `palpate calibrate rest` creates one" if absent else ""
            raise CalibrationError(f"calibration {path}: {error.strerror}{remedy}") from error
        except ValueError as error:  # not text, or a name with NUL
            raise CalibrationError(f"calibration {path}: {_INVALID_JSON.format(error)}") from error
        return cls.from_text(text, where=f"calibration {path}")

    @classmethod
    def from_text(cls, text: str, *, where: str = "calibration") -> Calibration:
        """Parse the output of `as_text`, such as the calibration in a recording.

        Parameters
        ----------
        text : str
            The content of a calibration file.
        where : str
            Origin of the text, for error messages.

        Raises
        ------
        CalibrationError
            Under the same conditions as in `load`.
        """
        try:
            document = load_json(text)
        except (ValueError, RecursionError) as error:
            raise CalibrationError(f"{where}: {_INVALID_JSON.format(error)}") from error
        try:
            return cls._from_document(document)
        except (CalibrationError, ValueError) as error:
            raise CalibrationError(f"{where}: {error}") from error

    @classmethod
    def _from_document(cls, document: Any) -> Calibration:
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise CalibrationError(
                f"not a calibration file: its format is not {FORMAT!r}; choose another file, or "
                "create one with `palpate calibrate rest`"
            )
        version = document.get("version")
        if version not in _READABLE_VERSIONS:
            raise CalibrationError(
                f"written by another version of palpate (file version {version}, "
                f"this one reads up to {VERSION}); update palpate or calibrate again"
            )
        if not isinstance(document.get("layout"), dict):
            raise CalibrationError(f"no table `layout`; {_REMEDY}")
        ignored = ("format", "version", *_OBSOLETE_KEYS)
        return load_dataclass(cls, {k: v for k, v in document.items() if k not in ignored})


def _is_date(value: object) -> bool:
    try:
        return isinstance(value, str) and bool(datetime.fromisoformat(value))
    except ValueError:
        return False


_LAYOUTS = {layout.name: layout for layout in (RIGID_LAYOUT, SOFT_LAYOUT)}


def _check_ranges(stored: Any, *, where: str) -> None:
    """Check the numbers of a dataclass against the plausible ranges of its fields."""
    for name in (one.name for one in fields(stored)):
        values = getattr(stored, name)
        if not isinstance(values, tuple):
            continue
        if len(values) > _MOST_ENTRIES:
            raise CalibrationError(
                f"{where}.{name} has {len(values)} entries; at most {_MOST_ENTRIES} can be used"
            )
        if name not in _RANGES:
            continue
        low, high = _RANGES[name]
        for place, entry in enumerate(values):
            for value in entry if isinstance(entry, tuple) else (entry,):
                if not low <= value <= high:
                    raise CalibrationError(
                        f"{where}.{name}[{place}] is {value:g}; it must be from {low:g} to "
                        f"{high:g}; {_REMEDY}"
                    )


def _check_lengths(pairs: Any, *, what: str, ignore: Sequence[str]) -> None:
    names = [f.name for f in fields(pairs) if f.name not in ignore]
    lengths = {name: len(getattr(pairs, name)) for name in names}
    if len(set(lengths.values())) != 1:
        raise CalibrationError(f"{what} of unequal length: {lengths}")


def _collapse_number_lists(text: str) -> str:
    """Put each list of numbers on one line, to keep the file readable."""
    lines: list[str] = []
    for line in text.splitlines():
        inner = line.strip()
        if lines and lines[-1].rstrip().endswith("[") and not inner.endswith(("[", "{")):
            lines[-1] += inner
        elif lines and "[" in lines[-1] and not lines[-1].rstrip().endswith(("]", "],", "[")):
            lines[-1] += inner if inner.startswith("]") else f" {inner}"
        else:
            lines.append(line)
    return "\n".join(lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentPairs:
    """Readings of the servo current during closing, one entry per reading.

    Readings are taken in motion, where the full friction of the gears opposes the servo. At rest,
    static friction can carry part of the load in either direction.

    Raises `CalibrationError` if the columns differ in length or contain a non-finite number.
    """

    #: Reference: mean of the fingers' normal forces.
    force_n: tuple[float, ...]
    #: Current reported by the servo at the same time.
    current_ma: tuple[float, ...]
    #: Opening at the same time; empty in older files.
    width_mm: tuple[float, ...] = ()
    #: Number of the movement during the reading; empty in older files.
    movement: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        expected = len(self.force_n)
        for name in ("current_ma", "width_mm", "movement"):
            count = len(getattr(self, name))
            is_omitted = count == 0 and name != "current_ma"
            if count != expected and not is_omitted:
                raise CalibrationError(
                    f"current: force_n has {expected} values, but {name} has {count}"
                )
        if bool(self.width_mm) != bool(self.movement):
            raise CalibrationError("current: give both width_mm and movement, or neither")
        if not np.isfinite([*self.force_n, *self.current_ma, *self.width_mm]).all():
            raise CalibrationError("current: all entries must be finite numbers")
        _check_ranges(self, where="current")


def join_currents(*parts: CurrentPairs) -> CurrentPairs:
    """Concatenate the readings of several runs and renumber their movements.

    >>> one = CurrentPairs(force_n=(0.0,), current_ma=(40.0,), width_mm=(30.0,), movement=(0,))
    >>> join_currents(one, one).movement
    (0, 1)
    """
    numbers, first = list[int](), 0
    for part in parts:
        numbers += [first + movement for movement in part.movement]
        first += 1 + max(part.movement, default=-1)
    return CurrentPairs(
        force_n=tuple(value for part in parts for value in part.force_n),
        current_ma=tuple(value for part in parts for value in part.current_ma),
        width_mm=tuple(value for part in parts for value in part.width_mm),
        movement=tuple(numbers),
    )
