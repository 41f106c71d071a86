"""The force law of a sensor from readings with known loads, and newtons from its readings.

There is one law, `palpate.ForceLaw`. Weights update it with settled readings. A column of loads, or
a load cell, updates it with readings and their history. On each kind of real recording, contacts or
loads that the fit did not see decided between this law, a power law and `SheetLaw`
(docs/force.md#newtons-from-your-files).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.force_law import add_force_law
from palpate.calibrate.held_out import HeldOut
from palpate.calibrate.loaded_readings import read_loaded
from palpate.calibrate.loaded_sensor import LoadedPart, LoadedSensor, TableOptions
from palpate.calibrate.moving_load import fit_moving
from palpate.calibrate.rest import format_now, replace_rest
from palpate.calibrate.sheet_reading import SheetReading, learn_reading
from palpate.calibrate.weighed import pair_weights, score_loads
from palpate.calibration import Calibration, ForcePairs, RestValues
from palpate.errors import InputError
from palpate.force.creep_update import EARLY_S
from palpate.force.force_law import ForceLaw
from palpate.force.of_calibration import HORIZON_S, follow_force, force_law_of
from palpate.force.sheet_law import SheetLaw
from palpate.measurement import Measurement, Status
from palpate.sensor.array import ArrayLayout
from palpate.sensor.sample import change_of_excess


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceTrace:
    """Newtons of a recording, or of settled readings; arrays of shape (n,).

    Attributes
    ----------
    name : str
        Name of the recording.
    time_s : ndarray
        Seconds; row numbers of settled readings.
    force_n, low_n, high_n : ndarray
        Force and its interval, with a level of 90 %. Where a pixel is short, the force is NaN and
        the lower end a bound; without a reading the upper end is infinite.
    load_n : ndarray
        Known load; NaN where unknown.
    """

    name: str
    time_s: FloatArray
    force_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray
    load_n: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedForce:
    """A sensor's force law with the conversion of its columns.

    Attributes
    ----------
    law : ForceLaw or SheetLaw
        Law of the summed excess; a calibration file with a load cell has a `SheetLaw`.
    reading : SheetReading
        Conversion of the columns.
    kind : {"weights", "load cell", "calibration"}
        Whether the law was fitted to settled readings, to readings with history, or before.
    excess, force_n, contact : ndarray, shape (pairs,)
        Readings of the fit, their loads, and the number of the contact.
    early : ndarray, shape (pairs,)
        Excess soon after the weight was placed; NaN if unknown.
    held_out : HeldOut or None
        Errors on contacts or loads that the law did not see; None if there are too few.
    taken : list of str
        What was taken as what, one sentence each.
    """

    law: ForceLaw | SheetLaw
    reading: SheetReading
    kind: str
    excess: FloatArray
    force_n: FloatArray
    contact: FloatArray
    early: FloatArray
    held_out: HeldOut | None
    taken: list[str]

    def force(self, source: Any, **options: Any) -> list[ForceTrace]:
        """Return the newtons of other readings of this sensor, with 90 % intervals.

        `source`, `options`: as in `palpate.read_recording`. The columns are those of the fit; a
            single column of readings may have another name.
        Raises `InputError` if the readings can't be used.
        """
        named = {"value_columns": self.reading.columns, **options}
        try:
            sensor = read_readings(source, TableOptions(**named))
        except InputError:
            if "value_columns" in options or len(self.reading.columns) > 1:
                raise
            sensor = read_readings(source, TableOptions(**options))
            if len(sensor.columns) > 1:
                raise
        return self.traces(sensor)

    def traces(self, sensor: LoadedSensor) -> list[ForceTrace]:
        """Return the newtons of each recording of this sensor."""
        return [self.trace(part, is_settled=sensor.is_settled) for part in sensor.parts]

    def trace(self, part: LoadedPart, *, is_settled: bool) -> ForceTrace:
        """Return the newtons of one recording, or of settled readings."""
        excess = self.reading.quieted(self.reading.excess(part.values))
        if not is_settled:
            follower = follow_force(self.law)
            pairs = zip(part.time_s.tolist(), excess, strict=True)
            found = [follower.step(at_s, frame[None]) for at_s, frame in pairs]
        elif isinstance(self.law, ForceLaw):
            found = [self._settled_force(self.law, frame) for frame in excess]
        else:
            raise InputError(
                f"{part.name}: a calibration with a load cell needs the times of the readings"
            )
        load_n = part.load_n.copy()
        for begin_s, end_s, weight_n in part.weighed:
            load_n[(part.time_s >= begin_s) & (part.time_s <= end_s)] = weight_n
        return ForceTrace(
            name=part.name,
            time_s=part.time_s,
            force_n=np.array([np.nan if one.value is None else one.value for one in found]),
            low_n=np.array([one.low for one in found]),
            high_n=np.array([one.high for one in found]),
            load_n=load_n,
        )

    @staticmethod
    def _settled_force(law: ForceLaw, frame: FloatArray) -> Measurement:
        """Return the force of a settled reading; unknown if a pixel is short or all are open."""
        total = float(np.nansum(frame))
        if np.isnan(frame).all() or not np.isfinite(total):
            return Measurement(
                value=None, low=0.0, high=np.inf, unit="n", status=Status.NOT_MEASURED
            )
        return law.force(max(total, 0.0))


def fit_force(
    source: Any,
    *,
    weights: Any = None,
    load_cell: Any = None,
    rest_s: tuple[float, float] | None = None,
    **options: Any,
) -> FittedForce:
    """Fit the force law of a sensor to readings with known loads.

    Parameters
    ----------
    source : path, mapping of str to array_like, or DataFrame
        Readings, as in `palpate.read_recording`. A column of loads in N, g or kg (``load_n``,
        ``weight_g``) is recognised by its name. Without a clock, each row is a settled reading.
    weights : path, mapping, or sequence of float, optional
        Weights in the order in which they were on the sensor; a sequence is in newtons.
    load_cell : path or mapping, optional
        Times and loads of a load cell on the clock of the readings.
    rest_s : tuple of float, optional
        Start and end of a stretch without load, seconds.
    **options
        `load_column`, `load_unit`, `adc_bits` and the options of `palpate.read_recording`.

    Raises
    ------
    InputError
        If the readings or loads can't be used.
    CalibrationError
        If the loads are too few, or the readings do not rise with the load.

    Examples
    --------
    >>> table = {"load_n": [0, 1.5, 4.0, 9.0], "R_ohm": [9000.0, 900.0, 350.0, 150.0]}
    >>> fitted = fit_force(table)
    >>> (trace,) = fitted.force({"R_ohm": [9000.0, 500.0]})
    >>> trace.force_n.round(1).tolist(), bool(trace.low_n[1] < 2.8 < trace.high_n[1])
    ([0.0, 2.7], True)
    """
    sensors = read_loaded(
        source, weights=weights, load_cell=load_cell, options=TableOptions(**options)
    )
    if len(sensors) > 1:
        names = ", ".join(one.name for one in sensors)
        raise InputError(f"the table has {len(sensors)} sensors ({names[:120]}); pass one of them")
    return fit_sensor(sensors[0], rest_s=rest_s)


def read_readings(source: Any, options: TableOptions) -> LoadedSensor:
    """Read readings whose loads may be unknown.

    Raises `InputError` if they can't be used, or belong to several sensors.
    """
    sensors = read_loaded(source, options=options, require_loads=False)
    if len(sensors) > 1:
        raise InputError(f"{sensors[0].name}: the table has {len(sensors)} sensors; split it")
    return sensors[0]


def fit_sensor(sensor: LoadedSensor, *, rest_s: tuple[float, float] | None = None) -> FittedForce:
    """Fit the force law to the readings of a sensor; raises as `fit_force`."""
    if not any(part.weighed or np.isfinite(part.load_n).any() for part in sensor.parts):
        raise InputError(
            f"{sensor.name}: no loads; give --weights or --load-cell, or a column of loads in N, g "
            "or kg"
        )
    reading, taken = learn_reading(sensor, rest_s=rest_s)
    weighed = sensor.is_settled or any(part.weighed for part in sensor.parts)
    if weighed:
        found = pair_weights(sensor, reading)
        excess, force_n, early = found.excess, found.force_n, found.early
        law, twice = ForceLaw.fit(excess.tolist(), force_n=force_n), np.isfinite(early)
        if twice.any():
            law.learn_creep(early[twice], settled=excess[twice])
        remarks = list(found.remarks)
        if sensor.parts[0].weighed:
            remarks.append(
                f"creep: from the readings {EARLY_S:g} s after placing {twice.sum()} of the weights"
            )
        contact = np.arange(force_n.size, dtype=float)
        held_out = score_loads(excess, force_n)
    else:
        law, excess, force_n, contact, held_out = fit_moving(sensor, reading)
        remarks, early = [], np.full(force_n.size, np.nan)
    range_n = f"{force_n.min():.3g} to {force_n.max():.3g} N"
    number = f"{force_n.size} weights" if weighed else f"{np.unique(contact).size} contacts"
    return FittedForce(
        law=law,
        reading=reading,
        kind="weights" if weighed else "load cell",
        excess=excess,
        force_n=force_n,
        contact=contact,
        early=early,
        held_out=held_out,
        taken=[*taken, *sensor.taken, f"{number}, {range_n}", *remarks],
    )


def make_calibration(fitted: FittedForce, *, earlier: Calibration | None, name: str) -> Calibration:
    """Return a calibration file's content with a fitted law, for `palpate live` and a rig.

    `earlier`: a calibration of the same sensor, whose layout and other parts are kept. Without one
        the layout has a row for each column of the readings.
    `name`: name of a new sensor.
    Raises `InputError` if the readings have no resistances, or the layout has other pixels.
    """
    reading = fitted.reading
    if reading.form != "resistance" or not reading.knows_ohm:
        raise InputError(
            "a calibration file has resistances, which these readings do not give; use ohms, or "
            "counts with --adc-bits, --reference-ohm and --sensor-leg"
        )
    pixels = len(reading.columns)
    layout = ArrayLayout(name=name, rows=pixels, cols=1, finger_of_row=(0,) * pixels)
    if reading.divider is not None:
        layout = replace(layout, divider=reading.divider)
    if earlier is not None:
        layout = earlier.layout
    if layout.pixels != pixels:
        raise InputError(
            f"the calibration file has {layout.pixels} pixels, and the readings {pixels}; choose "
            "them with --value-column, or save to another file"
        )
    shape = (layout.rows, layout.cols)
    rest = RestValues(
        ohm=_rows_of(reading.rest, shape),
        spread_percent=_rows_of(reading.rest_spread_percent, shape),
        frames=max(reading.rest_readings, 1),
    )
    by_weights = fitted.kind == "weights"
    # An early reading precedes the settled one of its weight.
    early = np.isfinite(fitted.early)
    row = np.repeat(np.arange(fitted.force_n.size), 1 + early)
    is_early = np.r_[np.diff(row) == 0, False]
    excess = np.where(is_early, fitted.early[row], fitted.excess[row])
    since_s = np.where(is_early, EARLY_S, HORIZON_S if by_weights else 0.0)
    run = row if by_weights else fitted.contact.astype(int)
    pairs = ForcePairs(
        run=tuple(run.tolist()),
        since_move_s=tuple(since_s.tolist()),
        excess=tuple(excess.tolist()),
        # Of equal pixels: the law uses the sum only.
        relative_percent=tuple(change_of_excess(excess / pixels).tolist()),
        force_n=tuple(fitted.force_n[row].tolist()),
    )
    base = replace_rest(earlier, rest, layout=layout, simulated=False)
    base = replace(base, force=pairs, made_at=format_now())
    if by_weights or not isinstance(fitted.law, ForceLaw):
        return add_force_law(base)
    held_out = {"of": "force in other contacts of the recording", "error_percent": {}}
    return replace(base, force_law=fitted.law.as_dict(), held_out=held_out)


def _rows_of(values: Sequence[float], shape: tuple[int, int]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.round(np.reshape(values, shape), 4).tolist()))


def use_calibration(calibration: Calibration, sensor: LoadedSensor, *, name: str) -> FittedForce:
    """Return the force law of a calibration file, for readings of its sensor.

    `name`: name of the file.
    Raises `CalibrationError` if the file has no law, `InputError` if the readings are not
    resistances, or have other pixels.
    """
    law, layout = force_law_of(calibration), calibration.layout
    if layout.pixels != len(sensor.columns):
        raise InputError(
            f"{name} has {layout.pixels} pixels, and the readings {len(sensor.columns)} columns "
            f"({', '.join(sensor.columns)[:80]}); choose them with --value-column"
        )
    is_counts = sensor.divider is not None
    if not (is_counts or sensor.unit == "ohm"):
        raise InputError(
            f"{sensor.name}: {name} has resistances, and the readings are in "
            f"{sensor.unit or 'an unknown unit'}; give --unit ohm or counts"
        )
    if is_counts and layout.idle_lines != "isolated":
        raise InputError(
            f"{sensor.name}: counts of a matrix have crosstalk; use the ohms of `palpate export`"
        )
    return FittedForce(
        law=law,
        reading=SheetReading(
            columns=sensor.columns,
            form="resistance",
            divider=sensor.divider,
            falls=True,
            rest=tuple(calibration.rest_ohm.ravel().tolist()),
            knows_ohm=True,
        ),
        kind="calibration",
        excess=np.array(calibration.force.excess),
        force_n=np.array(calibration.force.force_n),
        contact=np.array(calibration.force.run, dtype=float),
        early=np.full(len(calibration.force.run), np.nan),
        held_out=None,
        taken=[
            f"{', '.join(sensor.columns)[:120]}: {'counts' if is_counts else 'ohm'}",
            f"law and values without load: {name}",
        ],
    )
