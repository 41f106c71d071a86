"""The reading of a force law from the columns of a table: excess conductance of each pixel.

For a resistance R and its value R0 without load the excess is R0/R - 1. A pixel that is open
without load has R0 = 1e9 ohm, so that its excess is its conductance in another unit. A voltage, or
another signal that rises with the load, is used as its rise from the value without load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibrate.loaded_sensor import LoadedPart, LoadedSensor
from palpate.errors import InputError
from palpate.sensor.sample import excess_of_change
from palpate.signal.circuit import Divider, resistance_ohm

#: How readings are converted.
Form: TypeAlias = Literal["resistance", "percent", "signal"]
#: Resistance of a pixel that is open without load; the largest one of a calibration file.
OPEN_OHM = 1e9
#: Largest counts of converters, one of which the readings of an open or short pixel reach.
_TOPS = {2**bits - 1: bits for bits in range(8, 17)}
#: A load up to this, newtons, or this fraction of the largest, counts as none: a load cell drifts
#: by less, and its digit may be large (on a force plate 0.5 N of 30 N).
_NO_LOAD_N, _NO_LOAD_FRACTION = 0.1, 0.02
#: A pixel that is open without load is loaded from this multiple of that quantile of its noise.
_IDLE_RATIO, _IDLE_QUANTILE = 2.0, 0.95
#: A reading without load above this fraction of the median reading under a load is a touch.
_TOUCHED_FRACTION = 0.1
#: A pixel is open without load if more than this fraction of these readings is.
_OPEN_FRACTION = 0.1
#: Fewest readings without load of a recording.
_FEWEST_REST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetReading:
    """Converts the columns of one sensor to excess conductance.

    Attributes
    ----------
    columns : tuple of str
        Columns of the pixels.
    form : {"resistance", "percent", "signal"}
        Kind of the columns.
    divider : Divider or None
        Circuit of columns in counts.
    falls : bool
        Whether a signal falls with the load.
    rest : tuple of float
        Value of each pixel without load: ohm, 0 %, or that of the signal.
    rest_spread_percent : tuple of float
        Standard deviation of each pixel without load, percent of its rest value; 0 if open.
    rest_readings : int
        Number of readings without load.
    knows_ohm : bool
        Whether resistances are in ohm, and not in units of an unknown reference resistor.
    """

    columns: tuple[str, ...]
    form: Form
    divider: Divider | None
    falls: bool
    rest: tuple[float, ...]
    knows_ohm: bool
    rest_spread_percent: tuple[float, ...] = ()
    rest_readings: int = 0
    #: Excess of a pixel that is open without load up to which it is noise.
    idle_excess: float = 0.0

    def resistances(self, values: FloatArray) -> FloatArray:
        """Return columns as resistances, infinite if open, shape (n, columns)."""
        if self.divider is not None:
            known = np.isfinite(values)
            ohm = resistance_ohm(np.where(known, values, 1.0), divider=self.divider)
            return np.where(known, ohm, np.nan)
        return values

    def excess(self, values: FloatArray) -> FloatArray:
        """Return the excess of each pixel, shape (n, columns).

        NaN without a reading, infinite if the pixel is short.
        """
        rest = np.array(self.rest)
        if self.form == "percent":
            return excess_of_change(values)
        if self.form == "signal":
            return np.asarray((rest - values) if self.falls else (values - rest))
        ohm = self.resistances(values)
        with np.errstate(divide="ignore"):
            excess = np.where(ohm > 0, rest / ohm - 1.0, np.where(ohm == 0, np.inf, np.nan))
        # An open pixel counts as unloaded: one that is open at rest has its value at rest.
        unloaded = np.where(rest < OPEN_OHM, np.nan, 0.0)
        return np.where(np.isposinf(ohm), unloaded, excess)

    def quieted(self, excess: FloatArray) -> FloatArray:
        """Return the excess, shape (n, columns), with 0 for the noise of open pixels."""
        is_open = np.array(self.rest) >= OPEN_OHM
        return np.where(is_open & (excess <= self.idle_excess), 0.0, excess)

    def total(self, values: FloatArray) -> FloatArray:
        """Return the excess summed over pixels, shape (n,).

        An open pixel counts as unloaded. NaN where a pixel is short or none has a reading.
        """
        excess = self.excess(values)
        total = np.nansum(np.where(np.isposinf(excess), 0.0, excess), axis=1)
        unusable = np.isposinf(excess).any(axis=1) | np.isnan(excess).all(axis=1)
        return np.where(unusable, np.nan, total)


def learn_reading(
    sensor: LoadedSensor, *, rest_s: tuple[float, float] | None = None
) -> tuple[SheetReading, list[str]]:
    """Return the conversion of a sensor's columns, and what was taken as what.

    `rest_s`: start and end of a stretch without load, seconds of the first recording. By default
        the readings without load, or those before the first weight.
    Raises `InputError` if the columns can't be converted.

    >>> from palpate.calibrate.loaded_readings import read_loaded
    >>> (sensor,) = read_loaded({"load_n": [0, 1.0, 2.0], "R_ohm": [9e3, 3e3, 1e3]})
    >>> reading, _ = learn_reading(sensor)
    >>> reading.excess(sensor.parts[0].values).ravel().tolist()
    [0.0, 2.0, 8.0]
    """
    rises = _rises_with_load(sensor)
    form, divider, text = _find_form(sensor, rises=rises)
    taken = [text]
    values, where = _rest_values(sensor, rest_s=rest_s)
    reading = SheetReading(
        columns=sensor.columns,
        form=form,
        divider=divider,
        falls=not rises,
        rest=(0.0,) * len(sensor.columns),
        knows_ohm=sensor.unit == "ohm" or sensor.divider is not None,
    )
    if form == "percent":
        return reading, taken
    if form == "signal":
        rest = np.zeros(len(sensor.columns)) if values is None else _medians(values)
        if np.isnan(rest).any():
            raise InputError(f"{sensor.name}: a column has no reading without load; use --rest")
        taken.append(f"without load: {_list(rest)} ({where})")
    else:
        rest = np.full(len(sensor.columns), np.inf)
        if values is not None:
            ohm = reading.resistances(values)
            # One count of noise is not a resistance at rest.
            mostly_open = np.isposinf(ohm).mean(axis=0) > _OPEN_FRACTION
            rest = np.where(mostly_open, np.inf, _medians(ohm))
        is_open = ~(np.isfinite(rest) & (rest > 0))
        unit = " ohm" if reading.knows_ohm else " times the reference resistor"
        if is_open.any():
            # Otherwise one pixel would outweigh the others.
            rest = np.full(len(sensor.columns), OPEN_OHM)
            taken.append(f"without load: open ({where}); the conductance is used")
        else:
            taken.append(f"without load: {_list(rest)}{unit} ({where})")
    spread = np.zeros(len(rest))
    if form == "resistance" and values is not None and rest.max() < OPEN_OHM:
        ohm = reading.resistances(values)
        spread = 100.0 * np.nanstd(np.where(np.isfinite(ohm), ohm, np.nan), axis=0) / rest
    idle = 0.0
    if form == "resistance" and values is not None and rest.max() >= OPEN_OHM:
        opened = replace(reading, rest=tuple(rest.tolist()))
        touched = _is_touched(opened, values, sensor=sensor)
        if touched.any():
            taken.append(
                f"{np.count_nonzero(touched)} of {touched.size} readings without load are those "
                "of a load; left out"
            )
        values = values[~touched]
        idle = _IDLE_RATIO * float(np.nanquantile(opened.excess(values), _IDLE_QUANTILE))
    return replace(
        reading,
        idle_excess=idle,
        rest=tuple(rest.tolist()),
        rest_spread_percent=tuple(np.minimum(spread, 100.0).tolist()),
        rest_readings=0 if values is None else len(values),
    ), taken


def _is_touched(
    reading: SheetReading, rest: FloatArray, *, sensor: LoadedSensor
) -> NDArray[np.bool_]:
    """Return which readings without load are those of a load, shape (n,): somebody touched it.

    `rest`: readings without load of pixels that are then open, shape (n, columns).
    """
    loaded = [
        reading.total(part.values)[np.isfinite(part.load_n) & ~is_unloaded(part.load_n)]
        for part in sensor.parts
    ]
    usual = np.concatenate(loaded)
    usual = usual[usual > 0]
    if not usual.size:
        return np.zeros(len(rest), dtype=bool)
    return np.asarray(reading.total(rest) > _TOUCHED_FRACTION * np.median(usual))


def _is_before_contact(part: LoadedPart) -> NDArray[np.bool_]:
    """Return the readings before the first contact.

    A sheet recovers slowly from a load. On ten recordings of real presses the held-out error was
    .30 in ln force with these readings, and .35 with all without load.
    """
    unloaded = is_unloaded(part.load_n)
    contact = ~unloaded & np.isfinite(part.load_n)
    return np.asarray(unloaded & (np.cumsum(contact) == 0))


def is_unloaded(load_n: FloatArray) -> NDArray[np.bool_]:
    """Return which loads are none, shape (n,)."""
    most = float(np.nanmax(load_n, initial=0.0))
    return np.asarray(load_n <= max(_NO_LOAD_N, _NO_LOAD_FRACTION * most))


def is_weight(load_n: FloatArray) -> NDArray[np.bool_]:
    """Return which loads of settled readings are weights, shape (n,); False where unknown.

    A load cell that also reads below 0 is that far from 0 without a load, to either side.

    >>> is_weight(np.array([-0.01, 0.015, 0.05, 1.0])).tolist()
    [False, False, True, True]
    """
    return np.asarray(load_n > max(0.0, -2.0 * float(np.nanmin(load_n, initial=0.0))))


def _rest_values(
    sensor: LoadedSensor, *, rest_s: tuple[float, float] | None
) -> tuple[FloatArray | None, str]:
    """Return the readings without load and where they are; None if there are none."""
    if rest_s is not None:
        first = sensor.parts[0]
        inside = (first.time_s >= rest_s[0]) & (first.time_s <= rest_s[1])
        if not inside.any():
            raise InputError(
                f"{sensor.name}: no reading from {rest_s[0]:g} to {rest_s[1]:g} s; change --rest"
            )
        return first.values[inside], f"{rest_s[0]:g} to {rest_s[1]:g} s"
    found = list[FloatArray]()
    for part in sensor.parts:
        if sensor.is_settled:
            weighed = is_weight(part.load_n)
            empty = np.isfinite(part.load_n) & ~weighed
            # A sheet recovers slowly from a load, so that a later row is not at rest.
            before = empty & (np.cumsum(weighed) == 0)
            found.append(part.values[before if before.any() else empty])
        elif part.weighed:
            found.append(part.values[_is_before_weights(part)])
        else:
            found.append(part.values[_is_before_contact(part)])
    values = np.concatenate(found)
    if not sensor.is_settled and len(values) < _FEWEST_REST:
        values = np.concatenate([part.values[is_unloaded(part.load_n)] for part in sensor.parts])
    if len(values) < (1 if sensor.is_settled else _FEWEST_REST):
        least_n = min(float(np.nanmin(part.load_n, initial=np.inf)) for part in sensor.parts)
        return None, (
            "no reading without load"
            if sensor.is_settled
            else f"the load is never below {least_n:.3g} N: tare the load cell if that is no load"
        )
    if sensor.is_settled:
        return values, "at 0 N"
    if any(part.weighed for part in sensor.parts):
        return values, "before the first weight"
    return values, f"median of {len(values)} readings without load"


def _is_before_weights(part: LoadedPart) -> NDArray[np.bool_]:
    """Return the first readings, while they are near the first: before the first hold."""
    first_s = part.time_s[0]
    limit_s = min(first_s + 1.0, min(begin_s for begin_s, _, _ in part.weighed))
    return np.asarray(part.time_s <= limit_s)


def _medians(values: FloatArray) -> FloatArray:
    known = np.where(np.isnan(values), np.inf, values)
    return np.asarray(np.median(known, axis=0))


def _rises_with_load(sensor: LoadedSensor) -> bool:
    """Return whether the readings rise with the load, by their rank correlation."""
    loads, values = list[FloatArray](), list[FloatArray]()
    for part in sensor.parts:
        most = np.nanmax(np.where(np.isfinite(part.values), part.values, np.nan), axis=0)
        # An open sensor reads more than any number.
        summed = np.nansum(np.where(np.isposinf(part.values), 2.0 * most, part.values), axis=1)
        if part.weighed:
            rest = _is_before_weights(part)
            loads += [np.zeros(int(rest.sum()))]
            values += [summed[rest]]
            for begin_s, end_s, load_n in part.weighed:
                inside = (part.time_s >= begin_s) & (part.time_s <= end_s)
                loads.append(np.full(int(inside.sum()), load_n))
                values.append(summed[inside])
        else:
            known = np.isfinite(part.load_n)
            loads.append(part.load_n[known])
            values.append(summed[known])
    every_n, every = np.concatenate(loads), np.concatenate(values)
    if every_n.size < 2 or np.ptp(every_n) == 0:
        raise InputError(f"{sensor.name}: the load does not change; use several loads")
    if np.ptp(every) == 0:
        raise InputError(f"{sensor.name}: the readings do not change with the load")
    of_load, of_value = (
        np.unique(one, return_inverse=True)[1].astype(float) for one in (every_n, every)
    )
    return bool(np.corrcoef(of_load, of_value)[0, 1] > 0)


def _find_form(sensor: LoadedSensor, *, rises: bool) -> tuple[Form, Divider | None, str]:
    """Return the kind of columns, their circuit, and both in words."""
    names = ", ".join(sensor.columns)[:120]
    if sensor.divider is not None:
        return "resistance", sensor.divider, f"{names}: counts, converted to ohm"
    if sensor.unit == "ohm":
        return "resistance", None, f"{names}: ohm"
    if sensor.unit == "percent":
        return "percent", None, f"{names}: change of resistance from rest, %"
    if sensor.unit == "counts" or sensor.adc_bits is not None:
        values = np.concatenate([part.values.ravel() for part in sensor.parts])
        top = float(np.nanmax(values[np.isfinite(values)]))
        bits = sensor.adc_bits or (_TOPS.get(int(top)) if top == int(top) else None)
        if bits is not None and not 0 <= top < 2**bits:
            raise InputError(
                f"{sensor.name}: {names}: readings reach {top:g}, but {bits} bits count to "
                f"{2**bits - 1}; correct --adc-bits"
            )
        if bits is None:
            raise InputError(
                f"{sensor.name}: {names}: counts need --adc-bits, such as 10 of an Arduino Uno"
            )
        divider = count_divider(bits, rises=rises)
        return (
            "resistance",
            divider,
            (
                f"{names}: counts of {bits} bits, because they reach {top:.6g}; they "
                f"{'rise' if rises else 'fall'} with the load"
            ),
        )
    if sensor.unit is None and not rises:
        return "resistance", None, f"{names}: resistances, because they fall with the load"
    moves = "rises" if rises else "falls"
    text = f"{names}: a signal that {moves} with the load; its change is used"
    if sensor.unit == "volt":
        text += " (of a voltage divider: give --supply-v, such as 3.3)"
    return "signal", None, text


def count_divider(adc_bits: int, *, rises: bool) -> Divider:
    """Return the divider of counts whose reference resistor is unknown: it is the unit.

    >>> count_divider(10, rises=True).taxel_leg
    'upper'
    """
    return Divider(adc_bits=adc_bits, reference_ohm=1.0, taxel_leg="upper" if rises else "lower")


def _list(numbers: Sequence[float] | FloatArray) -> str:
    shown = [f"{number:.4g}" for number in numbers]
    return ", ".join(shown[:8]) + (", ..." if len(shown) > 8 else "")
