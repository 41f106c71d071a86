"""Readings with history under a moving load, and the errors of held-out contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibrate.held_out import FEWEST_HELD_OUT, LEVEL, HeldOut, predict_power
from palpate.calibrate.loaded_sensor import LoadedSensor
from palpate.calibrate.settled_rows import SLOW_STEP_S
from palpate.calibrate.sheet_reading import OPEN_OHM, SheetReading
from palpate.errors import CalibrationError
from palpate.force.force_law import ForceLaw
from palpate.measurement import find_spread, half_width_sds

#: A contact is a stretch of larger loads, newtons and fraction of the largest. Shorter pauses,
#: seconds, belong to it, and fewer readings are none, unless a log is slow.
_CONTACT_N, _CONTACT_FRACTION, _PAUSE_S, _FEWEST_READINGS = 0.3, 0.03, 0.15, 3
#: Most readings of a contact, and contacts, in a fit: its duration rises with their product. More
#: readings of a contact are correlated with these.
_MOST_READINGS, _MOST_CONTACTS = 25, 60
#: Number of groups of contacts that are held out in turn.
_MOST_GROUPS = 10
#: Smallest load of held-out errors, newtons (as the studies of force).
_SCORED_N = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Contact:
    """Readings with history of one contact: all with a load, and those of the fit.

    `group`: number of what is held out together.
    """

    group: int
    inputs: FloatArray
    excess: FloatArray
    force_n: FloatArray
    thinned: NDArray[np.intp]


def fit_moving(
    sensor: LoadedSensor, reading: SheetReading
) -> tuple[ForceLaw, FloatArray, FloatArray, FloatArray, HeldOut | None]:
    """Fit the law to a moving load: law, excess, newtons and contact of the fit, errors."""
    totals = [reading.total(part.values) for part in sensor.parts]
    scale = _find_scale(sensor, totals, reading)
    contacts = [*_find_contacts(sensor, totals, scale=scale)]
    if not contacts:
        least_n = min(float(np.nanmin(part.load_n, initial=0.0)) for part in sensor.parts)
        if least_n < -_CONTACT_N:
            raise CalibrationError(
                f"{sensor.name}: the loads are negative, down to {least_n:.3g} N; change their "
                "sign, so that pressing is positive"
            )
        raise CalibrationError(
            f"{sensor.name}: the load never stays above {_CONTACT_N:g} N for "
            f"{_FEWEST_READINGS} readings; press harder, or check the unit of the load"
        )
    law = _fit_contacts(contacts, scale=scale)
    held_out, misfit = _score_contacts(contacts, scale=scale)
    law.misfit = misfit
    used = [(one.excess[one.thinned], one.force_n[one.thinned]) for one in contacts]
    number = np.concatenate([np.full(x.size, float(at)) for at, (x, _) in enumerate(used)])
    return (
        law,
        np.concatenate([x for x, _ in used]),
        np.concatenate([y for _, y in used]),
        number,
        held_out,
    )


def _find_scale(sensor: LoadedSensor, totals: Sequence[FloatArray], reading: SheetReading) -> float:
    """Return the factor to readings of the population: 1 for a sheet that conducts at rest."""
    if reading.form != "signal" and max(reading.rest) < OPEN_OHM:
        return 1.0
    loaded = np.concatenate(
        [x[part.load_n >= _SCORED_N] for x, part in zip(totals, sensor.parts, strict=True)]
    )
    loaded = loaded[np.isfinite(loaded) & (loaded > 0)]
    if not loaded.size:
        raise CalibrationError(f"{sensor.name}: no reading above that without load under a load")
    return float(np.exp(ForceLaw().population.centre[0]) / np.median(loaded))


def _find_contacts(
    sensor: LoadedSensor, totals: Sequence[FloatArray], *, scale: float
) -> Iterator[_Contact]:
    law = ForceLaw()
    law.scale = scale
    most = max(float(np.nanmax(part.load_n, initial=0.0)) for part in sensor.parts)
    by_part = len(sensor.parts) >= FEWEST_HELD_OUT
    number = 0
    for at, (part, total) in enumerate(zip(sensor.parts, totals, strict=True)):
        rows = np.flatnonzero(np.isfinite(total))
        time_s, load_n = part.time_s[rows], part.load_n[rows]
        inputs = law.trace(time_s, total[rows])
        slow = rows.size > 1 and float(np.median(np.diff(time_s))) >= SLOW_STEP_S
        fewest = 1 if slow else _FEWEST_READINGS
        touched = np.nan_to_num(load_n) > max(_CONTACT_N, _CONTACT_FRACTION * most)
        for begin, end in _find_stretches(time_s, touched):
            inside = np.flatnonzero(touched[begin:end]) + begin
            if inside.size < fewest:
                continue
            few = min(inside.size, _MOST_READINGS)
            yield _Contact(
                group=at if by_part else number,
                inputs=inputs[inside],
                excess=total[rows][inside],
                force_n=load_n[inside],
                thinned=np.unique(np.linspace(0, inside.size - 1, few).astype(int)),
            )
            number += 1


def _find_stretches(time_s: FloatArray, touched: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of each contact, with its short pauses."""
    edges = np.flatnonzero(np.diff(np.r_[False, touched, False].astype(int)))
    found = list[tuple[int, int]]()
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and time_s[begin] - time_s[found[-1][1] - 1] < _PAUSE_S:
            found[-1] = (found[-1][0], end)
        else:
            found.append((begin, end))
    return found


def _fit_contacts(contacts: Sequence[_Contact], *, scale: float) -> ForceLaw:
    """Fit the law; all readings have equal weight, because a sensor is pressed at many places."""
    places = np.linspace(0, len(contacts) - 1, min(len(contacts), _MOST_CONTACTS)).astype(int)
    used = [contacts[at] for at in np.unique(places)]
    inputs = np.concatenate([one.inputs[one.thinned] for one in used])
    force_n = np.concatenate([one.force_n[one.thinned] for one in used])
    return ForceLaw.fit(inputs, force_n=force_n, scale=scale)


def _score_contacts(contacts: Sequence[_Contact], *, scale: float) -> tuple[HeldOut | None, float]:
    """Return the errors on held-out contacts, and the misfit of the law.

    The misfit is the factor with which 90 % of the held-out errors are within the interval. The
    coverage of each group is that with the misfit of the other groups.
    """
    numbers = [one.group for one in contacts]
    distinct = np.unique(numbers)
    if distinct.size < FEWEST_HELD_OUT:
        return None, 1.0
    folds = min(distinct.size, _MOST_GROUPS)
    fold_of = {int(one): at * folds // distinct.size for at, one in enumerate(distinct)}
    errors, scores = list[FloatArray](), list[FloatArray]()
    power, inside = list[float](), list[bool]()
    for fold in range(folds):
        known = [one for one in contacts if fold_of[one.group] != fold]
        tested = [one for one in contacts if fold_of[one.group] == fold]
        inputs, excess, force_n = (
            np.concatenate([getattr(one, name) for one in tested])
            for name in ("inputs", "excess", "force_n")
        )
        scored = force_n >= _SCORED_N
        if not scored.any():
            continue
        mean, sd = _fit_contacts(known, scale=scale).log_force(inputs[scored])
        errors.append(np.log(force_n[scored]) - mean)
        scores.append(errors[-1] / sd)
        trained, trained_n = (
            np.concatenate([getattr(one, name)[one.thinned] for one in known])
            for name in ("excess", "force_n")
        )
        value, covers = predict_power(trained, trained_n, excess[scored], force_n[scored])
        power += value
        inside += covers
    covered = list[bool]()
    for fold, each in enumerate(scores):
        others = np.concatenate([one for at, one in enumerate(scores) if at != fold])
        half = half_width_sds(LEVEL) * max(1.0, find_spread(others))
        covered += (np.abs(each) <= half).tolist()
    every = np.abs(np.concatenate(errors))
    return HeldOut(
        what=f"the contacts in {folds} groups",
        groups=int(distinct.size),
        readings=int(every.size),
        median_abs_log_error=float(np.median(every)),
        coverage=float(np.mean(covered)),
        power_median_abs_log_error=float(np.median(power)) if power else None,
        power_coverage=float(np.mean(inside)) if inside else None,
    ), max(1.0, find_spread(np.concatenate(scores)))
