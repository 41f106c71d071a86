"""Settled readings under weights, and the errors of held-out weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.early_reading import find_early
from palpate.calibrate.held_out import FEWEST_HELD_OUT, HeldOut, log_error, predict_power
from palpate.calibrate.loaded_sensor import LoadedSensor
from palpate.calibrate.sheet_reading import SheetReading, is_weight
from palpate.errors import CalibrationError
from palpate.force.force_law import ForceLaw
from palpate.force.line_law import MIN_PAIRS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WeightReadings:
    """Readings of n weights.

    `excess`, `force_n`, shape (n,): settled excess, and newtons.
    `early`, shape (n,): excess soon after the weight was placed; NaN where it is not recorded.
    `remarks`: weights without a reading.
    """

    excess: FloatArray
    force_n: FloatArray
    early: FloatArray
    remarks: list[str]


def pair_weights(sensor: LoadedSensor, reading: SheetReading) -> WeightReadings:
    """Return the readings of each weight.

    Raises `CalibrationError` if no weight has a reading.
    """
    found, loads, first = list[float](), list[float](), list[float]()
    for part in sensor.parts:
        total = reading.total(part.values)
        usable = np.isfinite(total)
        if sensor.is_settled:
            weights = is_weight(part.load_n)
            found += total[weights].tolist()
            loads += part.load_n[weights].tolist()
            first += [np.nan] * int(weights.sum())
        for begin_s, end_s, load_n in part.weighed:
            inside = (part.time_s >= begin_s) & (part.time_s <= end_s) & usable
            if load_n > 0:
                settled = float(np.median(total[inside])) if inside.any() else np.nan
                before = usable & (part.time_s < begin_s)
                early = find_early(part.time_s[before], total[before], settled=settled)
                found.append(settled)
                loads.append(load_n)
                first.append(float(total[before][early].mean()) if early.any() else np.nan)
    excess, force_n = np.array(found), np.array(loads)
    known, remarks = np.isfinite(excess), list[str]()
    if not known.all():
        gone = ", ".join(f"{load:g}" for load in force_n[~known][:8])
        remarks.append(f"no usable reading under {gone} N; omitted")
    if not known.any():
        raise CalibrationError(f"{sensor.name}: no weight has a usable reading")
    return WeightReadings(
        excess=excess[known], force_n=force_n[known], early=np.array(first)[known], remarks=remarks
    )


def score_loads(excess: FloatArray, force_n: FloatArray) -> HeldOut | None:
    """Hold out each load in turn."""
    loads = np.unique(force_n)
    if loads.size <= FEWEST_HELD_OUT:
        return None
    errors, covered, power, power_covered = ([] for _ in range(4))
    for load in loads:
        mine = force_n == load
        known, known_n = excess[~mine], force_n[~mine]
        law = ForceLaw.fit(known.tolist(), force_n=known_n)
        for one in excess[mine].tolist():
            answer = law.force(one)
            errors.append(log_error(answer.middle, load))
            covered.append(answer.low <= load <= answer.high)
        if known.size >= MIN_PAIRS:
            value, inside = predict_power(known, known_n, excess[mine], force_n[mine])
            power += value
            power_covered += inside
    return HeldOut(
        what="each weight in turn",
        groups=int(loads.size),
        readings=len(errors),
        median_abs_log_error=float(np.median(errors)),
        coverage=float(np.mean(covered)),
        power_median_abs_log_error=float(np.median(power)) if power else None,
        power_coverage=float(np.mean(power_covered)) if power else None,
    )
