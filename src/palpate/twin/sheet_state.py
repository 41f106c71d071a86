"""State variables of a sheet's resistances under time-varying loads.

The load may come from `palpate.twin.plant` or another simulator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.velostat import Creep, Sheet


@dataclass(frozen=True, slots=True)
class SheetState:
    """Flattened pixels of one sheet at one time; targets are linear between states.

    >>> from palpate.sensor.array import RIGID_LAYOUT
    >>> from palpate.twin.velostat import draw_sheet, two_mode_creep
    >>> rng = np.random.default_rng(1)
    >>> sheet = draw_sheet(rng, layout=RIGID_LAYOUT, level="lab")
    >>> creep = two_mode_creep(rng, 1.0)
    >>> rest = SheetState.at_rest(8, creep=creep)
    >>> load_n = np.full(8, 2.0)
    >>> contact = {"travel_mm": 0.0, "sheet": sheet, "gain": sheet.gain, "creep": creep}
    >>> pressed = rest.advance(0.1, load_n, **contact)
    >>> later = pressed.advance(5.0, load_n, **contact)
    >>> ohm = [state.resistance_ohm(sheet, creep=creep).mean() for state in (rest, pressed, later)]
    >>> bool(ohm[0] > ohm[1] > ohm[2])
    True
    """

    #: Shape (pixels,). Effective load of the sheet; with hysteresis when the load falls.
    sensed_n: FloatArray
    #: Shape (pixels,). Final creep coordinate of this load.
    target: FloatArray
    #: Shape (states, pixels). Creep states, which follow the target with a lag.
    creep: FloatArray
    #: Shape (pixels,). Relative increase of the resistance due to movements.
    spike: FloatArray

    @classmethod
    def at_rest(cls, pixels: int, *, creep: Creep) -> Self:
        """Return the state of a sheet after a long rest."""
        nothing = np.zeros(pixels)
        return cls(nothing, nothing, np.zeros((creep.tau_s.size, pixels)), nothing)

    def advance(
        self,
        step_s: float,
        load_n: FloatArray,
        *,
        travel_mm: float,
        sheet: Sheet,
        gain: FloatArray,
        creep: Creep,
    ) -> SheetState:
        """Return the state one step later.

        `load_n`, shape (pixels,): load at the end of the step.
        `travel_mm`: travel of the fingers during the step.
        `sheet`, `gain`, `creep`: the sheet, and the gain and creep of this contact.
        """
        if not np.count_nonzero(load_n):
            nothing = np.zeros_like(load_n)
            return self._step(step_s, nothing, nothing, travel_mm, sheet, creep)
        sensed_n = sheet.follow(self.sensed_n, load_n)
        target = sheet.family.coordinate(sheet.static_excess(sensed_n, gain=gain))
        return self._step(step_s, sensed_n, target, travel_mm, sheet, creep)

    def interpolate(
        self,
        next_state: SheetState,
        fraction: float,
        *,
        step_s: float,
        travel_mm: float,
        sheet: Sheet,
        creep: Creep,
    ) -> SheetState:
        """Return the state within a step, after a fraction of `step_s`."""
        sensed_n = self.sensed_n + fraction * (next_state.sensed_n - self.sensed_n)
        target = self.target + fraction * (next_state.target - self.target)
        return self._step(step_s, sensed_n, target, travel_mm, sheet, creep)

    def resistance_ohm(self, sheet: Sheet, *, creep: Creep, rest_factor: float = 1.0) -> FloatArray:
        """Return the resistance of every pixel, shape (pixels,).

        `rest_factor`: factor of the environment (`Sheet.rest_factor`).
        """
        v = creep.instant_fraction * self.target + creep.weight @ self.creep
        bare = sheet.rest_ohm * rest_factor * (1.0 + self.spike)
        resistance: FloatArray = bare / (1.0 + sheet.family.excess_conductance(v))
        return resistance

    def _step(
        self,
        step_s: float,
        sensed_n: FloatArray,
        target: FloatArray,
        travel_mm: float,
        sheet: Sheet,
        creep: Creep,
    ) -> SheetState:
        """Return the state after a step, with creep and spikes under a linear target."""
        crept = follow_line(
            self.creep, start=self.target, end=target, rate=step_s / creep.tau_s[:, None]
        )
        fall = math.exp(-step_s / sheet.spike_decay_s)
        average = (1.0 - fall) * sheet.spike_decay_s / step_s if step_s > 0 else 1.0
        jump = np.abs(target - self.target)
        push = sheet.spike_per_mm * travel_mm + sheet.spike_per_target * jump
        return SheetState(sensed_n, target, crept, self.spike * fall + push * average)


def step_decay(rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the exponential decay at the end and on average over a step.

    `rate`: step / time constant.

    >>> decay, mean = step_decay(np.array([0.0, 1.0]))
    >>> decay.round(3).tolist(), mean.round(3).tolist()
    ([1.0, 0.368], [1.0, 0.632])
    """
    rate = np.maximum(rate, 1e-12)
    fall = np.expm1(-rate)
    return 1.0 + fall, -fall / rate


def follow_line(
    value: FloatArray, *, start: FloatArray, end: FloatArray, rate: FloatArray
) -> FloatArray:
    """Return first-order lags at the end of a step with a linear target.

    `value`: lags at the start of the step.
    `start`, `end`: target at both ends of the step.
    `rate`: step / time constant.
    """
    decay, mean = step_decay(rate)
    return end - mean * (end - start) - decay * (start - value)
