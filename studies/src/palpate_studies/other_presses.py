"""Presses of simulated sheets of another law: what no model of presses was written for.

Fixed before anything was scored on it. The sheets are those of `other_sheets` (logarithmic law,
play, even creep), pressed at several places through a round tip, with a load cell, as the robot of
the real recordings does. Two kinds of motion, each learned from and tested on its own:

- ``alike``: up, held and let go as that robot does, nearly the same each time: a clock knows most.
- ``unlike``: of any speed and length, the force wanders while it is held and is let go slowly too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.ranges import log_uniform
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import Sheet, draw_sheet
from palpate_studies.other_sheets import other_sheet
from palpate_studies.press_data import Press, cut

#: Seed of everything drawn here.
SEED = 96_300
MOTIONS = ("alike", "unlike")
#: Sheets, forces that each is pressed to (N), repeats of each, presses of a repeat, their places.
_SHEETS, _PEAKS_N, _REPEATS, _PRESSES, _PLACES = 6, ((2.0, 10.0), (10.0, 40.0)), 2, 16, 8
#: As the real recordings: samples a second, and seconds of rest before each press.
_RATE_HZ, _REST_S = 71.0, 2.6
#: Pixels under the tip, and how unevenly they share the force (of a Dirichlet distribution).
_PIXELS, _EVEN = 4, 6.0
#: Gain from place to place and from repeat to repeat, sd of the logarithm, as real ones have.
_PLACE_LOG_SD, _REPEAT_LOG_SD = 0.6, 0.1
#: Noise of the load cell, N.
_CELL_N = 0.02
#: `alike`: seconds up, at the force and down, their scatter and that of the force (log sd).
_UP_S, _HELD_S, _DOWN_S, _ALIKE_LOG_SD = 0.28, 1.2, 0.05, 0.04
#: Share of the force at which the robot slows down, and the seconds in which it makes the rest.
_FAST_SHARE, _SLOW_S = 0.8, 0.3
#: `unlike`: ranges of the same, of the force's wandering (log) and of its period, s.
_ANY_UP_S, _ANY_HELD_S, _ANY_DOWN_S = (0.1, 1.0), (0.6, 5.0), (0.05, 0.6)
_WANDERS, _PERIOD_S, _ANY_PEAK = 0.25, (0.8, 4.0), (0.6, 1.6)


def other_presses(motion: str, *, seed: int = SEED) -> list[Press]:
    """Return presses of every sheet, with one kind of motion; a setting is a sheet and a force."""
    found = []
    for number in range(_SHEETS):
        rng = np.random.default_rng([seed, MOTIONS.index(motion), number])
        whole = other_sheet(draw_sheet(rng, layout=RIGID_LAYOUT, level="field"))
        sheet = replace(whole, gain=whole.gain[:_PIXELS], rest_ohm=whole.rest_ohm[:_PIXELS])
        places = [_Place(rng) for _ in range(_PLACES)]
        for peaks, range_n in enumerate(_PEAKS_N):
            peak_n = log_uniform(rng, range_n)
            for repeat in range(1, _REPEATS + 1):
                name = f"{motion}_sheet{number}_force{peaks}_exp{repeat}"
                force_n = _force(rng, motion, peak_n=peak_n)
                found += cut(name, *_recorded(rng, sheet, places, force_n))
    return found


class _Place:
    """A place of a sheet: its gain, and how the pixels there share the force."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.gain = float(np.exp(_PLACE_LOG_SD * rng.standard_normal()))
        self.shares = rng.dirichlet(np.full(_PIXELS, _EVEN))


def _force(rng: np.random.Generator, motion: str, *, peak_n: float) -> list[FloatArray]:
    """Return the force of each press at every sample, with the rest before it."""
    draw = _alike if motion == "alike" else _unlike
    rest = np.zeros(round(_REST_S * _RATE_HZ))
    return [np.concatenate([rest, peak_n * draw(rng)]) for _ in range(_PRESSES)]


def _alike(rng: np.random.Generator) -> FloatArray:
    up_s, held_s, down_s, peak = np.array([_UP_S, _HELD_S, _DOWN_S, 1.0]) * np.exp(
        _ALIKE_LOG_SD * rng.standard_normal(4)
    )
    rising = np.linspace(0.0, _FAST_SHARE, _samples(up_s))
    slower = 1.0 - (1.0 - _FAST_SHARE) * np.exp(-np.arange(_samples(held_s)) / _RATE_HZ / _SLOW_S)
    falling = np.linspace(1.0, 0.0, _samples(down_s) + 1)[1:]
    return np.asarray(peak * np.concatenate([rising, slower, slower[-1] * falling]))


def _unlike(rng: np.random.Generator) -> FloatArray:
    up, held, down = (_samples(log_uniform(rng, r)) for r in (_ANY_UP_S, _ANY_HELD_S, _ANY_DOWN_S))
    at_s = np.arange(held) / _RATE_HZ
    turns = 2.0 * np.pi * at_s / log_uniform(rng, _PERIOD_S)
    size, drift = _WANDERS * rng.uniform(-1.0, 1.0, 2)
    wandering = np.exp(size * np.sin(turns) + drift * at_s / at_s[-1])
    falling = np.linspace(1.0, 0.0, down + 1)[1:]
    peak = log_uniform(rng, _ANY_PEAK)
    whole = [np.linspace(0.0, 1.0, up), wandering, wandering[-1] * falling]
    return np.asarray(peak * np.concatenate(whole))


def _samples(lasts_s: float) -> int:
    return max(round(lasts_s * _RATE_HZ), 2)


def _recorded(
    rng: np.random.Generator, sheet: Sheet, places: list[_Place], presses_n: list[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, resistance and load cell of one recording."""
    state = SheetState.unloaded(_PIXELS, creep=sheet.family.draw(rng))
    ohm = list[float]()
    for number, force_n in enumerate(presses_n):
        place, creep = places[number % _PLACES], sheet.family.draw(rng)
        gain = sheet.gain * place.gain * np.exp(_REPEAT_LOG_SD * rng.standard_normal())
        for load_n in force_n.tolist():
            state = state.after(
                1.0 / _RATE_HZ,
                load_n * place.shares,
                travel_mm=0.0,
                sheet=sheet,
                gain=gain,
                creep=creep,
            )
            # One pair of electrodes: the places under the tip conduct next to each other.
            ohm.append(1.0 / float(np.sum(1.0 / state.resistance_ohm(sheet, creep=creep))))
    force = np.concatenate(presses_n)
    noise, cell = rng.standard_normal((2, force.size))
    time_s = np.arange(force.size) / _RATE_HZ
    return time_s, np.array(ohm) * (1.0 + sheet.white_noise * noise), force + _CELL_N * cell
