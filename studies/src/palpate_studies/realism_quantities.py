"""Scatter, creep, shape and noise of a recording: the same for real and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold, settled_value
from palpate.scoring.predictions import predict_holds
from palpate.settling.exponential import Exponential
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod
from palpate_studies.press_data import Press

CUTOFF_S, HORIZON_S = 2.5, 20.0
#: Loads below this are not compared.
SMALLEST_N = 0.5
#: Creep is what happens between these times after the force is reached, the force's own share out.
CREEP_FROM_S, CREEP_TO_S = 0.2, 1.2

#: Steps from sample to sample that a rise needs to show its slope: three, at 15 Hz, is 0.2 s.
FEWEST_RISING = 3

#: This many places are pressed at once by a thing on the twin's sheet; draws of as many real ones.
PLACES, _DRAWS = 8, 2000

#: Load and excess conductance of one sensor, one pair per weight.
Ladder = tuple[FloatArray, FloatArray]


def ladder_quantities(ladders: Sequence[Ladder]) -> dict[str, FloatArray]:
    """Return exponent, scatter about its own line and error of the other ladders' law, per ladder.

    Ladders are compared in threes (two to learn from, one to predict), as that is how many real
    ones there are.
    """
    logs = [(np.log(load), np.log(excess)) for load, excess in ladders]
    lines = [np.polyfit(load, excess, 1) for load, excess in logs]
    scatter = [
        np.std(excess - np.polyval(line, load), ddof=2) / abs(line[0])
        for (load, excess), line in zip(logs, lines, strict=True)
    ]
    missed = []
    for index, (load, excess) in enumerate(logs):
        others = [logs[(index + step) % len(logs)] for step in (1, 2)]
        loads, excesses = (np.concatenate(part) for part in zip(*others, strict=True))
        learned = np.polyfit(loads, excesses, 1)
        missed.append(np.median(np.abs((excess - learned[1]) / learned[0] - load)))
    return {
        "exponent": np.array([line[0] for line in lines]),
        "scatter of ln force": np.array(scatter),
        "ln force missed": np.array(missed),
    }


def press_quantities(presses: Sequence[Press]) -> dict[str, FloatArray]:
    """Return the gain's scatter per recording and the creep of each press."""
    exponent = _within_press_exponent(presses)
    creeps = []
    for press in presses:
        time_s, log_gain = _held_gain(press, exponent)
        if time_s[-1] >= CREEP_TO_S:
            early, late = np.interp([CREEP_FROM_S, CREEP_TO_S], time_s, log_gain)
            creeps.append(100 * np.expm1(late - early))
    gains = log_gains(presses)
    scatter = [np.std(gain, ddof=1) for gain in gains.values() if len(gain) > 2]
    return {"gain scatter": np.array(scatter), "creep, %": np.array(creeps)}


def log_gains(presses: Sequence[Press]) -> dict[str, FloatArray]:
    """Return ln conductance at equal force of each press when its force was given, by recording."""
    exponent = _within_press_exponent(presses)
    gains: dict[str, list[float]] = {}
    for press in presses:
        gains.setdefault(press.recording_id, []).append(float(_held_gain(press, exponent)[1][0]))
    return {name: np.array(gain) for name, gain in gains.items()}


def _held_gain(press: Press, exponent: float) -> tuple[FloatArray, FloatArray]:
    """Return time since the force was given, and ln conductance less the force's share of it."""
    trace = press.trace
    held = slice(trace.told, press.last_held + 1)
    log_gain = _log(trace.excess[held]) - exponent * _log(trace.force_n[held])
    return trace.time_s[held] - trace.time_s[trace.told], log_gain


def together(gains: Mapping[str, FloatArray]) -> FloatArray:
    """Return the scatter of the mean conductance of eight places drawn from each recording.

    That is what a sheet of eight pixels sums, if its pixels are places independent of each other.
    """
    rng = np.random.default_rng(0)
    drawn = [
        np.exp(rng.choice(gain, (_DRAWS, PLACES))).mean(axis=1)
        for gain in gains.values()
        if len(gain) >= PLACES
    ]
    return np.array([np.std(np.log(mean)) for mean in drawn])


def halves(gains: Mapping[str, FloatArray]) -> FloatArray:
    """Return |difference| / sqrt(2) of ln mean conductance of the first and last eight places.

    Neighbours are pressed one after another and are alike, so that they average less.
    """
    return np.array(
        [
            abs(np.log(np.exp(gain[:PLACES]).mean() / np.exp(gain[-PLACES:]).mean())) / np.sqrt(2)
            for gain in gains.values()
            if len(gain) >= 2 * PLACES
        ]
    )


def _within_press_exponent(presses: Sequence[Press]) -> float:
    """Return the slope of ln excess over ln force while the force rises, gains left out."""
    forces: list[FloatArray] = []
    excesses: list[FloatArray] = []
    for press in presses:
        trace = press.trace
        rising = slice(trace.first, trace.told + 1)
        if trace.told - trace.first >= FEWEST_RISING:
            for found, values in ((forces, trace.force_n), (excesses, trace.excess)):
                log = _log(values[rising])
                found.append(log - log.mean())
    force, excess = np.concatenate(forces), np.concatenate(excesses)
    return float(force @ excess / (force @ force))


def _log(values: FloatArray) -> FloatArray:
    return np.log(np.maximum(values, 1e-3))


def hold_quantities(holds: Sequence[Hold]) -> dict[str, FloatArray]:
    """Return how far holds are from settled at 2.5 s, what predictors miss there, and the noise."""
    long = [hold for hold in holds if _settled(hold) > 0]
    found = {
        "still to come, %": np.array([_still_to_come(hold) for hold in long]),
        "noise, %": np.array([_noise_percent(hold) for hold in long]),
    }
    methods: dict[str, SettlingMethod] = {"relaxation": Relaxation(), "exponential": Exponential()}
    predictions = list(
        predict_holds(long, methods=methods, cutoffs_s=[CUTOFF_S], horizon_s=HORIZON_S, level=0.9)
    )
    for name in methods:
        rows = [one for one in predictions if one.method == name]
        found[f"{name} error, %"] = np.abs([row.error_percent for row in rows])
        found[f"{name} error, % of rest"] = np.array([row.of_remaining_percent for row in rows])
    return found


def _settled(hold: Hold) -> float:
    return settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)


def _still_to_come(hold: Hold) -> float:
    at = np.interp(CUTOFF_S, hold.time_s, hold.values)
    return float(100 * (at / _settled(hold) - 1))


def _noise_percent(hold: Hold) -> float:
    """Return the noise of one sample in the second half, from second differences."""
    half = (hold.time_s > HORIZON_S / 2) & (hold.time_s <= HORIZON_S)
    second = np.diff(hold.values[half], 2)
    return float(100 * np.sqrt(np.mean(second**2) / 6) / _settled(hold))
