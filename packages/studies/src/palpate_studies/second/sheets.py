"""Second generator of sheets, with laws that no estimator of force or settling assumes.

The generator was fixed before anything was scored on it. The twin's sheets follow a saturating
power law, have a hysteresis proportional to the load, and creep ever slower in the relative change
or in log conductance. These sheets

- first rise faster than any of those laws, then with the logarithm of the load;
- have a hysteresis of a fixed force, independent of the load;
- creep in the square root of the excess conductance: first fast, then after about fifteen seconds
  at a constant rate.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.velostat import Creep, Family, Sheet

#: First exponent of the static law, and factor that makes it 1 at the unit force with a gain of 1.
_FIRST_EXPONENT, _AT_UNIT = 1.8, np.e - 1.0
#: Hysteresis in unit forces of the sheet, per unit of the twin's ratio of hysteresis.
_BACKLASH = 3.0
#: Amplitudes and time constants (s) of the creep, and their scatter from grasp to grasp (log sd);
#: the third, negative amplitude makes the rate constant.
_CREEP, _CREEP_S, _CREEP_LOG_SD = (0.10, 0.14, -0.06, 0.10), (0.5, 3.0, 9.0, 60.0), 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class RootFamily(Family):
    """Creep that is linear in the square root of the excess conductance."""

    def coordinate(self, excess: FloatArray) -> FloatArray:
        """Return the square root of an excess conductance."""
        return np.sqrt(excess)

    def excess_conductance(self, coordinate: FloatArray) -> FloatArray:
        """Return the excess conductance of a square root; negative roots give 0."""
        return np.maximum(coordinate, 0.0) ** 2


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherSheet(Sheet):
    """A sheet with a logarithmic law and a hysteresis of fixed force."""

    def static_excess(self, load_n: FloatArray, *, gain: FloatArray) -> FloatArray:
        """Return the static excess conductance of a load."""
        pressed = np.maximum(load_n, 0.0) / self.unit_force_n
        return np.asarray(gain * np.log1p(_AT_UNIT * pressed**_FIRST_EXPONENT))

    def follow(self, played_n: FloatArray, load_n: FloatArray) -> FloatArray:
        """Return the effective load, which lags behind a falling load by a fixed force."""
        backlash_n = _BACKLASH * self.hysteresis * self.unit_force_n
        return np.minimum(np.maximum(played_n, load_n), load_n + backlash_n)


def other_sheet(sheet: Sheet) -> OtherSheet:
    """Return a sheet of the second generator with the same gains, noise and wear."""
    known = {field.name: getattr(sheet, field.name) for field in fields(Sheet)}
    family = RootFamily(name="even pace", relative=False, draw=_even_creep)
    return OtherSheet(**known | {"family": family})


def _even_creep(rng: np.random.Generator) -> Creep:
    jitter = np.exp(_CREEP_LOG_SD * rng.standard_normal((2, len(_CREEP))))
    return Creep(np.array(_CREEP_S) * jitter[0], np.array(_CREEP) * jitter[1])
